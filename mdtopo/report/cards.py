"""One card for each strand, and for each pair of strands that met: how close it was, and what happened."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.report.rundata import RunData
from mdtopo.typing import Indices


@dataclass(frozen=True, slots=True)
class Card:
    """What a run says of one strand, or of one pair of strands.

    Attributes
    ----------
    title, kind : str
        Its name or names, and what it is in a few words.
    clearance : float
        Least clearance on record, Å; NaN where it never was the closest.
    step : int
        The step of it; -1 where there is none.
    place : str
        Between which edges.
    n_crossings, n_alerts : int
        How many there are.
    """

    title: str
    kind: str
    clearance: float
    step: int
    place: str
    n_crossings: int
    n_alerts: int

    @property
    def concern(self) -> tuple[int, float, int]:
        """What cards are ordered by, the worst first."""
        return -self.n_crossings, self.clearance if np.isfinite(self.clearance) else np.inf, -self.n_alerts


def strand_cards(run: RunData) -> list[Card]:
    """Return one card for each strand, worst first; one that never held a step's closest self pair has no clearance."""
    strands, of = run.results.strands, run.results.strands.strand_of_vertex
    pairs, values = run.columns["clearance_self_pair"], run.columns["clearance_self"]
    best = _best_by_key(of[pairs[:, 0, 0]], pairs, values)
    crossed = of[run.results.crossings.edges[:, :, 0]]
    crossings = np.bincount(crossed[crossed[:, 0] == crossed[:, 1], 0], minlength=strands.n_strands)
    alerts = _alert_counts(run)
    cards = []
    for s, name in enumerate(strands.names):
        size = int(strands.offsets[s + 1] - strands.offsets[s])
        kind = f"{'ring' if strands.closed[s] else 'open strand'} of {size} vertices"
        row = best.get(s, -1)
        cards.append(_card(run, name, kind, row, pairs, values, int(crossings[s]), alerts.get(frozenset([name]), 0)))
    return sorted(cards, key=lambda card: card.concern)


def pair_cards(run: RunData) -> list[Card]:
    """Return one card for each pair of strands that was the closest of a step or crossed, worst first."""
    strands, of = run.results.strands, run.results.strands.strand_of_vertex
    pairs, values, n = run.columns["clearance_inter_pair"], run.columns["clearance_inter"], strands.n_strands
    ends = np.sort(of[pairs[:, :, 0]], axis=1)
    best = _best_by_key(ends[:, 0] * n + ends[:, 1], pairs, values)
    crossed = np.sort(of[run.results.crossings.edges[:, :, 0]], axis=1)
    keys = crossed[:, 0] * n + crossed[:, 1]
    found, counts = np.unique(keys[crossed[:, 0] != crossed[:, 1]], return_counts=True)
    crossings = dict(zip(found.tolist(), counts.tolist(), strict=True))
    alerts = _alert_counts(run)
    cards = []
    for key in sorted({*best, *crossings}):
        one, two = strands.names[key // n], strands.names[key % n]
        number = crossings.get(key, 0)
        n_alerts = alerts.get(frozenset([one, two]), 0)
        cards.append(_card(run, f"{one} × {two}", "two strands", best.get(key, -1), pairs, values, number, n_alerts))
    return sorted(cards, key=lambda card: card.concern)


def _best_by_key(keys: Indices, pairs: Indices, values: NDArray[np.float64]) -> dict[int, int]:
    """Return for each key the row with the least value; rows without a pair do not count."""
    rows = np.flatnonzero((pairs[:, 0, 0] >= 0) & np.isfinite(values))
    order = rows[np.lexsort((rows, values[rows], keys[rows]))]
    found, first = np.unique(keys[order], return_index=True)
    return dict(zip(found.tolist(), order[first].tolist(), strict=True))


def _alert_counts(run: RunData) -> dict[frozenset[str], int]:
    counts: dict[frozenset[str], int] = {}
    for alert in run.results.alerts:
        members = frozenset(alert.strands)
        counts[members] = counts.get(members, 0) + 1
    return counts


def _card(
    run: RunData,
    title: str,
    kind: str,
    row: int,
    pairs: Indices,
    values: NDArray[np.float64],
    n_crossings: int,
    n_alerts: int,
) -> Card:
    if row < 0:
        return Card(title, kind, float("nan"), -1, "", n_crossings, n_alerts)
    step, place = run.results.first_step + row, pair_in_words(run, pairs[row])
    return Card(title, kind, float(values[row]), step, place, n_crossings, n_alerts)


def pair_in_words(run: RunData, pair: Iterable[Indices]) -> str:
    """Return a stored pair in words; empty where there is none."""
    strands, words = run.results.strands, []
    for a, b in pair:
        if min(a, b) < 0:
            return ""
        words.append(strands.labels.text(int(a)) if a == b else strands.describe_edge((int(a), int(b))))
    return " and ".join(words)
