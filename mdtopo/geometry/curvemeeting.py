"""Where two moving Bezier segments pass through each other: found by Newton's method, proved by Krawczyk's test.

F(t, u, v) = A(u, t) - B(v, t) has three components and three unknowns. Krawczyk: with Y close to the inverse of F' at
a point y, and X the cube of radius r about y, F has exactly one zero in X if K = y - Y·F(y) + (I - Y·F'(X))·(X - y)
lies inside X. F' is then regular in all of X, so its determinant keeps its sign there: the two curves pass.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.vectors import Vector, cross, dot, norm, scale, subtract

FloatArray = NDArray[np.float64]

NEWTON_STEPS = 24
WIDEST, NARROWEST = 0.25, 1e-11
"""Radii of the cube that are tried, each a quarter of the one before; t, u and v all run from 0 to 1."""


@njit(cache=True, nogil=True)
def _point(points: FloatArray, u: float, work: FloatArray) -> Vector:
    n = len(points)
    for i in range(n):
        for axis in range(3):
            work[i, axis] = points[i, axis]
    for stop in range(n - 1, 0, -1):
        for i in range(stop):
            for axis in range(3):
                work[i, axis] = (1.0 - u) * work[i, axis] + u * work[i + 1, axis]
    return work[0, 0], work[0, 1], work[0, 2]


@njit(cache=True, nogil=True)
def _blend(p0: FloatArray, p1: FloatArray, t: float) -> FloatArray:
    found = np.empty_like(p0)
    for i in range(len(p0)):
        for axis in range(3):
            found[i, axis] = (1.0 - t) * p0[i, axis] + t * p1[i, axis]
    return found


@njit(cache=True, nogil=True)
def _steps(p: FloatArray) -> FloatArray:
    """Return the differences of consecutive rows."""
    found = np.empty((len(p) - 1, 3))
    for i in range(len(found)):
        for axis in range(3):
            found[i, axis] = p[i + 1, axis] - p[i, axis]
    return found


@njit(cache=True, nogil=True)
def _moves(p0: FloatArray, p1: FloatArray) -> FloatArray:
    found = np.empty_like(p0)
    for i in range(len(p0)):
        for axis in range(3):
            found[i, axis] = p1[i, axis] - p0[i, axis]
    return found


@njit(cache=True, nogil=True)
def _greatest_row(points: FloatArray) -> float:
    greatest = 0.0
    for i in range(len(points)):
        greatest = max(greatest, norm((points[i, 0], points[i, 1], points[i, 2])))
    return greatest


@njit(cache=True, nogil=True)
def difference_and_slopes(
    a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray, t: float, u: float, v: float
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return F and the three columns of F' at (t, u, v)."""
    n, work = len(a0) - 1, np.empty_like(a0)
    a, b = _blend(a0, a1, t), _blend(b0, b1, t)
    f = subtract(_point(a, u, work), _point(b, v, work))
    drift = subtract(_point(_moves(a0, a1), u, work), _point(_moves(b0, b1), v, work))
    along_a = scale(float(n), _point(_steps(a), u, work))
    along_b = scale(-float(n), _point(_steps(b), v, work))
    return f, drift, along_a, along_b


@njit(cache=True, nogil=True)
def _inverse_rows(p: Vector, q: Vector, r: Vector) -> tuple[Vector, Vector, Vector, float]:
    """Return the rows of the inverse of the matrix with these columns, and its determinant."""
    x = cross(q, r)
    determinant = dot(p, x)
    if determinant == 0.0:
        zero = (0.0, 0.0, 0.0)
        return zero, zero, zero, 0.0
    f = 1.0 / determinant
    return scale(f, x), scale(f, cross(r, p)), scale(f, cross(p, q)), determinant


@njit(cache=True, nogil=True)
def locate(
    a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray, start: Vector, slack: float, greatest: float
) -> tuple[bool, Vector, float, int]:
    """Return whether a passage is proved near a start, where, in which radius it is the only one, and its sign.

    Parameters
    ----------
    a0, a1, b0, b1 : ndarray, shape (n + 1, 3)
        Control points of the two segments at both ends of the step, Å.
    start : tuple of 3 floats
        (t, u, v) to start from.
    slack : float
        How far a control point may be off, Å.
    greatest : float
        Greatest coordinate among the control points, Å.

    Returns
    -------
    found : bool
    place : tuple of 3 floats
        (t, u, v).
    radius : float
        No other zero has all of t, u and v within this of `place`; the cube lies within [0, 1]³.
    sign : int
        Of det(∂F/∂t, A', B'): +1 where det(a - c, b - a, d - c) rises through zero, for straight segments.

    Guarantee
    ---------
    Proven, rounding and slack included: the true zero is inside the cube, and the curves pass there.
    """
    t, u, v = start
    none = (False, start, 0.0, 0)
    for _ in range(NEWTON_STEPS):
        f, p, q, r = difference_and_slopes(a0, a1, b0, b1, t, u, v)
        y0, y1, y2, determinant = _inverse_rows(p, q, r)
        if determinant == 0.0:
            return none
        d0, d1, d2 = dot(y0, f), dot(y1, f), dot(y2, f)
        t, u, v = t - d0, u - d1, v - d2
        if not (-0.25 < t < 1.25 and -0.25 < u < 1.25 and -0.25 < v < 1.25):
            return none
        if max(abs(d0), max(abs(d1), abs(d2))) < 1e-15:
            break
    room = min(min(min(t, 1.0 - t), min(u, 1.0 - u)), min(v, 1.0 - v)) * (1.0 - 1e-12)
    if not room > NARROWEST:
        return none
    return _largest_cube(a0, a1, b0, b1, (t, u, v), room, slack, greatest)


@njit(cache=True, nogil=True)
def _largest_cube(
    a0: FloatArray,
    a1: FloatArray,
    b0: FloatArray,
    b1: FloatArray,
    y: Vector,
    room: float,
    slack: float,
    greatest: float,
) -> tuple[bool, Vector, float, int]:
    n = len(a0) - 1
    f, p, q, r = difference_and_slopes(a0, a1, b0, b1, y[0], y[1], y[2])
    y0, y1, y2, determinant = _inverse_rows(p, q, r)
    # a point of a curve is a convex combination; n rounds of it, a blend and a difference
    point_error = 2.0 * slack + 16.0 * (n + 4) * UNIT_ROUNDOFF * greatest
    slope_error = 4.0 * (n + 1) * (n + 1) * point_error  # of second differences too, n(n - 1) of them
    lengths = (norm(p), norm(q), norm(r))
    swing = slope_error * (lengths[0] * lengths[1] + lengths[1] * lengths[2] + lengths[2] * lengths[0])
    if not abs(determinant) > 4.0 * swing + 64.0 * UNIT_ROUNDOFF * lengths[0] * lengths[1] * lengths[2]:
        return False, y, 0.0, 0
    bend_a = _bend(a0, a1)
    bend_b = _bend(b0, b1)
    twist_a = n * _greatest_row(_steps(_moves(a0, a1)))
    twist_b = n * _greatest_row(_steps(_moves(b0, b1)))
    changes = (twist_a + twist_b, twist_a + bend_a, twist_b + bend_b)
    radius = min(WIDEST, room)
    while radius >= NARROWEST:
        if _maps_inside(y0, radius, (1.0, 0.0, 0.0), f, (p, q, r), changes, point_error, slope_error) and (
            _maps_inside(y1, radius, (0.0, 1.0, 0.0), f, (p, q, r), changes, point_error, slope_error)
            and _maps_inside(y2, radius, (0.0, 0.0, 1.0), f, (p, q, r), changes, point_error, slope_error)
        ):
            return True, y, radius, -1 if determinant > 0.0 else 1  # its third column is -B'
        radius *= 0.25
    return False, y, 0.0, 0


@njit(cache=True, nogil=True)
def _bend(p0: FloatArray, p1: FloatArray) -> float:
    """Return a bound of the second derivative along a segment, at all times and parameters."""
    n = len(p0) - 1
    if n < 2:
        return 0.0
    return n * (n - 1) * max(_greatest_row(_steps(_steps(p0))), _greatest_row(_steps(_steps(p1))))


@njit(cache=True, nogil=True)
def _maps_inside(
    row: Vector,
    radius: float,
    unit: Vector,
    f: Vector,
    columns: tuple[Vector, Vector, Vector],
    changes: Vector,
    point_error: float,
    slope_error: float,
) -> bool:
    """Return whether one component of Krawczyk's image stays inside the cube.

    A column of F' changes by at most `changes` times the radius within the cube, and is off by `slope_error`.
    """
    size, total = norm(row), 0.0
    for j in range(3):
        column = columns[j]
        rounding = 16.0 * UNIT_ROUNDOFF * size * norm(column)
        total += abs(unit[j] - dot(row, column)) + rounding + size * (radius * changes[j] + slope_error)
    shift = abs(dot(row, f)) + size * (point_error + 8.0 * UNIT_ROUNDOFF * norm(f))
    return (shift + total * radius) * (1.0 + 64.0 * UNIT_ROUNDOFF) < radius


@njit(cache=True, nogil=True)
def place_in_space(p0: FloatArray, p1: FloatArray, t: float, u: float) -> Vector:
    """Return the point of a moving segment at a time and parameter."""
    return _point(_blend(p0, p1, t), u, np.empty_like(p0))
