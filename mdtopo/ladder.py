"""The rungs of the certificate ladder over all pairs of edges of one step.

Two moving edges (a, b) and (c, d) stay apart as long as the origin stays outside the convex hull of
V(t) = {a-c, a-d, b-c, b-d}, each of which moves linearly. With d0, d1 the edges' distances at the two ends, and ρ the
greatest motion of a member of V:

====  ================  ==============================================================  =======================
rung  name              settles the pair when                                           clearance
====  ================  ==============================================================  =======================
0     ball              every vertex moves less than ν0/2 (the paper)                   ν0 - 2m
1     two-frame ball    every vertex moves less than (ν0 + ν1)/2                        (ν0 + ν1)/2 - m
2     broad phase       the swept spheres of the edges, or the slabs across the line    their gap
                        of their centres, are apart
3     relative motion   ρ < d0 + d1                                                     (d0 + d1 - ρ)/2
4     direction         one w in {n0, n1, n0 + n1} has w·v > 0 for all v at both ends   min w·v/|w|
5     hull              the origin is outside conv(V0 ∪ V1)                             d*(V0 ∪ V1)
====  ================  ==============================================================  =======================

Guarantee: a clearance is a proven lower bound of the pair's distance at every time of the step, rounding included. What
no rung settles stays OPEN, and the step UNRESOLVED.

The numbers of a step (ν, greatest ratio, least clearance of each class) are exact minima and maxima over the pairs in
reach. A pair is measured in full only if a cheap bound does not already show that it cannot change any of them.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.broadphase import candidate_pairs
from mdtopo.geometry.distances import LEAST_SQUARE, UNIT_ROUNDOFF, closest_points, dual_bound
from mdtopo.geometry.hull import hull_distance
from mdtopo.geometry.lattice import Counts, basis_of, lattice_vector
from mdtopo.geometry.vectors import Vector, add, cross, dot, norm, row, scale, subtract
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Corners: TypeAlias = tuple[Vector, Vector, Vector, Vector]
"""The ends of two edges: a, b of the first and c, d of the second."""

N_RUNGS = len(Rung)
BALL, TWO_FRAME_BALL, BROAD_PHASE = int(Rung.BALL), int(Rung.TWO_FRAME_BALL), int(Rung.BROAD_PHASE)
RELATIVE_MOTION, DIRECTION, HULL = int(Rung.RELATIVE_MOTION), int(Rung.DIRECTION), int(Rung.HULL)
OPEN = int(Rung.OPEN)

RATIO_REACH = 1.25
"""Pairs whose ratio is at least 1/1.25 = 0.8 are always in reach: they have d0 + d1 ≤ 1.25 ρ, and ρ is at most the sum
of the two edges' greatest displacements."""

WIDEST_REACH = 4.0
"""The search for a class without any pair in reach stops at this multiple of the mean edge length."""

BOUND_ERROR = 1e-12
"""Rounding of the cheap bounds, as a multiple of the lengths that enter them. The normal of two lines is wrong by at
most a few u·|e||f|, which `NEARLY_PARALLEL` keeps below 1e-12 of its own length."""

NEARLY_PARALLEL = 1e-6
"""Squared sine under which two edges count as parallel."""

FIRST_REACH = 1.2
"""The first search looks this much further than the least distance of local pairs, which bounds ν from above."""

SPARE_REACH = 1.3
"""And this much further than the step before had to look, which spares most steps a second search."""

PLACING_ERROR = 64.0 * UNIT_ROUNDOFF
"""Rounding of what is not a stored coordinate (a midpoint, a half edge, a vertex placed in the cell or at an image), as
a multiple of the greatest coordinate and cell vector that entered. A midpoint is off by u·√3 of the coordinate, an
image by 8u of each lattice vector, reduced ones included; ρ, which adds four of each, by less than 48u."""

LEAST_SLACK = 1e-140
"""Å. Added to that rounding: squares of lengths below 1e-160 Å underflow, and a radius or a motion came out as 0."""


class StepMeasure(NamedTuple):
    """What the ladder finds in one step.

    Attributes
    ----------
    nu, nu_end : float
        ν at the start and the end, Å.
    nu_witness : ndarray of int, shape (4,)
        The closest pair at the start, as vertices a, b, c, d.
    nu_class : int
        Its class.
    displacement, displacement_vertex : float, int
        Greatest displacement of a vertex, and that vertex.
    ratio : float
        Greatest ρ/(d0 + d1) of a pair.
    ratio_witness : ndarray of int, shape (4,)
    clearances : ndarray, shape (3,)
        Local, self, inter; NaN where no such pair exists at all. Never above `reach` for self and inter.
    clearance_witness : ndarray of int, shape (3, 4)
        -1 where no pair lies within reach.
    rung_pairs : ndarray of int, shape (9,)
        Pairs that the broad phase left, by the rung that settles them; the last entry counts open ones.
    rung : int
        The costliest rung needed; OPEN if a pair stayed open.
    needed_reach : float
        How far the search had to go, Å.
    countable : bool
        False where too many periodic images might be met, so that the search was given up; the rung is then OPEN.
    """

    nu: float
    nu_end: float
    nu_witness: IntArray
    nu_class: int
    displacement: float
    displacement_vertex: int
    ratio: float
    ratio_witness: IntArray
    clearances: FloatArray
    clearance_witness: IntArray
    rung_pairs: IntArray
    rung: int
    needed_reach: float
    countable: bool


class Spheres(NamedTuple):
    """The edges of a step as moving spheres: midpoints and half edges at both ends, greatest half length and motion."""

    mid0: FloatArray
    mid1: FloatArray
    span0: FloatArray
    span1: FloatArray
    half: FloatArray
    motion: FloatArray


class Extremes(NamedTuple):
    """The best values so far; every array is written in place.

    `values` holds ν0, ν1 (upper bounds by closest points), proven ν0, proven ν1, greatest ratio; `least` the least
    clearance of each class.
    """

    values: FloatArray
    nu_witness: IntArray
    nu_class: IntArray
    ratio_witness: IntArray
    least: FloatArray
    witness: IntArray
    rung_pairs: IntArray


NU0, NU1, NU0_PROVEN, NU1_PROVEN, RATIO = 0, 1, 2, 3, 4


@njit(cache=True, nogil=True)
def spheres_of(motion: StepMotion, edges: IntArray) -> Spheres:
    """Return the bounding spheres of the edges, moving linearly; proven for all times, as lengths are convex in t."""
    m = len(edges)
    mid0, mid1, half, moved = np.empty((m, 3)), np.empty((m, 3)), np.empty(m), np.empty(m)
    span0, span1 = np.empty((m, 3)), np.empty((m, 3))
    for k in range(m):
        a0, b0 = row(motion.x0, edges[k, 0]), row(motion.x0, edges[k, 1])
        a1, b1 = row(motion.x1, edges[k, 0]), row(motion.x1, edges[k, 1])
        mid0[k, 0], mid0[k, 1], mid0[k, 2] = scale(0.5, add(a0, b0))
        mid1[k, 0], mid1[k, 1], mid1[k, 2] = scale(0.5, add(a1, b1))
        span0[k, 0], span0[k, 1], span0[k, 2] = scale(0.5, subtract(b0, a0))
        span1[k, 0], span1[k, 1], span1[k, 2] = scale(0.5, subtract(b1, a1))
        half[k] = max(norm(row(span0, k)), norm(row(span1, k)))
        moved[k] = max(norm(subtract(a1, a0)), norm(subtract(b1, b0)))
    return Spheres(mid0, mid1, span0, span1, half, moved)


@njit(cache=True, nogil=True)
def greatest_displacement(x0: FloatArray, x1: FloatArray) -> tuple[float, int]:
    """Return how far the vertex that moves most moves, Å, and which one it is."""
    best, vertex = -1.0, 0
    for i in range(len(x0)):
        d = subtract(row(x1, i), row(x0, i))
        squared = dot(d, d)
        if squared > best:
            best, vertex = squared, i
    return np.sqrt(best), vertex


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
def direction_clearance(n0: Vector, n1: Vector, start: Corners, end: Corners) -> float:
    """Return the best clearance that one of the directions n0, n1 and their mean proves for both ends (rung 4)."""
    best = -np.inf
    size0, size1 = norm(n0), norm(n1)
    middle = add(scale(1.0 / size0, n0), scale(1.0 / size1, n1)) if size0 > 0.0 and size1 > 0.0 else n0
    for k in range(3):
        w = n0 if k == 0 else (n1 if k == 1 else middle)
        low0 = dual_bound(w, start[0], start[1], start[2], start[3])
        low1 = dual_bound(w, end[0], end[1], end[2], end[3])
        best = max(best, min(low0, low1))
    return best


@njit(cache=True, nogil=True)
def hull_clearance(start: tuple[Vector, Vector, Vector, Vector], end: tuple[Vector, Vector, Vector, Vector]) -> float:
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
def settle_pair(
    i: int,
    j: int,
    image: Counts,
    kind: int,
    bounds: tuple[float, float, float, float],
    motion: StepMotion,
    edges: IntArray,
    placing: float,
    best: Extremes,
) -> None:
    """Settle one pair of edges by the cheapest rung that does, and keep what it adds to the step's extremes."""
    gap, low0, low1, _ = bounds
    shift0 = lattice_vector(image, basis_of(motion.cell0))
    shift1 = lattice_vector(image, basis_of(motion.cell1))
    a0, b0 = row(motion.x0, edges[i, 0]), row(motion.x0, edges[i, 1])
    a1, b1 = row(motion.x1, edges[i, 0]), row(motion.x1, edges[i, 1])
    c0, d0 = add(row(motion.x0, edges[j, 0]), shift0), add(row(motion.x0, edges[j, 1]), shift0)
    c1, d1 = add(row(motion.x1, edges[j, 0]), shift1), add(row(motion.x1, edges[j, 1]), shift1)
    start, end = (a0, b0, c0, d0), (a1, b1, c1, d1)
    _, _, n0 = closest_points(a0, b0, c0, d0)
    _, _, n1 = closest_points(a1, b1, c1, d1)
    low0 = max(dual_bound(n0, a0, b0, c0, d0) - placing, low0)
    low1 = max(dual_bound(n1, a1, b1, c1, d1) - placing, low1)
    rho = relative_motion(start, end) + placing
    keep_nu(edges, i, j, kind, norm(n0), norm(n1), low0, low1, best)
    keep_ratio(edges, i, j, rho, low0, low1, best)
    rung, clearance = BROAD_PHASE, max(gap, 0.5 * (low0 + low1 - rho))
    # tests are for what is proved, so that a NaN proves nothing
    if not gap > 0.0:
        rung = RELATIVE_MOTION
        if not clearance > 0.0:
            rung, clearance = DIRECTION, direction_clearance(n0, n1, start, end) - placing
        if not clearance > 0.0:
            rung, clearance = HULL, hull_clearance(start, end) - placing
        if not clearance > 0.0:
            rung, clearance = OPEN, 0.0
    if rung != BROAD_PHASE:
        best.rung_pairs[rung] += 1
    if clearance < best.least[kind] or (clearance == best.least[kind] and comes_first(edges, i, j, best.witness[kind])):
        best.least[kind] = clearance
        write_pair(best.witness[kind], edges, i, j)


@njit(cache=True, nogil=True)
def write_pair(witness: IntArray, edges: IntArray, i: int, j: int) -> None:
    """Write the four vertices of a pair of edges, the edge with the lower vertex first."""
    first, second = (i, j) if edges[i, 0] <= edges[j, 0] else (j, i)
    witness[0], witness[1] = edges[first, 0], edges[first, 1]
    witness[2], witness[3] = edges[second, 0], edges[second, 1]


@njit(cache=True, nogil=True)
def comes_first(edges: IntArray, i: int, j: int, witness: IntArray) -> bool:
    """Return whether a pair comes before the witness; so a tie is settled by the pairs, not by the order of search."""
    low, high = min(edges[i, 0], edges[j, 0]), max(edges[i, 0], edges[j, 0])
    return low < witness[0] or (low == witness[0] and high < witness[2])


@njit(cache=True, nogil=True)
def keep_nu(
    edges: IntArray,
    i: int,
    j: int,
    kind: int,
    near0: float,
    near1: float,
    low0: float,
    low1: float,
    best: Extremes,
) -> None:
    """Update ν at both ends with one pair of edges."""
    best.values[NU0_PROVEN] = min(best.values[NU0_PROVEN], low0)
    best.values[NU1_PROVEN] = min(best.values[NU1_PROVEN], low1)
    best.values[NU1] = min(best.values[NU1], near1)
    if near0 < best.values[NU0] or (near0 == best.values[NU0] and comes_first(edges, i, j, best.nu_witness)):
        best.values[NU0] = near0
        best.nu_class[0] = kind
        write_pair(best.nu_witness, edges, i, j)


@njit(cache=True, nogil=True)
def keep_ratio(edges: IntArray, i: int, j: int, rho: float, low0: float, low1: float, best: Extremes) -> None:
    """Update the greatest ρ/(d0 + d1) with one pair of edges; infinite where no distance is proved."""
    apart = low0 + low1
    ratio = rho / apart if apart > 0.0 else np.inf
    if ratio > best.values[RATIO] or (ratio == best.values[RATIO] and comes_first(edges, i, j, best.ratio_witness)):
        best.values[RATIO] = ratio
        write_pair(best.ratio_witness, edges, i, j)


@njit(cache=True, nogil=True)
def fresh_extremes() -> Extremes:
    """Return extremes that any pair will improve."""
    values = np.full(5, np.inf)
    values[RATIO] = -1.0
    return Extremes(
        values,
        np.full(4, -1, dtype=np.int64),
        np.full(1, -1, dtype=np.int64),
        np.full(4, -1, dtype=np.int64),
        np.full(3, np.inf),
        np.full((3, 4), -1, dtype=np.int64),
        np.zeros(N_RUNGS, dtype=np.int64),
    )


@njit(cache=True, nogil=True)
def copy_extremes(best: Extremes) -> Extremes:
    """Return an independent copy."""
    return Extremes(
        best.values.copy(),
        best.nu_witness.copy(),
        best.nu_class.copy(),
        best.ratio_witness.copy(),
        best.least.copy(),
        best.witness.copy(),
        best.rung_pairs.copy(),
    )


@njit(cache=True, nogil=True)
def climb_pairs(
    pairs: IntArray,
    images: IntArray,
    local: bool,
    motion: StepMotion,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    spheres: Spheres,
    slack: float,
    placing: float,
    best: Extremes,
) -> float:
    """Climb a list of pairs, and return the greatest drift of an image among them, Å.

    Where the list is not the local one, pairs that are local are passed over: they have been climbed already. A pair is
    settled in full unless its cheap bounds show that it can change none of the step's extremes.
    """
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    mid0, mid1, span0, span1, half = spheres.mid0, spheres.mid1, spheres.span0, spheres.span1, spheres.half
    moves, image_move = spheres.motion, 0.0
    values, least, rung_pairs = best.values, best.least, best.rung_pairs
    greatest_drift, image, kind = 0.0, (0, 0, 0), 0
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        centre0, centre1 = subtract(row(mid0, j), row(mid0, i)), subtract(row(mid1, j), row(mid1, i))
        if not local:
            image = (images[k, 0], images[k, 1], images[k, 2])
            kind = 1 if trace[i] == trace[j] else 2
            if image != (0, 0, 0):
                shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
                centre0, centre1 = add(centre0, shift0), add(centre1, shift1)
                image_move = norm(subtract(shift1, shift0))
                greatest_drift = max(greatest_drift, image_move)
            elif are_neighbours(i, j, following):
                continue
            else:
                image_move = 0.0
        f0, g0, f1, g1 = row(span0, i), row(span0, j), row(span1, i), row(span1, j)
        nearest = max(least[kind], max(values[NU0], values[NU1]))
        moved = moves[i] + moves[j] + image_move + slack
        if is_far(centre0, centre1, f0, g0, f1, g1, half[i] + half[j], moved, nearest, values[RATIO], slack):
            continue
        gap, low0, low1, rho = cheap_bounds(centre0, centre1, f0, g0, f1, g1, half[i] + half[j], slack)
        nu0, nu1, ratio = values[NU0], values[NU1], values[RATIO]
        idle = is_idle(gap, low0, low1, rho, least[kind], nu0, nu1, ratio)
        if not idle:
            rounding = slack + BOUND_ERROR * (norm(centre0) + norm(centre1) + half[i] + half[j])
            low0 = max(low0, line_bound(centre0, f0, g0) - rounding)
            low1 = max(low1, line_bound(centre1, f1, g1) - rounding)
            idle = is_idle(gap, low0, low1, rho, least[kind], nu0, nu1, ratio)
        if idle and not gap > 0.0:
            rung_pairs[RELATIVE_MOTION] += 1
        elif not idle:
            settle_pair(i, j, image, kind, (gap, low0, low1, rho), motion, edges, placing, best)
    return greatest_drift


@njit(cache=True, nogil=True)
def meet_end_terms(motion: StepMotion, end_terms: IntArray, placing: float, best: Extremes) -> None:
    """Take the end terms into ν: a vertex against its neighbour, or against the neighbour's edge.

    They belong to ν and to the ball rungs alone: a contact there folds an open end back on itself and nothing passes.
    """
    for k in range(len(end_terms)):
        a, b, c, d = end_terms[k, 0], end_terms[k, 1], end_terms[k, 2], end_terms[k, 3]
        _, _, n0 = closest_points(row(motion.x0, a), row(motion.x0, b), row(motion.x0, c), row(motion.x0, d))
        _, _, n1 = closest_points(row(motion.x1, a), row(motion.x1, b), row(motion.x1, c), row(motion.x1, d))
        near0, near1 = norm(n0), norm(n1)
        low0 = dual_bound(n0, row(motion.x0, a), row(motion.x0, b), row(motion.x0, c), row(motion.x0, d))
        low1 = dual_bound(n1, row(motion.x1, a), row(motion.x1, b), row(motion.x1, c), row(motion.x1, d))
        best.values[NU0_PROVEN] = min(best.values[NU0_PROVEN], low0 - placing)
        best.values[NU1_PROVEN] = min(best.values[NU1_PROVEN], low1 - placing)
        best.values[NU1] = min(best.values[NU1], near1)
        if near0 < best.values[NU0]:
            best.values[NU0], best.nu_class[0] = near0, 0
            best.nu_witness[0], best.nu_witness[1], best.nu_witness[2], best.nu_witness[3] = a, b, c, d


@njit(cache=True, nogil=True)
def are_neighbours(i: int, j: int, following: IntArray) -> bool:
    """Return whether two edges share a vertex or have one edge between them: the local pairs, climbed on their own."""
    after_i, after_j = following[i], following[j]
    if i == j or after_i == j or after_j == i:
        return True
    return (after_i >= 0 and following[after_i] == j) or (after_j >= 0 and following[after_j] == i)


@njit(cache=True, nogil=True)
def measure_step(
    motion: StepMotion,
    periodic: bool,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    local_pairs: IntArray,
    end_terms: IntArray,
    likely_reach: float,
) -> StepMeasure:
    """Return margins, ratios, clearances and rungs of one step.

    Parameters
    ----------
    motion : StepMotion
        From `mdtopo.curves.step_motion`; it must be usable.
    periodic : bool
        Whether there are images.
    edges, following, trace, local_pairs, end_terms : ndarray of int
        See `mdtopo.records.Traces`.
    likely_reach : float
        How far the search had to go in a step like this one, Å; a good guess saves time and changes nothing else.

    Guarantee
    ---------
    Proven: if the rung is not OPEN, no two edges that do not share a vertex meet at any time of the step, in any image.
    """
    displacement, vertex = greatest_displacement(motion.x0, motion.x1)
    slack = PLACING_ERROR * (greatest_coordinate(motion) + motion.placing) + LEAST_SLACK
    placing = slack if periodic else 0.0  # without a cell, coordinates are as stored, and exact
    spheres = spheres_of(motion, edges)
    local, no_images = fresh_extremes(), np.empty((0, 3), dtype=np.int64)
    climb_pairs(local_pairs, no_images, True, motion, edges, following, trace, spheres, slack, placing, local)
    meet_end_terms(motion, end_terms, placing, local)
    has_self, has_inter = has_pairs(trace, following, periodic)
    edge_length = mean_edge_length(spheres)
    widest = WIDEST_REACH * edge_length
    drift, best = 0.0, local
    reach = max(min(FIRST_REACH * local.values[NU0], edge_length), min(SPARE_REACH * likely_reach, widest))
    wanted, countable = 0.0, True
    while len(edges) > 0:
        radii = padded_radii(spheres, reach, slack)
        pairs, images, countable = candidate_pairs(
            spheres.mid0, spheres.mid1, radii, motion.cell0, motion.cell1, periodic
        )
        if not countable:
            break
        best = copy_extremes(local)
        drift = climb_pairs(pairs, images, False, motion, edges, following, trace, spheres, slack, placing, best)
        wanted = max(best.least[1] if has_self else 0.0, best.least[2] if has_inter else 0.0)
        if wanted <= reach or reach >= widest:
            break
        reach = min(min(wanted, 2.0 * reach + 0.1 * edge_length), widest)
    needed = min(wanted, reach)
    return conclude(best, displacement, vertex, drift, placing, reach, needed, countable, has_self, has_inter)


@njit(cache=True, nogil=True)
def mean_edge_length(spheres: Spheres) -> float:
    """Return the mean length of the edges, each at the end of the step where it is longer, Å."""
    total = 0.0
    for half in spheres.half:
        total += 2.0 * half
    return total / max(len(spheres.half), 1)


@njit(cache=True, nogil=True)
def padded_radii(spheres: Spheres, reach: float, slack: float) -> FloatArray:
    """Return radii such that two spheres that never meet belong to edges that stay more than `reach` apart.

    They also have a ratio below 1/RATIO_REACH.
    """
    radii = np.empty(len(spheres.half))
    for k in range(len(radii)):
        radii[k] = spheres.half[k] + max(0.5 * reach, 0.5 * RATIO_REACH * spheres.motion[k]) + slack
    return radii


@njit(cache=True, nogil=True)
def greatest_coordinate(motion: StepMotion) -> float:
    """Return the greatest coordinate that placing an image can meet, Å."""
    greatest, cells = 0.0, 0.0
    for i in range(len(motion.x0)):
        for axis in range(3):
            greatest = max(greatest, abs(motion.x0[i, axis]), abs(motion.x1[i, axis]))
    for k in range(3):
        for axis in range(3):
            cells += abs(motion.cell0[k, axis]) + abs(motion.cell1[k, axis])
    return greatest + cells


@njit(cache=True, nogil=True)
def has_pairs(trace: IntArray, following: IntArray, periodic: bool) -> tuple[bool, bool]:
    """Return whether pairs of class self, and of class inter, exist at all."""
    has_inter = len(trace) > 0 and trace[0] != trace[-1]
    has_self = periodic and len(trace) > 0
    longest, current = 0, 0
    for k in range(len(trace)):
        current = current + 1 if k > 0 and trace[k] == trace[k - 1] else 1
        closed = following[k] >= 0 and following[k] < k
        longest = max(longest, current - 2 if closed else current)
    return has_self or longest > 3, has_inter


@njit(cache=True, nogil=True)
def conclude(
    best: Extremes,
    displacement: float,
    vertex: int,
    drift: float,
    placing: float,
    reach: float,
    needed: float,
    countable: bool,
    has_self: bool,
    has_inter: bool,
) -> StepMeasure:
    """Return the step's measure: the ball rungs, the rung of the step, and clearances capped at what was searched."""
    counts = best.rung_pairs.copy()
    clearances, witness = best.least.copy(), best.witness.copy()
    moved = displacement * (1.0 + 8.0 * UNIT_ROUNDOFF) + placing
    drift *= 1.0 + 8.0 * UNIT_ROUNDOFF
    ball = best.values[NU0_PROVEN] - 2.0 * moved - drift
    two_frame_ball = 0.5 * (best.values[NU0_PROVEN] + best.values[NU1_PROVEN] - 2.0 * moved - drift)
    rung = BROAD_PHASE
    for k in range(BROAD_PHASE, N_RUNGS):
        if counts[k] > 0:
            rung = k
    if max(ball, two_frame_ball) > 0.0:
        rung = BALL if ball > 0.0 else TWO_FRAME_BALL
        for kind in range(3):
            clearances[kind] = max(clearances[kind], max(ball, two_frame_ball))
    if not countable:
        rung = OPEN
        clearances[:] = 0.0
    for kind in range(1, 3):
        clearances[kind] = min(clearances[kind], reach)
    if not has_self:
        clearances[1] = np.nan
    if not has_inter:
        clearances[2] = np.nan
    if clearances[0] == np.inf:
        clearances[0] = np.nan
    return StepMeasure(
        best.values[NU0],
        best.values[NU1],
        best.nu_witness,
        best.nu_class[0],
        displacement,
        vertex,
        max(best.values[RATIO], 0.0),
        best.ratio_witness,
        clearances,
        witness,
        counts,
        rung,
        needed,
        countable,
    )
