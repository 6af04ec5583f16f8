"""From step tables to the alert stream: what is near a limit, undecided, stretched or broken, as events.

Neighbouring steps with the same finding are one event, with start, peak and end. An event is said when it has ended,
that is once more than `merge_steps` quiet steps have passed; so the order and the ids of the alerts depend on the run
alone, not on how its frames were cut into blocks. Of a stretched edge the onset is said at once as well: it is what
comes before a fracture, and would be late otherwise.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mdtopo.curvealerts import curve_findings
from mdtopo.records import (
    Alert,
    AlertKind,
    BrokenEdge,
    Crossing,
    Crossings,
    Grade,
    MonitorConfig,
    Reason,
    Rung,
    Severity,
    Shape,
    StepCounts,
    StepTable,
    Strands,
    Verdict,
)
from mdtopo.states import CRITERION_COLUMN, counts_of, meets_limit, step_states
from mdtopo.typing import Flags, Indices, Ratios

SEVERITY = {
    AlertKind.NEAR_LIMIT: Severity.WARNING,
    AlertKind.UNRESOLVED: Severity.WARNING,
    AlertKind.STRETCH: Severity.WARNING,
    AlertKind.BAD_DATA: Severity.WARNING,
    AlertKind.FRACTURE: Severity.CRITICAL,
    AlertKind.IMAGE_JUMP: Severity.INFO,
    AlertKind.GAP: Severity.INFO,
}

CROSSING_SEVERITY = {
    Grade.PROVEN: Severity.CRITICAL,
    Grade.RESOLVED: Severity.CRITICAL,
    Grade.UNDERSAMPLED: Severity.WARNING,
}

UNDECIDED = {
    Reason.TOUCH: "two edges touch, and neither passes",
    Reason.VERTEX: "two edges meet at a vertex",
    Reason.SLIDING: "two edges are parallel where they come together, or stay in one plane",
    Reason.FRAME: "two edges touch in one of the two frames",
}

ONCE = (AlertKind.FRACTURE, AlertKind.CROSSING)
"""What happens at one step and never goes on; but steps in which the curve alone passes are merged as others are."""

CURVE_KEY = "curve"
"""How the id of an alert about the smooth curve ends."""

ONSET = "-onset"
"""How the id ends of what is said when an event begins."""

PAIR_COLUMN = {"pair": "pair_ratio_pair", "nu": "nu_pair", "clearance": "clearance_pair"}
"""By criterion, the step column that holds the pair which its value is of."""

UNITS = {"pair": "", "nu": "", "clearance": " Å"}
CRITERIA = {"pair": "pair ratio", "nu": "2m/ν", "clearance": "clearance"}


@dataclass(frozen=True, slots=True)
class Finding:
    """One step's contribution to an event: `badness` orders the steps of an event, the greatest is its peak.

    `severity` stands where the kind alone does not say it; `object` is what it is about.
    """

    kind: AlertKind
    key: str
    step: int
    frames: tuple[int, int]
    times: tuple[float, float]
    vertices: tuple[int, ...]
    badness: float
    value: float | None
    limit: float | None
    detail: str
    severity: Severity | None = None
    object: Shape = Shape.POLYLINE


@dataclass(frozen=True, slots=True)
class Event:
    """Neighbouring findings of one kind: the first, the worst and the last."""

    first: Finding
    peak: Finding
    last: Finding

    def extended(self, finding: Finding) -> "Event":
        """Return the event with one more step."""
        peak = finding if finding.badness > self.peak.badness else self.peak
        return Event(self.first, peak, finding)


def near_limit_values(table: StepTable, config: MonitorConfig) -> tuple[Ratios, Flags]:
    """Return the value that the near-limit criterion looks at in each step, and whether it meets the limit."""
    values: Ratios = getattr(table, CRITERION_COLUMN[config.criterion])
    return values, meets_limit(values, config)


def said_at(kind: AlertKind, about: Shape, step_end: int, merge_steps: int) -> int:
    """Return the step with which an event is over: one quiet step too many; what happens once is over at once."""
    return step_end if kind in ONCE and about is Shape.POLYLINE else step_end + merge_steps + 1


def alert_order(alert: Alert, merge_steps: int) -> tuple[int, str]:
    """Return the key that sorts alerts as a run says them: by the step they are due with, and by id within a step.

    Gaps come before the first step, in the order of the strands: their key is the same for all of them.
    """
    if alert.kind is AlertKind.GAP:
        return -1, ""
    due = (
        alert.step_start if alert.id.endswith(ONSET) else said_at(alert.kind, alert.object, alert.step_end, merge_steps)
    )
    return due, alert.id


def count_steps(table: StepTable, config: MonitorConfig) -> StepCounts:
    """Return the five counts of a table."""
    values, _ = near_limit_values(table, config)
    return counts_of(step_states(table.verdict, table.rung, values, config))


def crossing_keys(crossings: Crossings) -> Iterator[str]:
    """Yield for each crossing, in order, what its alert's id holds behind the step: the first vertices of its edges."""
    seen: Counter[tuple[int, str]] = Counter()
    for step, edges in zip(crossings.step.tolist(), crossings.edges.tolist(), strict=True):
        pair = f"{edges[0][0]}-{edges[1][0]}"
        yield f"{pair}-{seen[step, pair]}" if seen[step, pair] else pair
        seen[step, pair] += 1


class AlertStream:
    """Turns step tables, given in order, into alerts.

    Parameters
    ----------
    strands : Strands
        Names the strands and residues.
    config : MonitorConfig
        Thresholds, and how far apart steps of one event may be.
    kinds : collection of AlertKind
        What is looked for in the tables; by default everything.
    """

    def __init__(
        self, strands: Strands, config: MonitorConfig, kinds: Collection[AlertKind] = frozenset(AlertKind)
    ) -> None:
        self._strands = strands
        self._config = config
        self._kinds = kinds
        self._open: dict[tuple[AlertKind, str], Event] = {}

    def opening(self) -> Iterator[Alert]:
        """Yield what is to be said before the first step: where strands have gaps."""
        for gap in self._strands.gaps:
            a, b = gap.vertices
            place = self._strands.describe_edge((a, b))
            finding = Finding(
                AlertKind.GAP, f"{a}-{b}", 0, (-1, -1), (np.nan, np.nan), (a, b), 0.0, None, None,
                f"No edge between {place}: {gap.reason}. Nothing is guaranteed across the gap",
            )  # fmt: skip
            yield self._alert(Event(finding, finding, finding))

    def after(self, table: StepTable) -> Iterator[Alert]:
        """Yield the alerts of the events that have ended within the table."""
        closed: list[tuple[int, Event]] = []
        onsets: list[tuple[int, Alert]] = []
        findings = (finding for finding in self._findings(table) if finding.kind in self._kinds)
        for finding in sorted(findings, key=lambda f: f.step):
            slot = (finding.kind, finding.key)
            event = self._open.get(slot)
            if event is not None and self._ends_at(event) < finding.step:
                closed.append((self._ends_at(event), event))
                event = None
            if event is None and finding.kind is AlertKind.STRETCH:
                onsets.append((finding.step, self._onset(finding)))
            self._open[slot] = event.extended(finding) if event is not None else Event(finding, finding, finding)
        horizon = table.first_step + len(table) - 1
        for slot, event in list(self._open.items()):
            if self._ends_at(event) <= horizon:
                closed.append((self._ends_at(event), self._open.pop(slot)))
        yield from _in_order(onsets + [(end, self._alert(event)) for end, event in closed])

    def finish(self) -> Iterator[Alert]:
        """Yield the alerts of the events that were still open at the end of the run."""
        closed = [(self._ends_at(event), self._alert(event)) for event in self._open.values()]
        self._open.clear()
        yield from _in_order(closed)

    def _ends_at(self, event: Event) -> int:
        return said_at(event.first.kind, event.first.object, event.last.step, self._config.merge_steps)

    def _onset(self, finding: Finding) -> Alert:
        """Return what is said when an event begins, before anyone knows how it ends."""
        alert = self._alert(Event(finding, finding, finding))
        return replace(
            alert, id=f"{alert.id}{ONSET}", message=alert.message.replace("is stretched to", "begins to stretch, at")
        )

    def _findings(self, table: StepTable) -> Iterator[Finding]:
        yield from self._near_limit(table)
        yield from self._crossed(table)
        yield from self._unresolved(table)
        yield from self._jumped(table)
        yield from self._stretched(table)
        for edge in table.broken:
            yield self._broken(table, edge)
        yield from self._of_curve(table)

    def _near_limit(self, table: StepTable) -> Iterator[Finding]:
        criterion, limit = self._config.criterion, self._config.near_limit
        values, near = near_limit_values(table, self._config)
        pairs: Indices = getattr(table, PAIR_COLUMN[criterion])
        sign = -1.0 if criterion == "clearance" else 1.0
        for row in np.flatnonzero(near):
            value, unit = float(values[row]), UNITS[criterion]
            detail = (
                f"near the limit (a possible strand passage or fracture between the frames): {CRITERIA[criterion]} "
                f"{value:.3g}{unit} (limit {limit:g}{unit}) "
                f"at {self._pair_in_words(pairs[row])}"
            )
            yield self._finding(
                table,
                int(row),
                AlertKind.NEAR_LIMIT,
                "",
                pairs[row].ravel(),
                sign * value,
                value,
                limit,
                detail,
            )

    def _crossed(self, table: StepTable) -> Iterator[Finding]:
        for crossing, key in zip(table.crossings, crossing_keys(table.crossings), strict=True):
            row = crossing.step - table.first_step
            spacing = float(table.time_t1[row] - table.time_t0[row])
            finding = self._finding(
                table, row, AlertKind.CROSSING, key, crossing.edges.ravel(), crossing.motion, crossing.motion,
                crossing.resolution, crossing_in_words(crossing, spacing),
            )  # fmt: skip
            yield replace(finding, severity=CROSSING_SEVERITY[crossing.grade])

    def _of_curve(self, table: StepTable) -> Iterator[Finding]:
        for f in curve_findings(table, self._strands):
            finding = self._finding(
                table, f.row, f.kind, CURVE_KEY, f.vertices, f.badness, f.value, f.limit, f.detail
            )  # fmt: skip
            yield replace(finding, severity=Severity.WARNING, object=Shape.CURVE)

    def _jumped(self, table: StepTable) -> Iterator[Finding]:
        for row in np.flatnonzero(table.image_jumps > 0):
            count = int(table.image_jumps[row])
            edges = "1 edge jumps" if count == 1 else f"{count} edges jump"
            detail = f"{edges} to another periodic image in the file; mdtopo has made the strands whole"
            yield self._finding(table, int(row), AlertKind.IMAGE_JUMP, "", [], float(count), float(count), None, detail)

    def _unresolved(self, table: StepTable) -> Iterator[Finding]:
        for row in np.flatnonzero(table.verdict == Verdict.UNRESOLVED):
            reason = Reason(int(table.reason[row]))
            if reason is Reason.BAD_DATA:
                detail = f"not measured: {table.problems[row]}"
                yield self._finding(table, int(row), AlertKind.BAD_DATA, "", [], 0.0, None, None, detail)
                continue
            if reason is Reason.IMAGE_JUMP:
                detail = f"undecided: {table.problems[row]}"
                finding = self._finding(table, int(row), AlertKind.IMAGE_JUMP, "lost", [], 0.0, None, None, detail)
                yield replace(finding, severity=Severity.WARNING)
                continue
            ratio, pair = float(table.pair_ratio[row]), table.pair_ratio_pair[row]
            if reason is Reason.CELL:
                detail = "undecided: the periodic cell changes too much within the step to count images"
                ratio = 0.0
            elif reason in UNDECIDED:
                detail = f"undecided: {UNDECIDED[reason]}: {self._pair_in_words(table.clearance_pair[row])}"
            else:
                count = int(table.rung_pairs[row, Rung.OPEN])
                pairs = "1 pair of edges" if count == 1 else f"{count} pairs of edges"
                detail = f"undecided: no rung settles {pairs}; the worst is {self._pair_in_words(pair)}"
            value = ratio if np.isfinite(ratio) else None
            yield self._finding(table, int(row), AlertKind.UNRESOLVED, "", pair.ravel(), ratio, value, 1.0, detail)

    def _stretched(self, table: StepTable) -> Iterator[Finding]:
        s = table.stretches
        for step, edge, ratio, limit in zip(s.step, s.edge, s.ratio, s.limit, strict=True):
            place = self._strands.describe_edge(edge)
            detail = f"edge {place} is stretched to {ratio:.3f} times its reference length (limit {limit:.3f})"
            key = f"{edge[0]}-{edge[1]}"
            yield self._finding(
                table, int(step) - table.first_step, AlertKind.STRETCH, key, edge, float(ratio), float(ratio),
                float(limit), detail,
            )  # fmt: skip

    def _broken(self, table: StepTable, edge: BrokenEdge) -> Finding:
        place = self._strands.describe_edge(edge.edge)
        detail = (
            f"edge {place} is broken at frame {edge.frame}: {edge.ratio:.3f} times its reference length "
            f"(limit {edge.limit:.3f}) for {self._config.fracture_frames} frames; it is no edge from here on"
        )
        key = f"{edge.edge[0]}-{edge.edge[1]}"
        return self._finding(
            table, edge.step - table.first_step, AlertKind.FRACTURE, key, edge.edge, edge.ratio, edge.ratio,
            edge.limit, detail,
        )  # fmt: skip

    def _finding(
        self,
        table: StepTable,
        row: int,
        kind: AlertKind,
        key: str,
        vertices: Iterable[int],
        badness: float,
        value: float | None,
        limit: float | None,
        detail: str,
    ) -> Finding:
        return Finding(
            kind,
            key,
            table.first_step + row,
            (int(table.frame_t0[row]), int(table.frame_t1[row])),
            (float(table.time_t0[row]), float(table.time_t1[row])),
            tuple(int(v) for v in vertices if v >= 0),
            badness,
            value,
            limit,
            detail,
        )

    def _pair_in_words(self, pair: Indices) -> str:
        if (pair < 0).any():
            return "no pair in reach"
        return self._strands.describe_pair(pair)

    def _alert(self, event: Event) -> Alert:
        first, peak, last = event.first, event.peak, event.last
        labels = self._strands.labels
        members = sorted({int(self._strands.strand_of_vertex[v]) for v in peak.vertices})
        suffix = f"-{peak.key}" if peak.key else ""
        alert = Alert(
            id=f"{first.kind}-{first.step}{suffix}",
            kind=first.kind,
            severity=max(_severity(f) for f in (first, peak, last)),
            step_start=first.step,
            step_peak=peak.step,
            step_end=last.step,
            frame_start=first.frames[0],
            frame_end=last.frames[1],
            time_start=first.times[0],
            time_end=last.times[1],
            strands=tuple(self._strands.names[s] for s in members),
            residues=tuple(dict.fromkeys(labels.text(v) for v in peak.vertices)),
            value=peak.value,
            limit=peak.limit,
            message="",
            object=peak.object,
        )
        return replace(alert, message=f"{_when(event)}{peak.detail}.")


def _severity(finding: Finding) -> Severity:
    return SEVERITY[finding.kind] if finding.severity is None else finding.severity


def crossing_in_words(crossing: Crossing, spacing: float) -> str:
    """Return what passes through what, where, and what it says about the physics; `spacing` of the frames in ps."""
    first, second = crossing.strands
    what = f"{first} passes through {'itself' if first == second else second}"
    place = (
        f"{crossing.residues[0]} x {crossing.residues[1]}, t = {crossing.t:.6g} of the step, sign {crossing.sign:+d}"
    )
    if crossing.grade is Grade.PROVEN:
        changed = "knot determinant" if first == second and not crossing.image.any() else "linking number"
        return f"{what} at {place}; proven: the {changed} changes between the frames, whatever the path"
    motion = f"the two edges move {crossing.motion:.3g} Å relative to each other"
    if crossing.grade is Grade.RESOLVED:
        return f"{what} at {place}; resolved: {motion}, less than the resolution length {crossing.resolution:.3g} Å"
    interval = spacing * crossing.resolution / crossing.motion
    cure = f"; frames every {interval:.3g} ps would tell" if np.isfinite(interval) else ""
    return (
        f"on straight paths {what} at {place}; undersampled: {motion}, beyond the resolution length "
        f"{crossing.resolution:.3g} Å, so that it may be a detour{cure}"
    )


def _in_order(alerts: list[tuple[int, Alert]]) -> Iterator[Alert]:
    """Yield alerts by the step at which they are due, and by id within a step."""
    for _, alert in sorted(alerts, key=lambda pair: (pair[0], pair[1].id)):
        yield alert


def _when(event: Event) -> str:
    if event.first.kind is AlertKind.GAP:
        return ""
    steps, frames = (event.first.step, event.last.step), (event.first.frames[0], event.last.frames[1])
    span = f"Step {steps[0]}" if steps[0] == steps[1] else f"Steps {steps[0]}-{steps[1]}"
    peak = f", worst at step {event.peak.step}" if steps[0] != steps[1] else ""
    start, end = event.first.times[0], event.last.times[1]
    clock = f", {start:g}-{end:g} ps" if np.isfinite(start) and np.isfinite(end) else ""
    return f"{span} (frames {frames[0]}-{frames[1]}{clock}{peak}): "
