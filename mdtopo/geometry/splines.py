"""From vertices to the control points of a smooth curve, in the uniform parametrisation.

Every map here is linear in the vertices, and the same for each frame; so vertices that move linearly move the control
points linearly, and one frame's splines are certified by the motion of their control points. That is why the
parametrisation is uniform: with chord lengths as parameters the map would differ from frame to frame.

========================  ==============================================  ==========================================
kind                      one cubic for each edge, from x_i to x_(i+1)    an error η of the vertices moves a control
                                                                          point by at most
========================  ==============================================  ==========================================
interpolating             C² through all vertices, natural at open ends   1 + 2/√3 = 2.155 η
B-spline                  C², the vertices are its control points; open   1 η
                          ends are met, without curvature
Catmull-Rom               C¹ through all vertices                         4/3 η
========================  ==============================================  ==========================================

The fourth kind is one Bezier curve for a whole strand: on its vertices (they are the control points) or through them.
"""

from fractions import Fraction
from functools import cache
from math import comb

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.bezier import elevate, part
from mdtopo.geometry.distances import UNIT_ROUNDOFF

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

INTERPOLATING, BSPLINE, CATMULL_ROM = 0, 1, 2

RING_PARTS = 4
"""A ring that is one segment is cut into so many, so that two of them share one joint at most."""

HIGHEST_DEGREE = 200
"""Of one Bezier curve on all vertices: such curves stay ever further from their vertices, and cost n² each time."""

CONTROL_ERROR = 512.0 * UNIT_ROUNDOFF
"""Rounding of a computed control point, as a multiple of the greatest coordinate of its strand.

The system of the interpolating spline is diagonally dominant with an inverse of norm 1/2 (at most 1 with natural ends).
Elimination solves a system whose entries are off by less than 24u of a row sum of 6, for slopes that are at most the
greatest coordinate: less than 144u. Right-hand side and sums add 4u, the correction that closes a ring as much again as
the solution: less than 300u per component, and less than 512u in length.
"""

AMPLIFICATION = (2.155, 1.0, 4.0 / 3.0)
"""How many times the error of a vertex a control point is off at most, by kind: the sum of the magnitudes of its
weights. For the interpolating spline 1 + 2/√3 bounds it; the sum itself is √3."""


@njit(cache=True, nogil=True)
def spline_controls(
    x: FloatArray, vertices: IntArray, offsets: IntArray, closed: BoolArray, kind: int, out: FloatArray
) -> None:
    """Write the control points of one cubic for each edge.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions, Å.
    vertices, offsets, closed : ndarray
        Trace g visits ``vertices[offsets[g]:offsets[g + 1]]``; see `mdtopo.records.Traces`. A trace of one vertex has
        no edge, one of two a straight one.
    kind : int
        INTERPOLATING, BSPLINE or CATMULL_ROM.
    out : ndarray, shape (n_edges, 4, 3)
        Filled in the order of the edges. Neighbouring segments share their end point bit for bit.
    """
    first = 0
    longest = 0
    for g in range(len(closed)):
        longest = max(longest, offsets[g + 1] - offsets[g])
    points, slopes, work = np.empty((longest, 3)), np.empty((longest, 3)), np.empty((longest, 2))
    for g in range(len(closed)):
        n = offsets[g + 1] - offsets[g]
        for k in range(n):
            i = vertices[offsets[g] + k]
            points[k, 0], points[k, 1], points[k, 2] = x[i, 0], x[i, 1], x[i, 2]
        if n < 2:
            continue
        n_edges = n if closed[g] else n - 1
        if kind == INTERPOLATING:
            _interpolating_slopes(points[:n], closed[g], slopes, work)
        else:
            _central_slopes(points[:n], closed[g], slopes)
        _write_segments(points, slopes, n, n_edges, kind, out[first : first + n_edges])
        first += n_edges


@njit(cache=True, nogil=True)
def _central_slopes(x: FloatArray, closed: bool, slopes: FloatArray) -> None:
    """Write a sixth of x_(i+1) - x_(i-1); beyond an open end the strand goes on straight."""
    n = len(x)
    for i in range(n):
        before, after = max(i - 1, 0), min(i + 1, n - 1)
        share = 1.0 / 6.0
        if closed:
            before, after = (i - 1) % n, (i + 1) % n
        elif i in (0, n - 1):
            share = 1.0 / 3.0
        for axis in range(3):
            slopes[i, axis] = share * (x[after, axis] - x[before, axis])


@njit(cache=True, nogil=True)
def _interpolating_slopes(x: FloatArray, closed: bool, slopes: FloatArray, work: FloatArray) -> None:
    """Write a third of the C² spline's derivative at each vertex: s_(i-1) + 4 s_i + s_(i+1) = x_(i+1) - x_(i-1).

    Open ends are natural: 2 s_0 + s_1 = x_1 - x_0. A ring's cyclic system is the open one, with 3 and 3 at its corners,
    and a correction of rank one (Sherman and Morrison).
    """
    n = len(x)
    corner = 3.0 if closed else 2.0
    above = 0.0  # of the row before, scaled to s_(i-1) + above·s_i
    for i in range(n):
        before, after = i - 1, i + 1
        if closed:
            before, after = before % n, after % n
        else:
            before, after = max(before, 0), min(after, n - 1)
        inverse = 1.0 / ((corner if i in (0, n - 1) else 4.0) - above)
        for axis in range(3):
            carried = slopes[i - 1, axis] if i > 0 else 0.0
            slopes[i, axis] = inverse * (x[after, axis] - x[before, axis] - carried)
        work[i, 1] = inverse * ((1.0 if i in (0, n - 1) else 0.0) - (work[i - 1, 1] if i > 0 else 0.0))
        work[i, 0] = above = inverse
    for i in range(n - 2, -1, -1):
        for axis in range(3):
            slopes[i, axis] -= work[i, 0] * slopes[i + 1, axis]
        work[i, 1] -= work[i, 0] * work[i + 1, 1]
    if closed:
        # the cyclic matrix is the open one plus e·eᵀ with e = (1, 0, …, 0, 1); work holds what the open one makes of e
        share = 1.0 / (1.0 + work[0, 1] + work[n - 1, 1])
        for axis in range(3):
            excess = share * (slopes[0, axis] + slopes[n - 1, axis])
            for i in range(n):
                slopes[i, axis] -= excess * work[i, 1]


@njit(cache=True, nogil=True)
def _write_segments(x: FloatArray, slopes: FloatArray, n: int, n_edges: int, kind: int, out: FloatArray) -> None:
    for k in range(n_edges):
        after = k + 1 if k + 1 < n else 0
        for axis in range(3):
            p, q, s, r = x[k, axis], x[after, axis], slopes[k, axis], slopes[after, axis]
            if kind == BSPLINE:
                out[k, 1, axis], out[k, 2, axis] = (2.0 * p + q) / 3.0, (p + 2.0 * q) / 3.0
            else:
                out[k, 0, axis], out[k, 1, axis], out[k, 2, axis], out[k, 3, axis] = p, p + s, q - r, q
    if kind == BSPLINE:
        closed = n_edges == n
        for k in range(n_edges):
            for axis in range(3):
                if k > 0 or closed:
                    before = k - 1 if k > 0 else n_edges - 1
                    joint = 0.5 * (out[before, 2, axis] + out[k, 1, axis])
                    out[before, 3, axis] = out[k, 0, axis] = joint
        if not closed:
            for axis in range(3):
                out[0, 0, axis], out[n_edges - 1, 3, axis] = x[0, axis], x[n - 1, axis]


@njit(cache=True, nogil=True)
def single_controls(x: FloatArray, vertices: IntArray, offsets: IntArray, closed: BoolArray, out: FloatArray) -> None:
    """Write the control points of one Bezier curve for each trace, its vertices being the control points.

    Parameters
    ----------
    x, vertices, offsets, closed : ndarray
        See `spline_controls`.
    out : ndarray, shape (n_segments, degree + 1, 3)
        Filled trace by trace: one segment, or of a ring `RING_PARTS`; none for a trace of one vertex. The degree is at
        least that of the longest trace, and the others are elevated to it. Neighbours share their joint bit for bit.
    """
    degree, k = out.shape[1] - 1, 0
    for g in range(len(closed)):
        n = offsets[g + 1] - offsets[g]
        if n < 2:
            continue
        points = np.empty((n + 1 if closed[g] else n, 3))
        for i in range(len(points)):
            points[i] = x[vertices[offsets[g] + (i if i < n else 0)]]
        raised = elevate(points, degree)
        if not closed[g]:
            out[k] = raised
            k += 1
            continue
        for p in range(RING_PARTS):
            out[k + p] = part(raised, p / RING_PARTS, (p + 1) / RING_PARTS)
            if p > 0:
                out[k + p, 0] = out[k + p - 1, degree]
        out[k, 0] = out[k + RING_PARTS - 1, degree]
        k += RING_PARTS


def single_error(lengths: IntArray, closed: BoolArray) -> float:
    """Return the rounding of `single_controls`, as a multiple of the greatest coordinate.

    Each elevation is a convex combination, rounded a few times; cutting a ring averages `degree` times, twice.
    """
    points = (lengths + closed)[lengths > 1]
    if not len(points):
        return 0.0
    elevations, degree = int(points.max() - points.min()), int(points.max()) - 1
    return UNIT_ROUNDOFF * (8.0 * elevations + (16.0 * (degree + 2) if closed.any() else 0.0))


@cache
def interpolation_weights(n: int) -> FloatArray:
    """Return the matrix that takes n + 1 points to the control points of the curve B(i/n) = x_i, shape (n + 1, n + 1).

    Inverted in rational numbers, so each weight is rounded once. The weights grow like 2ⁿ.
    """
    rows = [
        [Fraction(comb(n, j) * i**j * (n - i) ** (n - j), n**n) for j in range(n + 1)]
        + [Fraction(int(i == k)) for k in range(n + 1)]
        for i in range(n + 1)
    ]
    for column in range(n + 1):
        chosen = next(i for i in range(column, n + 1) if rows[i][column])
        rows[column], rows[chosen] = rows[chosen], rows[column]
        pivot = rows[column][column]
        rows[column] = [value / pivot for value in rows[column]]
        for i in range(n + 1):
            if i != column and rows[i][column]:
                factor = rows[i][column]
                rows[i] = [value - factor * base for value, base in zip(rows[i], rows[column], strict=True)]
    return np.array([[float(value) for value in row[n + 1 :]] for row in rows])
