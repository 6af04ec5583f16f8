"""One card for each strand, and for each pair of strands that met: how close it was, and what happened."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

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
        Least clearance on record, Å; NaN where it never was the closest. Of a strand: between edges of its own, also
        those with one edge between them.
    step : int
        The step of it; -1 where there is none.
    place : str
        Between which edges.
    apart, apart_step : float, int
        Of a strand, the least clearance on record from another one, Å, and its step; NaN and -1 where there is none.
    n_crossings, n_alerts : int
        How many there are; crossings of the polyline.
    n_curve_crossings : int
        How many crossings of the smooth curve there are, counted apart.
    what : str
        What the clearance is of, in words.
    """

    title: str
    kind: str
    clearance: float
    step: int
    place: str
    n_crossings: int
    n_alerts: int
    n_curve_crossings: int = 0
    what: str = "least clearance"
    apart: float = float("nan")
    apart_step: int = -1

    @property
    def concern(self) -> tuple[int, float, int]:
        """What cards are ordered by, the worst first."""
        return -self.n_crossings, self.clearance if np.isfinite(self.clearance) else np.inf, -self.n_alerts


def strand_cards(run: RunData) -> list[Card]:
    """Return one card for each strand, worst first; one that never held a step's closest pair has no clearance."""
    strands, of = run.results.strands, run.results.strands.strand_of_vertex
    # both classes of pairs of one strand, one below the other: row k is of step k % n_steps
    pairs, values = (
        np.concatenate([run.columns[f"clearance_{kind}{end}"] for kind in ("local", "self")]) for end in ("_pair", "")
    )
    best, apart = _best_by_key(of[pairs[:, 0, 0]], pairs, values), _apart(run)
    counts = _Counts.of(run)
    cards = []
    for s, name in enumerate(strands.names):
        size = int(strands.offsets[s + 1] - strands.offsets[s])
        kind = f"{'ring' if strands.closed[s] else 'open strand'} of {size} vertices"
        card = _card(run, name, kind, best.get(s, -1), pairs, values, counts.both(s, s, [name]))
        value, row = apart.get(s, (float("nan"), -1))
        step = run.results.first_step + row if row >= 0 else -1
        cards.append(replace(card, what="least clearance within the strand", apart=value, apart_step=step))
    return sorted(cards, key=lambda card: card.concern)


def _apart(run: RunData) -> dict[int, tuple[float, int]]:
    """Return for each strand the least clearance from another, and the row that holds it."""
    pairs, values = run.columns["clearance_inter_pair"], run.columns["clearance_inter"]
    ends = run.results.strands.strand_of_vertex[pairs[:, :, 0]]
    found: dict[int, tuple[float, int]] = {}
    for keys in ends.T:
        for s, row in _best_by_key(keys, pairs, values).items():
            found[s] = min(found.get(s, (np.inf, row)), (float(values[row]), row))
    return found


def pair_cards(run: RunData) -> list[Card]:
    """Return one card for each pair of strands that was the closest of a step or crossed, worst first."""
    strands, of = run.results.strands, run.results.strands.strand_of_vertex
    pairs, values, n = run.columns["clearance_inter_pair"], run.columns["clearance_inter"], strands.n_strands
    ends = np.sort(of[pairs[:, :, 0]], axis=1)
    best = _best_by_key(ends[:, 0] * n + ends[:, 1], pairs, values)
    counts = _Counts.of(run)
    met = {divmod(key, n) for key in best} | {key for key in (*counts.crossings, *counts.of_curve) if key[0] != key[1]}
    cards = []
    for one, two in sorted(met):
        names = [strands.names[one], strands.names[two]]
        row = best.get(one * n + two, -1)
        title = " × ".join(names)
        cards.append(_card(run, title, "two strands", row, pairs, values, counts.both(one, two, names)))
    return sorted(cards, key=lambda card: card.concern)


def _best_by_key(keys: Indices, pairs: Indices, values: NDArray[np.float64]) -> dict[int, int]:
    """Return for each key the row with the least value; rows without a pair do not count."""
    rows = np.flatnonzero((pairs[:, 0, 0] >= 0) & np.isfinite(values))
    order = rows[np.lexsort((rows, values[rows], keys[rows]))]
    found, first = np.unique(keys[order], return_index=True)
    return dict(zip(found.tolist(), order[first].tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class _Counts:
    """Crossings of the polyline and of the curve by their two strands, and alerts by the names of theirs."""

    crossings: Counter[tuple[int, int]]
    of_curve: Counter[tuple[int, int]]
    alerts: Counter[frozenset[str]]

    @classmethod
    def of(cls, run: RunData) -> "_Counts":
        """Return the counts of a run."""
        strand_of = run.results.strands.strand_of_vertex
        lists = (run.results.crossings, run.results.curve_crossings)
        ends = [np.sort(strand_of[crossings.edges[:, :, 0]], axis=1).tolist() for crossings in lists]
        of_edges, of_curve = (Counter((one, two) for one, two in pairs) for pairs in ends)
        return cls(of_edges, of_curve, Counter(frozenset(alert.strands) for alert in run.results.alerts))

    def both(self, one: int, two: int, names: list[str]) -> tuple[int, int, int]:
        """Return how many crossings, alerts and crossings of the curve two strands have, or one with itself."""
        return self.crossings[one, two], self.alerts[frozenset(names)], self.of_curve[one, two]


def _card(
    run: RunData,
    title: str,
    kind: str,
    row: int,
    pairs: Indices,
    values: NDArray[np.float64],
    counts: tuple[int, int, int],
) -> Card:
    if row < 0:
        return Card(title, kind, float("nan"), -1, "", *counts)
    step, place = run.results.first_step + row % run.n_steps, pair_in_words(run, pairs[row])
    return Card(title, kind, float(values[row]), step, place, *counts)


def pair_in_words(run: RunData, pair: Iterable[Indices]) -> str:
    """Return a stored pair in words; empty where there is none."""
    strands, words = run.results.strands, []
    for a, b in pair:
        if min(a, b) < 0:
            return ""
        words.append(strands.labels.text(int(a)) if a == b else strands.describe_edge((int(a), int(b))))
    return " and ".join(words)
