"""What is said aloud of the smooth curve: steps in which it passes or is undecided, and the polyline has not said so.

Nearly always the curve passes where the polyline does. Then the polyline's alert stands for both: one event, one alert.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mdtopo.records import AlertKind, Crossing, Crossings, CurveVerdict, Grade, Reason, StepTable, Strands, Verdict
from mdtopo.typing import Indices

NEAR = 2
"""A crossing of the curve is that of the polyline when both have the same sign, and its two segments lie within so
many vertices of the two edges: between vertices, the curve strays from the edges by a fraction of their length."""

CURVE_UNDECIDED = {
    Reason.FOLD: "the smooth curve may have a cusp, or fold back on itself",
    Reason.LADDER: "no halving settles whether two segments of the smooth curve meet",
    Reason.CELL: "the images that segments of the smooth curve may meet cannot be counted",
}


class CurveFinding(NamedTuple):
    """What is to be said of one step; see `mdtopo.alerts.Finding`."""

    row: int
    kind: AlertKind
    vertices: tuple[int, ...]
    badness: float
    value: float | None
    limit: float | None
    detail: str


def curve_findings(table: StepTable, strands: Strands) -> Iterator[CurveFinding]:
    """Yield what is to be said of the curve, one finding for a step at most.

    Crossings that the polyline has too are left out (`NEAR`), and so are undecided steps that are not certified for the
    polyline: these have alerts of their own.
    """
    for row in np.flatnonzero(table.curve_verdict == CurveVerdict.CROSSING):
        step = table.first_step + int(row)
        own = own_crossings(table.curve_crossings.of_step(step), table.crossings.of_step(step), strands)
        if own:
            yield _passes(int(row), own)
    undecided = (table.curve_verdict == CurveVerdict.UNRESOLVED) & (table.verdict == Verdict.CERTIFIED)
    for row in np.flatnonzero(undecided):
        yield _undecided(table, int(row), strands)


def own_crossings(of_curve: Crossings, of_polyline: Crossings, strands: Strands) -> list[Crossing]:
    """Return the crossings of the curve in a step for which the polyline has none nearby."""
    left = list(of_polyline)
    own = []
    for crossing in of_curve:
        match = next((other for other in left if _is_same_event(crossing, other, strands)), None)
        if match is None:
            own.append(crossing)
        else:
            left.remove(match)
    return own


def _is_same_event(crossing: Crossing, other: Crossing, strands: Strands) -> bool:
    if crossing.sign != other.sign:
        return False
    orders = (other.edges, other.edges[::-1])
    return any(all(_are_near(a, b, strands) for a, b in zip(crossing.edges, order, strict=True)) for order in orders)


def _are_near(one: Indices, other: Indices, strands: Strands) -> bool:
    a, b = int(one[0]), int(other[0])
    strand = int(strands.strand_of_vertex[a])
    if strand != strands.strand_of_vertex[b]:
        return False
    apart, length = abs(a - b), int(strands.offsets[strand + 1] - strands.offsets[strand])
    return min(apart, length - apart if strands.closed[strand] else apart) <= NEAR


def _passes(row: int, own: list[Crossing]) -> CurveFinding:
    worst = max(own, key=lambda crossing: (crossing.grade, -crossing.motion / max(crossing.resolution, 1e-300)))
    first, second = worst.strands
    more = f", and {len(own) - 1} more in this step" if len(own) > 1 else ""
    grade = {
        Grade.PROVEN: "proven: the linking number of the two curves changes between the frames",
        Grade.RESOLVED: f"resolved: its segments move {worst.motion:.3g} Å relative to each other",
        Grade.UNDERSAMPLED: f"undersampled: its segments move {worst.motion:.3g} Å relative to each other",
    }[worst.grade]
    detail = (
        f"the smooth curve of {first} passes through {'itself' if first == second else f'that of {second}'} at "
        f"{worst.residues[0]} x {worst.residues[1]}, t = {worst.t:.6g} of the step, sign {worst.sign:+d}{more}, where "
        f"the polyline has no crossing in the same step; {grade}"
    )
    vertices = tuple(worst.edges.ravel().tolist())
    badness = worst.grade + worst.resolution / (worst.resolution + worst.motion)  # the surer, the worse
    return CurveFinding(row, AlertKind.CROSSING, vertices, badness, worst.motion, worst.resolution, detail)


def _undecided(table: StepTable, row: int, strands: Strands) -> CurveFinding:
    reason, pair = Reason(int(table.curve_reason[row])), table.curve_clearance_pair[row]
    detail = f"undecided for the curve alone: {CURVE_UNDECIDED.get(reason, CURVE_UNDECIDED[Reason.LADDER])}"
    if (pair >= 0).all():
        low, high = table.curve_place[row, 0]
        when = f", t = {low:.4g}" + (f" to {high:.4g}" if high - low > 1e-4 else "") if np.isfinite(low) else ""
        detail += f" ({strands.describe_pair(pair)}{when})"
    vertices = tuple(pair.ravel().tolist())
    return CurveFinding(row, AlertKind.UNRESOLVED, vertices, 0.0, None, None, detail)
