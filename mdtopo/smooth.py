"""The smooth curve that goes with the strands of a frame."""

from typing import Literal, TypeAlias, get_args

import numpy as np

from mdtopo.errors import InputError, OptionError, StrandError
from mdtopo.geometry.bezier import elevate
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.splines import (
    BSPLINE,
    CATMULL_ROM,
    CONTROL_ERROR,
    HIGHEST_DEGREE,
    INTERPOLATING,
    interpolation_weights,
    spline_controls,
)
from mdtopo.records import CompositeBezier, Strands, Traces
from mdtopo.typing import Points

CurveKind: TypeAlias = Literal["interpolating", "bspline", "catmull-rom", "bezier", "bezier-through"]

CUBICS = {"interpolating": INTERPOLATING, "bspline": BSPLINE, "catmull-rom": CATMULL_ROM}

HIGHEST_THROUGH = 20
"""Of one Bezier curve through all vertices: its weights grow like 2ⁿ, and with them the error of a vertex."""


def spline_curve(x: Points, strands: Strands, kind: CurveKind = "interpolating") -> CompositeBezier:
    """Return the smooth curve of the strands in one frame; its control points are linear in the positions.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions, Å; strands whole.
    strands : Strands
        Which vertices form which strand.
    kind : str
        'interpolating' (C² cubic through the vertices, uniform parameters, natural ends, periodic in rings), 'bspline'
        (cubic, vertices as control points), 'catmull-rom', 'bezier' (one curve of degree n for each strand, on its
        vertices: the paper's own) or 'bezier-through' (one through them). The first three have one segment for each
        edge, in the order of `Strands.edges`.

    Raises
    ------
    InputError
        If positions do not fit or are not finite, or two consecutive vertices coincide.
    StrandError
        If a strand has too few vertices, or too many for a single Bezier curve.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    >>> spline_curve(square, Strands.from_lengths([4], closed=True)).control_points[0].round(12).tolist()
    [[0.0, 0.0, 0.0], [0.25, -0.25, 0.0], [0.75, -0.25, 0.0], [1.0, 0.0, 0.0]]
    """
    if kind not in get_args(CurveKind):
        raise OptionError(f"The kind of curve is {kind!r}; it must be one of: {', '.join(get_args(CurveKind))}.")
    positions = np.ascontiguousarray(x, dtype=np.float64)
    if positions.shape != (strands.n_vertices, 3) or not np.isfinite(positions).all():
        raise InputError(
            f"Positions must be finite and of shape ({strands.n_vertices}, 3); theirs is {positions.shape}."
        )
    _refuse_coincident(positions, strands)
    greatest = float(np.abs(positions).max())
    if kind in CUBICS:
        traces = Traces.of(strands)
        points = np.empty((len(traces.edges), 4, 3))
        spline_controls(positions, traces.vertices, traces.offsets, traces.closed, CUBICS[kind], points)
        offsets = np.concatenate([[0], np.cumsum(np.diff(strands.offsets) - ~strands.closed)])
        return CompositeBezier(points, offsets, strands.closed, error=CONTROL_ERROR * greatest)
    return _single_segments(positions, strands, through=kind == "bezier-through", greatest=greatest)


def _refuse_coincident(x: Points, strands: Strands) -> None:
    edges = strands.edges
    same = (x[edges[:, 0]] == x[edges[:, 1]]).all(axis=1)
    if same.any():
        a, b = edges[same][0].tolist()
        raise InputError(
            f"Vertices {a} and {b} follow each other and coincide at {x[a].tolist()}; a smooth curve needs "
            "vertices that differ, so leave one of them out."
        )


def _single_segments(x: Points, strands: Strands, *, through: bool, greatest: float) -> CompositeBezier:
    highest = HIGHEST_THROUGH if through else HIGHEST_DEGREE
    curves, error = [], 0.0
    for s, closed in enumerate(strands.closed):
        points = x[strands.offsets[s] : strands.offsets[s + 1]]
        if closed:
            points = np.concatenate([points, points[:1]])
        n = len(points) - 1
        if n > highest:
            where = "through" if through else "on"
            raise StrandError(
                f"Strand {strands.names[s]!r} has {len(points) - closed} vertices; one Bezier curve {where} its "
                f"vertices can have the degree {highest} at most. Choose a spline."
            )
        if through:
            weights = interpolation_weights(n)
            first, last = points[0], points[-1]
            points = weights @ points
            points[0], points[-1] = first, last
            error = max(error, 4.0 * (n + 2) * UNIT_ROUNDOFF * greatest * float(np.abs(weights).sum(axis=1).max()))
        curves.append(points)
    degree = max(len(points) for points in curves) - 1
    # each elevation is a convex combination, rounded a few times
    elevations = degree + 1 - min(len(points) for points in curves)
    error += (1.0 + error / max(greatest, 1e-300)) * 8.0 * UNIT_ROUNDOFF * greatest * elevations
    segments = np.stack([elevate(np.ascontiguousarray(points), degree) for points in curves])
    return CompositeBezier(segments, np.arange(len(curves) + 1), strands.closed, error=error)
