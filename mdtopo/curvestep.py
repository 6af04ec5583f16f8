"""The certificate of a smooth curve: of one that stands still, and of one that moves linearly to another."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mdtopo.curveladder import CurveMeasure, measure_curve
from mdtopo.errors import InputError
from mdtopo.geometry.bezier import part
from mdtopo.geometry.curvemeeting import place_in_space
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.records import CompositeBezier, CurveCrossing, CurvePlace, CurveReport, Grade, Rung, Verdict
from mdtopo.typing import BezierPoints, Indices

RING_MINIMUM = 3
"""Segments of a ring, so that two of them meet at one joint at most; shorter rings are cut into four or more parts."""

LAB = np.zeros((3, 3))


class Layout(NamedTuple):
    """The segments that are measured: parts of the curve's own ones, where a ring has fewer than three of these.

    `source`, `low` and `width` tell of each part which segment it is of, where it begins there, and how long it is.
    """

    following: Indices
    source: Indices
    low: NDArray[np.float64]
    width: NDArray[np.float64]


def curve_step(curve_t0: CompositeBezier, curve_t1: CompositeBezier) -> CurveReport:
    """Return what is proved of a curve whose control points move linearly from one curve's to another's.

    Parameters
    ----------
    curve_t0, curve_t1 : CompositeBezier
        The curve at the start and the end, with the same strands, segments and degree.

    Raises
    ------
    InputError
        If the two do not fit.

    Notes
    -----
    No rigid motion is taken out. Jordan et al. (2008), section 3, with Prop. 3.2 corrected: see `CurveReport`.

    Guarantee
    ---------
    Proven, rounding and the curves' `error` included. CERTIFIED: no two points of the curve meet at any time, and it
    has a tangent everywhere. CROSSING: each crossing that is listed is one, of the linear motion; unless `n_open` is 0
    there may be more.

    Examples
    --------
    Two straight bars, one passes through the other half way:

    >>> bars = np.array([[[-1, 0, 0], [1, 0, 0]], [[0, -1, 1], [0, 1, 1]]], dtype=float)
    >>> moved = bars - np.array([0, 0, 2.0]) * np.array([0, 1])[:, None, None]
    >>> start, end = (CompositeBezier.from_control_points(p, lengths=[1, 1]) for p in (bars, moved))
    >>> report = curve_step(start, end)
    >>> report.verdict.name, round(report.crossings[0].t, 12), report.crossings[0].sign
    ('CROSSING', 0.5, 1)
    """
    _check_match(curve_t0, curve_t1)
    layout = layout_of(curve_t0)
    c0, c1 = (parts_of(curve.control_points, layout) for curve in (curve_t0, curve_t1))
    greatest = max(float(np.abs(points).max()) for points in (c0, c1))
    # cutting a ring rounds each point a few times for each degree
    cut = 16.0 * (curve_t0.degree + 2) * UNIT_ROUNDOFF * greatest if (layout.width != 1.0).any() else 0.0
    slack = max(curve_t0.error, curve_t1.error) + cut
    measure = measure_curve(c0, c1, layout.following, LAB, LAB, False, slack)
    return _report(measure, layout, c0, c1, curve_t0)


def curve_embedding(curve: CompositeBezier) -> CurveReport:
    """Return what is proved of a curve that stands still: CERTIFIED where it nowhere meets itself.

    Guarantee
    ---------
    Proven: see `curve_step`, with no motion. A curve that does meet itself is UNRESOLVED, with the place.
    """
    return curve_step(curve, curve)


def _check_match(one: CompositeBezier, other: CompositeBezier) -> None:
    if one.control_points.shape != other.control_points.shape:
        raise InputError(
            f"The curves have control points of shape {one.control_points.shape} and {other.control_points.shape}; a "
            "step joins two curves with the same segments."
        )
    if not np.array_equal(one.offsets, other.offsets) or not np.array_equal(one.closed, other.closed):
        raise InputError("The two curves have different strands; a step joins two curves with the same ones.")


def layout_of(curve: CompositeBezier) -> Layout:
    """Return how a curve is laid out for the kernels, short rings cut."""
    source: list[int] = []
    following: list[int] = []
    low: list[float] = []
    width: list[float] = []
    for s, closed in enumerate(curve.closed):
        segments = range(int(curve.offsets[s]), int(curve.offsets[s + 1]))
        pieces = -(-4 // len(segments)) if closed and len(segments) < RING_MINIMUM else 1
        first = len(source)
        for segment in segments:
            for k in range(pieces):
                source.append(segment)
                low.append(k / pieces)
                width.append(1.0 / pieces)
                following.append(len(source))
        following[-1] = first if closed else -1
    return Layout(np.array(following), np.array(source), np.array(low), np.array(width))


def parts_of(points: BezierPoints, layout: Layout) -> BezierPoints:
    """Return the control points of the parts; neighbours share their joint bit for bit."""
    if len(layout.source) == len(points):
        return points
    parts = np.stack(
        [
            part(points[segment], low, low + width) if width < 1.0 else points[segment]
            for segment, low, width in zip(layout.source, layout.low, layout.width, strict=True)
        ]
    )
    here = np.flatnonzero(layout.following >= 0)
    parts[layout.following[here], 0] = parts[here, -1]
    return parts


def _report(m: CurveMeasure, layout: Layout, c0: BezierPoints, c1: BezierPoints, curve: CompositeBezier) -> CurveReport:
    crossings = tuple(_crossings(m, layout, c0, c1, curve))
    certified = m.rung != Rung.OPEN and not crossings
    verdict = Verdict.CROSSING if crossings else (Verdict.CERTIFIED if certified else Verdict.UNRESOLVED)
    first, second = (int(layout.source[k]) if k >= 0 else -1 for k in m.pair)
    return CurveReport(
        verdict=verdict,
        rung=Rung(m.rung),
        depth=m.depth,
        d_star=m.d_star,
        d_star_segment=int(layout.source[m.d_star_segment]),
        bezier_ratio=m.bezier_ratio,
        bezier_margin=m.bezier_margin,
        printed_ratio=m.printed_ratio,
        clearance=m.clearance,
        pair=(first, second),
        n_open=m.n_open,
        place=_place(m, layout) if m.n_open else None,
        crossings=crossings,
    )


def _along(layout: Layout, piece: int, u: float) -> float:
    """Return a parameter of a part as one of the segment that it is of."""
    return float(layout.low[piece] + u * layout.width[piece])


def _place(m: CurveMeasure, layout: Layout) -> CurvePlace:
    i, j = m.pair.tolist()
    box = m.place.tolist()
    return CurvePlace(
        (int(layout.source[i]), int(layout.source[j])),
        (box[0], box[1]),
        (_along(layout, i, box[2]), _along(layout, i, box[3])),
        (_along(layout, j, box[4]), _along(layout, j, box[5])),
    )


def _crossings(
    m: CurveMeasure, layout: Layout, c0: BezierPoints, c1: BezierPoints, curve: CompositeBezier
) -> list[CurveCrossing]:
    changed = _linked_anew(m, layout, curve)
    strands = curve.strand_of_segment[layout.source]
    found = []
    for row in m.found[np.argsort(m.found[:, 5], kind="stable")]:
        i, j = int(row[0]), int(row[1])
        t, u, v = row[5:8].tolist()
        grade = Grade.RESOLVED if row[9] < row[10] else Grade.UNDERSAMPLED
        if _pair(strands, i, j) in changed:
            grade = Grade.PROVEN
        found.append(
            CurveCrossing(
                t=t,
                segments=(int(layout.source[i]), int(layout.source[j])),
                parameters=(_along(layout, i, u), _along(layout, j, v)),
                point=np.array(place_in_space(c0[i], c1[i], t, u)),
                sign=int(row[8]),
                grade=grade,
                motion=float(row[9]),
                resolution=float(row[10]),
            )
        )
    return found


def _pair(strands: Indices, i: int, j: int) -> tuple[int, int]:
    a, b = int(strands[i]), int(strands[j])
    return min(a, b), max(a, b)


def _linked_anew(m: CurveMeasure, layout: Layout, curve: CompositeBezier) -> set[tuple[int, int]]:
    """Return the pairs of closed strands whose linking number differs between the two ends.

    It changes by the sum of the signs of their passages, once all of these are known: that is, if nothing is open.
    """
    if m.n_open:
        return set()
    strands, sums = curve.strand_of_segment[layout.source], Counter[tuple[int, int]]()
    for row in m.found:
        a, b = _pair(strands, int(row[0]), int(row[1]))
        if a != b and curve.closed[a] and curve.closed[b]:
            sums[a, b] += int(row[8])
    return {pair for pair, total in sums.items() if total}
