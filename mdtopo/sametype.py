"""Whether the smooth curve that is drawn through strands has the strands' own type, at one frame."""

from dataclasses import dataclass

import numpy as np

from mdtopo.arcs import BezierArc
from mdtopo.errors import InputError
from mdtopo.records import CompositeBezier, Isotopy, Strands
from mdtopo.smooth import CurveKind, spline_curve
from mdtopo.tubes import tube
from mdtopo.typing import Flags, Lengths, Points


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
        A bound of the distance of curve and polyline, Å; infinite where the curve does not pass through the vertices.
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
    Proven: `TUBE` is said only where every edge lies in the tube about the curve and makes acute angles with the
    tangents of its arc (Jordan et al. 2008, sections 4-6; see `approximate`). It holds for the curve with
    the control points as computed. A curve that does not pass through its vertices is `NOT_KNOWN`.

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
    curve = spline_curve(x, strands, kind)
    if curve.n_segments != len(strands.edges) or not _passes_through(curve, x, strands):
        return SameType(Isotopy.NOT_KNOWN, "the curve does not pass through the vertices", np.inf)
    distances, along = _edges_beside(curve)
    distance = float(distances.max())
    try:
        radius = tube(curve).radius
    except InputError as problem:
        return SameType(Isotopy.NOT_KNOWN, f"the curve has no tube ({str(problem).rstrip('.')})", distance)
    numbers = f"within {distance:.4g} Å of the curve, whose tube has the radius {radius:.4g} Å"
    if not distance < radius:
        return SameType(Isotopy.NOT_KNOWN, f"the edges are only {numbers}", distance)
    if not along.all():
        edge = strands.describe_edge(strands.edges[int(np.flatnonzero(~along)[0])])
        return SameType(Isotopy.NOT_KNOWN, f"the curve turns too far from the edge {edge}", distance)
    return SameType(Isotopy.TUBE, f"all edges run along it, {numbers}", distance)


def _passes_through(curve: CompositeBezier, x: Points, strands: Strands) -> bool:
    ends = np.stack([curve.control_points[:, 0], curve.control_points[:, -1]], axis=1)
    return bool(np.array_equal(ends, np.asarray(x, dtype=np.float64)[strands.edges]))


def _edges_beside(curve: CompositeBezier) -> tuple[Lengths, Flags]:
    """Return how far each edge is from its arc, Å, and whether the arc runs along it; in the order of the segments."""
    arcs = [BezierArc.of(curve, strand) for strand in range(len(curve.closed))]
    found = [arc.chords(arc.edges) for arc in arcs]
    return np.concatenate([one[0] for one in found]), np.concatenate([one[1] for one in found])
