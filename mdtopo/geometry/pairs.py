"""What is known of two moving edges: bounds of their distance and of their motion, cheap ones first.

Two edges (a, b) and (c, d) move linearly. Bounds without a closest-point search come from midpoints and half edges;
they carry the rounding of those. Bounds from the corners themselves are for stored coordinates.
"""

from typing import TypeAlias

import numpy as np
from numba import njit

from mdtopo.geometry.distances import LEAST_SQUARE, UNIT_ROUNDOFF, dual_bound
from mdtopo.geometry.hull import MAX_ITERATIONS, closer
from mdtopo.geometry.vectors import Vector, add, cross, dot, norm, quotient, scale, subtract

Corners: TypeAlias = tuple[Vector, Vector, Vector, Vector]
"""The ends of two edges: a, b of the first and c, d of the second."""

BOUND_ERROR = 1e-12
"""Rounding of the cheap bounds, as a multiple of the lengths that enter them. The normal of two lines is wrong by at
most a few u·|e||f|, which `NEARLY_PARALLEL` keeps below 1e-12 of its own length."""

NEARLY_PARALLEL = 1e-6
"""Squared sine under which two edges count as parallel."""


@njit(cache=True, nogil=True, forceinline=True)
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


@njit(cache=True, nogil=True, forceinline=True)
def line_bound(centre: Vector, first: Vector, second: Vector) -> float:
    """Return how far the *lines* of two edges are apart: a lower bound of the edges' distance; 0 if nearly parallel."""
    normal = cross(first, second)
    size = dot(normal, normal)
    crossed = size > max(NEARLY_PARALLEL * dot(first, first) * dot(second, second), LEAST_SQUARE)
    return quotient(abs(dot(normal, centre)), np.sqrt(size)) if crossed else 0.0


@njit(cache=True, nogil=True, forceinline=True)
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


@njit(cache=True, nogil=True, forceinline=True)
def direction_clearance(n0: Vector, n1: Vector, start: Corners, end: Corners) -> float:
    """Return the best clearance that one of the directions n0, n1 and their mean proves for both ends (rung 4)."""
    size0, size1 = norm(n0), norm(n1)
    mean = add(scale(quotient(1.0, size0), n0), scale(quotient(1.0, size1), n1))
    middle = mean if size0 > 0.0 and size1 > 0.0 else n0
    first = least_along(n0, start, end)
    return max(first, max(least_along(n1, start, end), least_along(middle, start, end)))


@njit(cache=True, nogil=True, forceinline=True)
def least_along(w: Vector, start: Corners, end: Corners) -> float:
    """Return how far two edges are apart at both ends of the step, at least, along a direction."""
    low0 = dual_bound(w, start[0], start[1], start[2], start[3])
    return min(low0, dual_bound(w, end[0], end[1], end[2], end[3]))


@njit(cache=True, nogil=True)
def hull_clearance(start: Corners, end: Corners, enough: float) -> float:
    """Return d* of all differences of the two edges at both ends (rung 5), as `mdtopo.geometry.hull` finds it.

    Parameters
    ----------
    start, end : Corners
        The edges at both ends of the step.
    enough : float
        Above this it need not be d*: the first direction that proves more will do, Å.

    Guarantee
    ---------
    Proven: never above the true value.
    """
    w, count = subtract(start[0], start[2]), 1
    simplex = (w, w, w, w)
    for _ in range(MAX_ITERATIONS):
        one, other = deepest_difference(w, start), deepest_difference(w, end)
        deepest = one if dot(w, one) <= dot(w, other) else other
        if dot(w, deepest) > max(enough, 0.0) * norm(w):
            clearance = least_along(w, start, end)
            if clearance > enough:
                return clearance
        simplex, count, w = closer(simplex, count, w, deepest)
        if count == 0:
            break
    return least_along(w, start, end)


@njit(cache=True, nogil=True)
def deepest_difference(w: Vector, corners: Corners) -> Vector:
    """Return the difference of a point of the first edge and one of the second that has the least w·v."""
    a, b, c, d = corners
    return subtract(a if dot(w, a) <= dot(w, b) else b, c if dot(w, c) >= dot(w, d) else d)


@njit(cache=True, nogil=True, forceinline=True)
def slab_gaps(
    centre0: Vector, centre1: Vector, first0: Vector, second0: Vector, first1: Vector, second1: Vector
) -> tuple[float, float]:
    """Return how far the slabs across the mean line of centres are apart at both ends, Å; minus infinity without one.

    Parameters
    ----------
    centre0, centre1 : tuple of 3 floats
        From the midpoint of the first edge to that of the second, at both ends.
    first0, second0, first1, second1 : tuple of 3 floats
        Half edge vectors at both ends.

    Guarantee
    ---------
    Proven lower bounds of the distances at the two ends, and the lesser one of the distance at all times, but for
    rounding, which is not subtracted.
    """
    w = add(centre0, centre1)
    squared = dot(w, w)
    length = np.sqrt(squared)
    slab0 = quotient(slab_bound(w, centre0, first0, second0), length)
    slab1 = quotient(slab_bound(w, centre1, first1, second1), length)
    return (slab0 if squared > LEAST_SQUARE else -np.inf), (slab1 if squared > LEAST_SQUARE else -np.inf)


@njit(cache=True, nogil=True, forceinline=True)
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
    return (gap > 0.0) & (gap > nearest * length) & (moved * length < 2.0 * gap * ratio)


@njit(cache=True, nogil=True, forceinline=True)
def axis_gap(
    centre0: Vector, centre1: Vector, first0: Vector, second0: Vector, first1: Vector, second1: Vector
) -> float:
    """Return how far the slabs of a pair across one of the axes are apart at both ends, at best, Å; see `is_far`.

    Negative or 0 where they meet across all three. It is positive for every pair whose boxes do not meet, in rounding
    too where those are padded: so such a pair stays apart by as much at all times, up to the rounding of a coordinate.
    """
    x = one_axis_gap(centre0[0], centre1[0], first0[0], second0[0], first1[0], second1[0])
    y = one_axis_gap(centre0[1], centre1[1], first0[1], second0[1], first1[1], second1[1])
    return max(max(x, y), one_axis_gap(centre0[2], centre1[2], first0[2], second0[2], first1[2], second1[2]))


@njit(cache=True, nogil=True, forceinline=True)
def one_axis_gap(centre0: float, centre1: float, first0: float, second0: float, first1: float, second1: float) -> float:
    """Return the gap of `axis_gap` along one axis, from what lies along it."""
    reach0, reach1 = abs(first0) + abs(second0), abs(first1) + abs(second1)
    return max(min(centre0 - reach0, centre1 - reach1), min(-centre0 - reach0, -centre1 - reach1))
