"""What is known of two moving edges: bounds of their distance and of their motion, cheap ones first.

Two edges (a, b) and (c, d) move linearly. Bounds without a closest-point search come from midpoints and half edges;
they carry the rounding of those. Bounds from the corners themselves are for stored coordinates.
"""

from typing import TypeAlias

import numpy as np
from numba import njit

from mdtopo.geometry.distances import LEAST_SQUARE, UNIT_ROUNDOFF, dual_bound
from mdtopo.geometry.hull import hull_distance
from mdtopo.geometry.vectors import Vector, add, cross, dot, norm, scale, subtract

Corners: TypeAlias = tuple[Vector, Vector, Vector, Vector]
"""The ends of two edges: a, b of the first and c, d of the second."""

BOUND_ERROR = 1e-12
"""Rounding of the cheap bounds, as a multiple of the lengths that enter them. The normal of two lines is wrong by at
most a few u·|e||f|, which `NEARLY_PARALLEL` keeps below 1e-12 of its own length."""

NEARLY_PARALLEL = 1e-6
"""Squared sine under which two edges count as parallel."""


@njit(cache=True, nogil=True)
def slab_bound(w: Vector, centre: Vector, first: Vector, second: Vector) -> float:
    """Return how far the slabs are apart, times |w|, that hold two edges across the direction w.

    Parameters
    ----------
    w : tuple of 3 floats
        Any direction.
    centre : tuple of 3 floats
        From the midpoint of the first edge to that of the second.
    first, second : tuple of 3 floats
        Half the edge vectors.
    """
    return dot(w, centre) - abs(dot(w, first)) - abs(dot(w, second))


@njit(cache=True, nogil=True)
def line_bound(centre: Vector, first: Vector, second: Vector) -> float:
    """Return how far the *lines* of two edges are apart: a lower bound of the edges' distance; 0 if nearly parallel."""
    normal = cross(first, second)
    size = dot(normal, normal)
    if not size > max(NEARLY_PARALLEL * dot(first, first) * dot(second, second), LEAST_SQUARE):
        return 0.0
    return abs(dot(normal, centre)) / np.sqrt(size)


@njit(cache=True, nogil=True)
def motion_bound(drift: Vector, first: Vector, second: Vector) -> float:
    """Return ρ, how far a corner of one edge moves relative to a corner of the other at most, from midpoints; Å.

    Parameters
    ----------
    drift : tuple of 3 floats
        Motion of the second edge's midpoint relative to the first's.
    first, second : tuple of 3 floats
        Motion of the half edge vectors; the four corners move by drift ± first ± second.
    """
    a, b, c = dot(drift, first), dot(drift, second), dot(first, second)
    most = max(max(a + b + c, a - b - c), max(b - a - c, c - a - b))
    squared = dot(drift, drift) + dot(first, first) + dot(second, second) + 2.0 * most
    return np.sqrt(max(squared, 0.0)) * (1.0 + 32.0 * UNIT_ROUNDOFF)


@njit(cache=True, nogil=True)
def relative_motion(start: Corners, end: Corners) -> float:
    """Return ρ, how far a corner of one edge moves relative to a corner of the other at most, from the corners; Å.

    Guarantee
    ---------
    Proven: never below the true value; each motion is rounded once, then each difference of two.
    """
    a, b = subtract(end[0], start[0]), subtract(end[1], start[1])
    c, d = subtract(end[2], start[2]), subtract(end[3], start[3])
    ac, ad, bc, bd = subtract(a, c), subtract(a, d), subtract(b, c), subtract(b, d)
    squared = max(max(dot(ac, ac), dot(ad, ad)), max(dot(bc, bc), dot(bd, bd)))
    moved = max(max(dot(a, a), dot(b, b)), max(dot(c, c), dot(d, d)))
    return np.sqrt(squared) * (1.0 + 8.0 * UNIT_ROUNDOFF) + 8.0 * UNIT_ROUNDOFF * np.sqrt(moved)


@njit(cache=True, nogil=True)
def direction_clearance(n0: Vector, n1: Vector, start: Corners, end: Corners, enough: float) -> float:
    """Return the best clearance that one of the directions n0, n1 and their mean proves for both ends (rung 4).

    Above `enough` it need not be the best.
    """
    best = -np.inf
    size0, size1 = norm(n0), norm(n1)
    middle = add(scale(1.0 / size0, n0), scale(1.0 / size1, n1)) if size0 > 0.0 and size1 > 0.0 else n0
    for k in range(3):
        w = middle if k == 0 else (n0 if k == 1 else n1)
        low0 = dual_bound(w, start[0], start[1], start[2], start[3])
        low1 = dual_bound(w, end[0], end[1], end[2], end[3])
        best = max(best, min(low0, low1))
        if best > enough:
            break
    return best


@njit(cache=True, nogil=True)
def hull_clearance(start: Corners, end: Corners) -> float:
    """Return d* of all differences of the two edges at both ends (rung 5)."""
    points = np.empty((8, 3))
    count = 0
    for corners in (start, end):
        for p in range(2):
            for q in range(2, 4):
                points[count, 0], points[count, 1], points[count, 2] = subtract(corners[p], corners[q])
                count += 1
    return hull_distance(points)


@njit(cache=True, nogil=True)
def cheap_bounds(
    centre0: Vector,
    centre1: Vector,
    first0: Vector,
    second0: Vector,
    first1: Vector,
    second1: Vector,
    reach: float,
    slack: float,
) -> tuple[float, float, float, float]:
    """Return what is known of a pair without any closest-point search.

    Parameters
    ----------
    centre0, centre1 : tuple of 3 floats
        From the midpoint of the first edge to that of the second, at both ends.
    first0, second0, first1, second1 : tuple of 3 floats
        Half edge vectors at both ends.
    reach : float
        Sum of the greatest half lengths.
    slack : float
        Rounding of the positions themselves, Å.

    Returns
    -------
    gap : float
        Proven lower bound of the distance at all times; useless where negative.
    low0, low1 : float
        Proven lower bounds of the distance at the two ends, not negative.
    rho : float
        Greatest relative motion of two corners, an upper bound.
    """
    drift, w = subtract(centre1, centre0), add(centre0, centre1)
    rho = motion_bound(drift, subtract(first1, first0), subtract(second1, second0)) + slack
    length = norm(w)
    if not length * length > LEAST_SQUARE:
        return -1.0, 0.0, 0.0, rho
    rounding = slack + BOUND_ERROR * (length + rho + reach)
    slab0 = slab_bound(w, centre0, first0, second0) / length - rounding
    slab1 = slab_bound(w, centre1, first1, second1) / length - rounding
    return min(slab0, slab1), max(slab0, 0.0), max(slab1, 0.0), rho


@njit(cache=True, nogil=True)
def is_far(
    centre0: Vector,
    centre1: Vector,
    first0: Vector,
    second0: Vector,
    first1: Vector,
    second1: Vector,
    reach: float,
    moved: float,
    nearest: float,
    ratio: float,
    slack: float,
) -> bool:
    """Return whether the slabs of a pair are so far apart that it can change none of the step's extremes.

    Most pairs end here, so it has one square root and no division. `moved` is an upper bound of ρ; a pair at least
    `nearest` apart changes neither a clearance nor ν, and one whose ρ is at most 2·gap·`ratio` not the greatest ratio.
    """
    w = add(centre0, centre1)
    length = norm(w)
    start, end = slab_bound(w, centre0, first0, second0), slab_bound(w, centre1, first1, second1)
    gap = min(start, end) - (slack + BOUND_ERROR * (length + moved + reach)) * length
    return gap > 0.0 and gap > nearest * length and moved * length < 2.0 * gap * ratio


@njit(cache=True, nogil=True)
def is_idle(
    gap: float, low0: float, low1: float, rho: float, least: float, nu0: float, nu1: float, ratio: float
) -> bool:
    """Return whether a pair with these proven bounds is settled and can change none of the step's extremes."""
    clearance = max(gap, 0.5 * (low0 + low1 - rho))
    return clearance > max(least, 0.0) and low0 > nu0 and low1 > nu1 and rho < ratio * (low0 + low1)


@njit(cache=True, nogil=True)
def axis_gap(
    centre0: Vector, centre1: Vector, first0: Vector, second0: Vector, first1: Vector, second1: Vector
) -> float:
    """Return how far the slabs of a pair across one of the axes are apart at both ends, at best, Å; see `is_far`.

    Negative or 0 where they meet across all three. It is positive for every pair whose boxes do not meet, in rounding
    too where those are padded: so such a pair stays apart by as much at all times, up to the rounding of a coordinate.
    """
    best = -np.inf
    for k in range(3):
        reach0, reach1 = abs(first0[k]) + abs(second0[k]), abs(first1[k]) + abs(second1[k])
        above = min(centre0[k] - reach0, centre1[k] - reach1)
        below = min(-centre0[k] - reach0, -centre1[k] - reach1)
        best = max(best, max(above, below))
    return best
