"""The smooth curve near an event: places on it whose straight motion is the motion of the curve itself.

Control points are linear in the vertices, so a place at a fixed parameter moves straight when the vertices do, and two
rows of places, one for each end of the step, give the curve at every time between them.
"""

from typing import NamedTuple

import numpy as np

from mdtopo.geometry.bezier import evaluate
from mdtopo.records import CompositeBezier, Strands
from mdtopo.smooth import CurveKind, spline_curve
from mdtopo.typing import Indices, Points, Ratios


class CurvePath(NamedTuple):
    """Consecutive places on the curve of one strand at both ends of the step, Å; drawn, never a certificate."""

    strand: str
    x0: Points
    x1: Points


def trace_curves(x0: Points, x1: Points, *, closed: bool, kind: CurveKind) -> tuple[CompositeBezier, CompositeBezier]:
    """Return the curve of one trace at both ends of a step.

    Raises
    ------
    InputError, StrandError
        If it has none, see `spline_curve`.
    """
    alone = Strands.from_lengths([len(x0)], closed=closed)
    return spline_curve(x0, alone, kind), spline_curve(x1, alone, kind)


def places(curve: CompositeBezier, n_edges: int, run: Indices, parts: Indices) -> Points:
    """Return the places on the curve of one trace along a run of its vertices, shape (sum of parts + 1, 3), Å.

    Parameters
    ----------
    curve : CompositeBezier
        With one segment for each edge, or one for the whole trace: its parameter gives every edge an equal share.
    n_edges : int
        Edges of the trace.
    run : ndarray of int, shape (k,)
        Positions of consecutive vertices in the trace; a ring's run may wrap around.
    parts : ndarray of int, shape (k - 1,)
        Into how many chords the arc of each edge is cut.

    Examples
    --------
    >>> x = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    >>> curve = spline_curve(x, Strands.from_lengths([3]))
    >>> places(curve, 2, np.array([0, 1, 2]), np.array([1, 2]))[:, 0].round(3).tolist()
    [0.0, 1.0, 1.906, 3.0]
    """
    found: list[Points] = []
    for tail, count in zip(run[:-1].tolist(), parts.tolist(), strict=True):
        arc = arc_places(curve, n_edges, tail, np.arange(count + 1) / count)
        found.append(arc[: None if len(found) == len(parts) - 1 else -1])
    return np.concatenate(found)


def arc_places(curve: CompositeBezier, n_edges: int, tail: int, shares: Ratios) -> Points:
    """Return places on the arc of the edge that begins at position `tail` of its trace, shape (len(shares), 3), Å.

    Shares go from 0 to 1 along the arc; a curve of one segment gives each edge an equal share of its parameter.
    """
    if curve.n_segments == n_edges:
        return evaluate(curve.control_points[tail], shares)
    return evaluate(curve.control_points[0], (tail + shares) / n_edges)
