"""d*: the distance of the origin to a convex hull, with the direction that proves it.

A bounded set V lies in the open half space w·v > 0 for some w exactly when the origin is outside conv V, and the best
such w is the hull's point of least norm. That point is found by the algorithm of Gilbert, Johnson and Keerthi (1988):
keep a simplex of at most four points, project the origin onto it, add the point that is furthest towards the origin,
until none lies deeper than the projection.
"""

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.errors import InputError
from mdtopo.geometry.distances import DUAL_ERROR, LEAST_SQUARE
from mdtopo.geometry.vectors import Vector, add, cross, dot, row, scale, subtract

MAX_ITERATIONS = 64
"""GJK ends in a few rounds; a set that is degenerate in rounding may cycle, and is then left with a valid direction."""

Simplex: TypeAlias = tuple[Vector, Vector, Vector, Vector]
"""Up to four points; those behind the number that is given with them mean nothing."""

PROGRESS = 1e-14
"""Relative progress in |w|² under which rounding, not geometry, moves the projection."""


@njit(cache=True, nogil=True)
def nearest_on_segment(a: Vector, b: Vector) -> tuple[Vector, int]:
    """Return the point of the segment (a, b) nearest to the origin, and which ends carry it (bits 1, 2)."""
    d = subtract(b, a)
    along, length = -dot(a, d), dot(d, d)
    if along <= 0.0 or length == 0.0:
        return a, 1
    if along >= length:
        return b, 2
    return add(a, scale(along / length, d)), 3


@njit(cache=True, nogil=True)
def nearest_on_triangle(a: Vector, b: Vector, c: Vector) -> tuple[Vector, int]:
    """Return the point of a triangle nearest to the origin, and which corners carry it (bits 1, 2, 4)."""
    normal = cross(subtract(b, a), subtract(c, a))
    size = dot(normal, normal)
    if size > 0.0:
        inside_ab = dot(cross(a, b), normal) >= 0.0
        inside_bc = dot(cross(b, c), normal) >= 0.0
        inside_ca = dot(cross(c, a), normal) >= 0.0
        if inside_ab and inside_bc and inside_ca:
            return scale(dot(a, normal) / size, normal), 7
    best, mask = nearest_on_segment(a, b)
    other, bits = nearest_on_segment(b, c)
    if dot(other, other) < dot(best, best):
        best, mask = other, bits << 1
    other, bits = nearest_on_segment(a, c)
    if dot(other, other) < dot(best, best):
        best, mask = other, (bits & 1) | ((bits & 2) << 1)
    return best, mask


@njit(cache=True, nogil=True)
def _same_side(a: Vector, b: Vector, c: Vector, d: Vector) -> bool:
    """Return whether the origin lies on d's side of the plane (a, b, c)."""
    normal = cross(subtract(b, a), subtract(c, a))
    towards_origin, towards_d = -dot(normal, a), dot(normal, subtract(d, a))
    return towards_origin * towards_d > 0.0


@njit(cache=True, nogil=True)
def nearest_on_tetrahedron(a: Vector, b: Vector, c: Vector, d: Vector) -> tuple[Vector, int]:
    """Return the point of a tetrahedron nearest to the origin, and which corners carry it (bits 1, 2, 4, 8)."""
    best, least, mask = (0.0, 0.0, 0.0), np.inf, 15
    # the nearest point of the outside lies on a face that the origin sees
    if not _same_side(a, b, c, d):
        best, mask = nearest_on_triangle(a, b, c)
        least = dot(best, best)
    if not _same_side(a, b, d, c):
        other, bits = nearest_on_triangle(a, b, d)
        if dot(other, other) < least:
            best, least, mask = other, dot(other, other), (bits & 3) | ((bits & 4) << 1)
    if not _same_side(a, c, d, b):
        other, bits = nearest_on_triangle(a, c, d)
        if dot(other, other) < least:
            best, least, mask = other, dot(other, other), (bits & 1) | ((bits & 6) << 1)
    if not _same_side(b, c, d, a):
        other, bits = nearest_on_triangle(b, c, d)
        if dot(other, other) < least:
            best, mask = other, bits << 1
    return best, mask


@njit(cache=True, nogil=True)
def _project(simplex: Simplex, count: int) -> tuple[Vector, int]:
    a, b, c, d = simplex
    if count == 1:
        return a, 1
    if count == 2:
        return nearest_on_segment(a, b)
    if count == 3:
        return nearest_on_triangle(a, b, c)
    return nearest_on_tetrahedron(a, b, c, d)


@njit(cache=True, nogil=True)
def closer(simplex: Simplex, count: int, w: Vector, v: Vector) -> tuple[Simplex, int, Vector]:
    """Take one more point v into the simplex whose point of least norm is w; one round of the algorithm.

    Returns
    -------
    simplex : Simplex
        The corners that carry the new point of least norm, first.
    count : int
        How many they are; 0 where v brings no progress, and w stands.
    w : tuple of 3 floats
        The new point of least norm.
    """
    a, b, c, d = simplex
    squared = dot(w, w)
    if squared == 0.0 or squared - dot(w, v) <= PROGRESS * squared or count == 4:
        return simplex, 0, w
    if count == 1:
        b = v
    elif count == 2:
        c = v
    else:
        d = v
    nearer, mask = _project((a, b, c, d), count + 1)
    if dot(nearer, nearer) >= squared * (1.0 - PROGRESS):
        return simplex, 0, w
    if not mask & 4:
        c = d
    if not mask & 2:
        b, c = c, d
    if not mask & 1:
        a, b, c = b, c, d
    return (a, b, c, d), (mask & 1) + (mask >> 1 & 1) + (mask >> 2 & 1) + (mask >> 3 & 1), nearer


@njit(cache=True, nogil=True)
def _deepest(points: NDArray[np.float64], w: Vector) -> int:
    """Return the index of the point with the least w·v."""
    best, least = 0, np.inf
    for i in range(points.shape[0]):
        depth = dot(w, row(points, i))
        if depth < least:
            best, least = i, depth
    return best


@njit(cache=True, nogil=True)
def least_norm_point(points: NDArray[np.float64]) -> Vector:
    """Return the point of conv(points) nearest to the origin; heuristic in its last digits.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        At least one point. A plane set has its third coordinate 0.
    """
    w, count = row(points, 0), 1
    simplex = (w, w, w, w)
    for _ in range(MAX_ITERATIONS):
        simplex, count, w = closer(simplex, count, w, row(points, _deepest(points, w)))
        if count == 0:
            break
    return w


@njit(cache=True, nogil=True)
def direction_bound(points: NDArray[np.float64], w: Vector) -> float:
    """Return min over the points of w·v/|w|, less its rounding error, Å.

    Guarantee
    ---------
    Proven: the origin is at least this far from conv(points), whatever w is; negative or 0 proves nothing.
    """
    squared = dot(w, w)
    if not squared > LEAST_SQUARE:
        return 0.0
    length = np.sqrt(squared)
    least, greatest = np.inf, 0.0
    for i in range(points.shape[0]):
        v = row(points, i)
        least, greatest = min(least, dot(w, v)), max(greatest, dot(v, v))
    return least / length - DUAL_ERROR * np.sqrt(greatest)


@njit(cache=True, nogil=True)
def hull_distance(points: NDArray[np.float64]) -> float:
    """Return d*: a lower bound of the distance of the origin to conv(points), Å, sharp to rounding.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        At least one point.

    Guarantee
    ---------
    Proven: never above the true distance. 0 or negative where the origin is in the hull, or too close to it to tell.
    """
    return direction_bound(points, least_norm_point(points))


def d_star(points: NDArray[np.float64]) -> float:
    """Return d*: the distance of the origin to the convex hull of points in the plane or in space, Å.

    Parameters
    ----------
    points : array, shape (n, 2) or (n, 3)
        At least one point; for the paper's d* of a Bezier curve, the differences of its consecutive control points.

    Returns
    -------
    float
        A lower bound, sharp to rounding; 0 where the origin is in the hull, or too close to it to tell.

    Raises
    ------
    InputError
        If the shape does not fit, or a value is not finite.

    Notes
    -----
    Jordan et al. (2008), section 3. A positive value proves that the curve does not meet itself; it stays so while each
    difference moves less than d*, or each control point less than d*/2. The paper prints d* for the latter, which is
    wrong by a factor of two (case T3 in `fixtures/cases`).

    Guarantee
    ---------
    Proven: never above the true distance, rounding included.

    Examples
    --------
    >>> round(d_star(np.array([[1, 2], [1, -1], [3, 0]])), 12)
    1.0
    """
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] not in (2, 3) or not len(array):
        raise InputError(f"Points have shape {array.shape}; (n, 2) or (n, 3) with at least one point is needed.")
    if not np.isfinite(array).all():
        raise InputError("A point is not finite.")
    padded = np.zeros((len(array), 3))
    padded[:, : array.shape[1]] = array
    return max(float(hull_distance(padded)), 0.0)
