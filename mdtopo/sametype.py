"""Whether the smooth curve that is drawn through strands has the strands' own type, at one frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.arcs import BezierArc
from mdtopo.errors import InputError
from mdtopo.polyline import checked_positions, polyline_step
from mdtopo.records import CompositeBezier, Isotopy, MonitorConfig, Strands, Verdict
from mdtopo.smooth import CurveKind, spline_curve
from mdtopo.tubes import radius_bounds
from mdtopo.typing import Points

MOST_PARTS = 64
"""Chords for each edge that are tried; a curve that needs more comes within 1e-3 of an edge length of itself."""

ROUNDING = 1e-9
"""Clearance that the motion must keep, as a multiple of the greatest coordinate; rounding moves places by 1e-15."""


@dataclass(frozen=True, slots=True)
class SameType:
    """Whether a smooth curve is ambient isotopic to the polyline of its strands.

    Attributes
    ----------
    isotopy : Isotopy
        By which argument, or `NOT_KNOWN`: which does not say that the types differ.
    reason : str
        The argument with its numbers, or what it lacks.
    distance : float
        A bound of the distance of the curve and the polyline that has its type by the tube, Å.
    """

    isotopy: Isotopy
    reason: str
    distance: float

    def __str__(self) -> str:
        """Return the statement as one sentence."""
        if self.isotopy is Isotopy.NOT_KNOWN:
            return f"It is not known whether the drawn curve has the strands' own type: {self.reason}."
        return f"The drawn curve has the strands' own type: {self.reason}."


def same_type(x: Points, strands: Strands, kind: CurveKind = "interpolating") -> SameType:
    """Return whether the smooth curve of a frame has the type of the strands' polyline, and by which argument.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions of one frame, strands whole, Å.
    strands : Strands
        Which vertices form which strand.
    kind : str
        The curve, see `spline_curve`.

    Guarantee
    ---------
    Proven, for the curve with the control points as computed. `TUBE`: every edge lies in the tube about the curve and
    makes acute angles with the tangents of its arc (Jordan et al. 2008, sections 4-6; see `approximate`). `HOMOTOPY`: a
    finer polyline with its vertices on the curve does, and its step to the same places on the edges is certified
    (`polyline_step`) with a clearance far above the rounding of those places. Periodic images are not looked at.

    Raises
    ------
    InputError, StrandError
        See `spline_curve`.

    Examples
    --------
    >>> angles = np.arange(12) * np.pi / 6
    >>> ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    >>> same_type(ring, Strands.from_lengths([12], closed=True)).isotopy.name
    'TUBE'
    """
    x = checked_positions(x, strands, "x")
    curve = spline_curve(x, strands, kind)
    if curve.n_segments != len(strands.edges):
        return SameType(Isotopy.NOT_KNOWN, "the curve has not one segment for each edge", np.inf)
    arcs = [BezierArc.of(curve, strand) for strand in range(len(curve.closed))]
    parts, distance, least, most = 1, np.inf, 0.0, np.inf
    try:
        while parts <= MOST_PARTS:
            chords = [arc.chords(_ends(arc, parts)) for arc in arcs]
            distance = max(float(found[0].max()) for found in chords)
            if least <= distance < most:
                least, most = radius_bounds(curve, distance)
            if distance < least and all(found[1].all() for found in chords):
                break
            parts *= 2
        else:
            lacking = f"no polyline of {MOST_PARTS} chords for each edge is seen in the tube of radius {most:.4g} Å"
            return SameType(Isotopy.NOT_KNOWN, lacking, distance)
    except InputError as problem:
        return SameType(Isotopy.NOT_KNOWN, f"the curve has no tube ({str(problem).rstrip('.')})", np.inf)
    if parts == 1 and _passes_through(curve, x, strands):
        words = (
            f"all edges run along it, within {distance:.4g} Å of the curve, whose tube has the radius {least:.4g} Å or "
            "more"
        )
        return SameType(Isotopy.TUBE, words, distance)
    return _moved(arcs, x, strands, parts, distance)


def _ends(arc: BezierArc, parts: int) -> NDArray[np.float64]:
    """Return the ends of the chords when each segment has so many (a power of 2, so that they are exact)."""
    return np.arange(len(arc.segments) * parts + 1) / parts


def _moved(arcs: list[BezierArc], x: Points, strands: Strands, parts: int, distance: float) -> SameType:
    """Return what the motion from the finer polyline to the edges proves."""
    share = np.arange(parts) / parts
    on_curve, on_edges = [], []
    first = 0
    for arc, closed in zip(arcs, strands.closed, strict=True):
        edges = strands.edges[first : first + len(arc.segments)]
        a, b = x[edges[:, 0], None], x[edges[:, 1], None]
        straight = ((1.0 - share)[:, None] * a + share[:, None] * b).reshape(-1, 3)
        on_curve.append(arc.points(_ends(arc, parts)[: -1 if closed else None]))
        on_edges.append(straight if closed else np.concatenate([straight, b[-1]]))
        first += len(arc.segments)
    fine = Strands.from_lengths([len(points) for points in on_curve], closed=strands.closed.tolist())
    end = np.concatenate(on_edges)
    report = polyline_step(np.concatenate(on_curve), end, fine, config=MonitorConfig(motion="lab"))
    how = f"a polyline of {parts} chords for each edge, which has the curve's type by its tube"
    if report.verdict is not Verdict.CERTIFIED or not report.clearance > ROUNDING * float(np.abs(end).max()):
        return SameType(Isotopy.NOT_KNOWN, f"{how}, is not seen to move to the edges without a passage", distance)
    words = f"{how}, moves to the edges with {report.clearance:.4g} Å to spare"
    return SameType(Isotopy.HOMOTOPY, words, distance)


def _passes_through(curve: CompositeBezier, x: Points, strands: Strands) -> bool:
    ends = np.stack([curve.control_points[:, 0], curve.control_points[:, -1]], axis=1)
    return bool(np.array_equal(ends, x[strands.edges]))
