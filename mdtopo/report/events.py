"""Where should I look? The alerts, worst first, each with the pair that it is about and the frames to open."""

from dataclasses import dataclass

import numpy as np

from mdtopo.alerts import crossing_keys
from mdtopo.curvealerts import own_crossings
from mdtopo.records import Alert, AlertKind, Crossing, Grade, Severity, Shape
from mdtopo.report.rundata import WORST_KINDS, RunData

PAIR_COLUMNS = {"pair": "pair_ratio_pair", "nu": "nu_pair", "clearance": "clearance_pair"}
"""The column that holds the pair of each near-limit criterion."""


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """An alert, and what is needed to show it.

    Attributes
    ----------
    alert : Alert
    crossing : Crossing or None
        Where the alert is about one, of edges or of the smooth curve.
    edges : tuple of tuple of int
        The edges that are marked: two, one (a bond), or none; a vertex is an edge with equal ends.
    frames : tuple of int or None
        The two frames of the worst step; None where the alert is about no step.
    times : tuple of float
        Their times, ps.
    """

    alert: Alert
    crossing: Crossing | None
    edges: tuple[tuple[int, int], ...]
    frames: tuple[int, int] | None
    times: tuple[float, float]

    @property
    def grade(self) -> str:
        """The grade of a crossing in words, else empty."""
        return "" if self.crossing is None else self.crossing.grade.name.lower()

    @property
    def span(self) -> tuple[int, int]:
        """The first frame of its first step and the last frame of its last one."""
        return self.alert.frame_start, self.alert.frame_end

    @property
    def about_curve(self) -> bool:
        """Whether it is about the smooth curve alone."""
        return self.alert.object is Shape.CURVE

    @property
    def name(self) -> str:
        """The kind of the alert; what it is about is said where that is the curve."""
        return f"{self.alert.kind.value}{' of the curve' if self.about_curve else ''}"

    @property
    def has_view(self) -> bool:
        """Whether there is something to look at: a pair or an edge, in a step."""
        return bool(self.edges) and self.frames is not None


def ranked_events(run: RunData) -> list[Event]:
    """Return the events of all alerts, worst first: by severity, kind, grade of a crossing, and how far beyond."""
    crossings = run.results.crossings
    keys = [f"crossing-{s}-{k}" for s, k in zip(crossings.step.tolist(), crossing_keys(crossings), strict=True)]
    row_of = {key: row for row, key in enumerate(keys)}
    events = [_event(run, alert, row_of) for alert in run.results.alerts]
    return sorted(events, key=_concern)


def _event(run: RunData, alert: Alert, row_of: dict[str, int]) -> Event:
    crossing = run.results.crossings[row_of[alert.id]] if alert.id in row_of else None
    if alert.object is Shape.CURVE and alert.kind is AlertKind.CROSSING:
        crossing = _curve_crossing(run, alert)
    if alert.kind is AlertKind.GAP or not 0 <= run.row(alert.step_peak) < run.n_steps:
        return Event(alert, crossing, (), None, (np.nan, np.nan))
    row, columns = run.row(alert.step_peak), run.columns
    frames = int(columns["frame_t0"][row]), int(columns["frame_t1"][row])
    times = float(columns["time_t0"][row]), float(columns["time_t1"][row])
    return Event(alert, crossing, _edges(run, alert, crossing, row), frames, times)


def _curve_crossing(run: RunData, alert: Alert) -> Crossing | None:
    """Return the crossing of the curve that an alert names: the surest of its worst step that the polyline lacks."""
    results, step = run.results, alert.step_peak
    own = own_crossings(results.curve_crossings.of_step(step), results.crossings.of_step(step), results.strands)
    named = [crossing for crossing in own if _named(run, alert, crossing.edges.ravel().tolist())]
    return max(named, key=lambda c: (c.grade, -c.motion / max(c.resolution, 1e-300)), default=None)


def _edges(run: RunData, alert: Alert, crossing: Crossing | None, row: int) -> tuple[tuple[int, int], ...]:
    """Return the edges that an alert is about, those alone whose labels the alert names."""
    columns = run.columns
    if crossing is not None:
        found = crossing.edges
    elif alert.kind is AlertKind.FRACTURE:
        at_peak = [edge.edge for edge in run.results.broken if edge.step == alert.step_peak]
        found = next((np.array([edge]) for edge in at_peak if _named(run, alert, edge)), np.empty((0, 2), int))
    elif alert.kind is AlertKind.STRETCH:
        found = columns["bond_stretch_edge"][row][np.newaxis]
    elif alert.kind is AlertKind.NEAR_LIMIT:
        found = columns[PAIR_COLUMNS[run.config.criterion]][row]
    elif alert.object is Shape.CURVE:
        found = columns["curve_clearance_pair"][row]
        if not all(_is_edge(run, int(a), int(b)) for a, b in found):
            return ()  # one segment for a whole strand goes with no edge
    elif alert.kind is AlertKind.UNRESOLVED:
        candidates = (columns["clearance_pair"][row], columns["pair_ratio_pair"][row])
        found = next((pair for pair in candidates if _named(run, alert, pair.ravel().tolist())), np.empty((0, 2), int))
    else:
        return ()
    if (found < 0).any() or not _named(run, alert, found.ravel().tolist()):
        return ()
    # a curve that folds within one arc is named by that arc twice
    return tuple(dict.fromkeys((int(a), int(b)) for a, b in found))


def _is_edge(run: RunData, a: int, b: int) -> bool:
    strands = run.results.strands
    s = strands.strand_of_vertex[a]
    first, last = int(strands.offsets[s]), int(strands.offsets[s + 1]) - 1
    return a >= 0 and ((b == a + 1 and b <= last) or (bool(strands.closed[s]) and (a, b) == (last, first)))


def _named(run: RunData, alert: Alert, vertices: "list[int] | tuple[int, int]") -> bool:
    labels = run.results.strands.labels
    return min(vertices, default=-1) >= 0 and {labels.text(v) for v in vertices} <= set(alert.residues)


def event_place(run: RunData, event: Event) -> tuple[float | None, tuple[float, ...] | None]:
    """Return when within its step an event is (None: where the pair is nearest), and where on the smooth curve's arcs.

    The second has a share for each of the event's edges, and is None where it is about these and not about arcs.
    """
    crossing = event.crossing
    if not event.about_curve:
        return (None if crossing is None else crossing.t), None
    if crossing is not None:
        s, r = crossing.parameters.tolist()
        return crossing.t, (s, r)[: len(event.edges)]
    place = run.columns["curve_place"][run.row(event.alert.step_peak)]
    if not np.isfinite(place).all():
        return 0.5, (0.5,) * len(event.edges)
    t, s, r = place.mean(axis=1).tolist()
    return t, (s, r)[: len(event.edges)]


def _concern(event: Event) -> tuple[int, int, int, float, int]:
    alert = event.alert
    grade = Grade.PROVEN - event.crossing.grade if event.crossing is not None else 0
    return -alert.severity, WORST_KINDS.index(alert.kind), grade, _slack(event), alert.step_peak


def _slack(event: Event) -> float:
    """Return what is smaller the worse an event is: for a crossing, how surely it is one."""
    alert = event.alert
    if alert.value is None or not alert.limit:
        return 0.0
    ratio = alert.value / alert.limit
    return ratio if alert.kind is AlertKind.CROSSING else -ratio


def severity_word(severity: Severity) -> str:
    """Return a severity in words."""
    return severity.name.lower()
