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

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.broadphase import candidate_pairs
from mdtopo.geometry.distances import DUAL_ERROR, UNIT_ROUNDOFF, closest_points, dual_bound
from mdtopo.geometry.hull import hull_distance
from mdtopo.geometry.lattice import lattice_vector
from mdtopo.geometry.vectors import Vector, add, dot, norm, row, scale, subtract
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

N_RUNGS = len(Rung)
BALL, TWO_FRAME_BALL, BROAD_PHASE = int(Rung.BALL), int(Rung.TWO_FRAME_BALL), int(Rung.BROAD_PHASE)
RELATIVE_MOTION, DIRECTION, HULL = int(Rung.RELATIVE_MOTION), int(Rung.DIRECTION), int(Rung.HULL)
OPEN = int(Rung.OPEN)

RATIO_REACH = 1.25
"""Pairs whose ratio is at least 1/1.25 = 0.8 are always in reach: they have d0 + d1 ≤ 1.25 ρ, and ρ is at most the sum
of the two edges' greatest displacements."""

WIDEST_REACH = 4.0
"""The search for a class without any pair in reach stops at this multiple of the mean edge length."""

PLACING_ERROR = 8.0 * UNIT_ROUNDOFF
"""Rounding of x + s·H, as a multiple of the greatest coordinate: three products, three sums, twice."""


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
        Pairs settled by each rung; the last entry counts open ones.
    rung : int
        The costliest rung needed; OPEN if a pair stayed open.
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


class Spheres(NamedTuple):
    """The edges of a step as moving spheres: midpoints at both ends, greatest half length, greatest displacement."""

    mid0: FloatArray
    mid1: FloatArray
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
    for k in range(m):
        a0, b0 = row(motion.x0, edges[k, 0]), row(motion.x0, edges[k, 1])
        a1, b1 = row(motion.x1, edges[k, 0]), row(motion.x1, edges[k, 1])
        mid0[k, 0], mid0[k, 1], mid0[k, 2] = scale(0.5, add(a0, b0))
        mid1[k, 0], mid1[k, 1], mid1[k, 2] = scale(0.5, add(a1, b1))
        half[k] = 0.5 * max(norm(subtract(b0, a0)), norm(subtract(b1, a1)))
        moved[k] = max(norm(subtract(a1, a0)), norm(subtract(b1, b0)))
    return Spheres(mid0, mid1, half, moved)


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
def slab_bound(centre0: Vector, centre1: Vector, ends0: tuple[Vector, Vector], ends1: tuple[Vector, Vector]) -> float:
    """Return how far the slabs are apart that hold two moving edges across the line of their mean centres.

    Parameters
    ----------
    centre0, centre1 : tuple of 3 floats
        From the midpoint of the one edge to that of the other, at the start and the end.
    ends0, ends1 : pair of tuples
        The two edge vectors, at the start and the end.

    Guarantee
    ---------
    Proven, up to rounding that `climb` adds: the direction certificate (rung 4) for one direction that is known
    without any closest-point search.
    """
    w = add(centre0, centre1)
    length = norm(w)
    if length == 0.0:
        return 0.0
    start = dot(w, centre0) - 0.5 * (abs(dot(w, ends0[0])) + abs(dot(w, ends0[1])))
    end = dot(w, centre1) - 0.5 * (abs(dot(w, ends1[0])) + abs(dot(w, ends1[1])))
    return min(start, end) / length


@njit(cache=True, nogil=True)
def relative_motion(
    a0: Vector, b0: Vector, c0: Vector, d0: Vector, a1: Vector, b1: Vector, c1: Vector, d1: Vector
) -> float:
    """Return ρ: how far a corner of one edge moves relative to a corner of the other, at most; Å."""
    a, b, c, d = subtract(a1, a0), subtract(b1, b0), subtract(c1, c0), subtract(d1, d0)
    ac, ad, bc, bd = subtract(a, c), subtract(a, d), subtract(b, c), subtract(b, d)
    squared = max(max(dot(ac, ac), dot(ad, ad)), max(dot(bc, bc), dot(bd, bd)))
    return np.sqrt(squared) * (1.0 + 8.0 * UNIT_ROUNDOFF)


@njit(cache=True, nogil=True)
def direction_clearance(
    n0: Vector,
    n1: Vector,
    start: tuple[Vector, Vector, Vector, Vector],
    end: tuple[Vector, Vector, Vector, Vector],
) -> float:
    """Return the best clearance that one of the directions n0, n1 and their mean proves for both ends (rung 4)."""
    best = -np.inf
    size0, size1 = norm(n0), norm(n1)
    middle = add(scale(1.0 / size0, n0), scale(1.0 / size1, n1)) if size0 > 0.0 and size1 > 0.0 else n0
    for w in (n0, n1, middle):
        low0 = dual_bound(w, start[0], start[1], start[2], start[3])
        low1 = dual_bound(w, end[0], end[1], end[2], end[3])
        best = max(best, min(low0, low1))
    return best


@njit(cache=True, nogil=True)
def hull_clearance(
    start: tuple[Vector, Vector, Vector, Vector], end: tuple[Vector, Vector, Vector, Vector]
) -> float:
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
def climb_pair(
    i: int,
    j: int,
    image: tuple[int, int, int],
    kind: int,
    motion: StepMotion,
    edges: IntArray,
    spheres: Spheres,
    slack: float,
    best: Extremes,
) -> None:
    """Settle one pair of edges by the cheapest rung that does, and keep what it adds to the step's extremes."""
    shift0, shift1 = lattice_vector(image, motion.cell0), lattice_vector(image, motion.cell1)
    centre0 = subtract(add(row(spheres.mid0, j), shift0), row(spheres.mid0, i))
    centre1 = subtract(add(row(spheres.mid1, j), shift1), row(spheres.mid1, i))
    reach = spheres.half[i] + spheres.half[j]
    rounding = slack + DUAL_ERROR * (norm(centre0) + norm(centre1) + reach)
    drift = subtract(centre1, centre0)
    gap = 0.5 * (norm(add(centre0, centre1)) - norm(drift)) - reach - rounding
    far = motion_bound(i, j, spheres, shift0, shift1)
    if gap > 0.0 and is_idle(gap, far, kind, best):
        best.rung_pairs[BROAD_PHASE] += 1
        return
    a0, b0 = row(motion.x0, edges[i, 0]), row(motion.x0, edges[i, 1])
    a1, b1 = row(motion.x1, edges[i, 0]), row(motion.x1, edges[i, 1])
    c0, d0 = add(row(motion.x0, edges[j, 0]), shift0), add(row(motion.x0, edges[j, 1]), shift0)
    c1, d1 = add(row(motion.x1, edges[j, 0]), shift1), add(row(motion.x1, edges[j, 1]), shift1)
    slab = slab_bound(centre0, centre1, (subtract(b0, a0), subtract(d0, c0)), (subtract(b1, a1), subtract(d1, c1)))
    gap = max(gap, slab - rounding)
    if gap > 0.0 and is_idle(gap, far, kind, best):
        best.rung_pairs[BROAD_PHASE] += 1
        return
    _, _, n0 = closest_points(a0, b0, c0, d0)
    _, _, n1 = closest_points(a1, b1, c1, d1)
    low0 = max(dual_bound(n0, a0, b0, c0, d0) - slack, gap)
    low1 = max(dual_bound(n1, a1, b1, c1, d1) - slack, gap)
    rho = relative_motion(a0, b0, c0, d0, a1, b1, c1, d1) + slack
    keep_nu(i, j, kind, norm(n0), norm(n1), low0, low1, edges, best)
    keep_ratio(i, j, rho, low0, low1, edges, best)
    rung, clearance = BROAD_PHASE, max(gap, 0.5 * (low0 + low1 - rho))
    if gap <= 0.0:
        rung = RELATIVE_MOTION
        if clearance <= 0.0:
            rung, clearance = DIRECTION, direction_clearance(n0, n1, (a0, b0, c0, d0), (a1, b1, c1, d1)) - slack
        if clearance <= 0.0:
            rung, clearance = HULL, hull_clearance((a0, b0, c0, d0), (a1, b1, c1, d1)) - slack
        if clearance <= 0.0:
            rung, clearance = OPEN, 0.0
    best.rung_pairs[rung] += 1
    if clearance < best.least[kind]:
        best.least[kind] = clearance
        write_pair(best.witness[kind], edges, i, j)


@njit(cache=True, nogil=True)
def motion_bound(i: int, j: int, spheres: Spheres, shift0: Vector, shift1: Vector) -> float:
    """Return an upper bound of ρ that needs no corners."""
    return spheres.motion[i] + spheres.motion[j] + norm(subtract(shift1, shift0))


@njit(cache=True, nogil=True)
def is_idle(gap: float, far: float, kind: int, best: Extremes) -> bool:
    """Return whether a pair at least `gap` apart, moving at most `far`, can change none of the step's extremes."""
    nearest = min(best.values[NU0_PROVEN], best.values[NU1_PROVEN])
    return gap >= best.least[kind] and gap >= nearest and far <= 2.0 * gap * best.values[RATIO]


@njit(cache=True, nogil=True)
def keep_nu(
    i: int, j: int, kind: int, near0: float, near1: float, low0: float, low1: float, edges: IntArray, best: Extremes
) -> None:
    """Update ν at both ends with one pair."""
    best.values[NU0_PROVEN] = min(best.values[NU0_PROVEN], low0)
    best.values[NU1_PROVEN] = min(best.values[NU1_PROVEN], low1)
    best.values[NU1] = min(best.values[NU1], near1)
    if near0 < best.values[NU0]:
        best.values[NU0] = near0
        best.nu_class[0] = kind
        write_pair(best.nu_witness, edges, i, j)


@njit(cache=True, nogil=True)
def keep_ratio(i: int, j: int, rho: float, low0: float, low1: float, edges: IntArray, best: Extremes) -> None:
    """Update the greatest ρ/(d0 + d1) with one pair; infinite where no distance is proved."""
    apart = low0 + low1
    ratio = rho / apart if apart > 0.0 else np.inf
    if ratio > best.values[RATIO]:
        best.values[RATIO] = ratio
        write_pair(best.ratio_witness, edges, i, j)


@njit(cache=True, nogil=True)
def write_pair(witness: IntArray, edges: IntArray, i: int, j: int) -> None:
    """Write the four vertices of a pair of edges."""
    witness[0], witness[1] = edges[i, 0], edges[i, 1]
    witness[2], witness[3] = edges[j, 0], edges[j, 1]


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
def climb_local(
    motion: StepMotion, edges: IntArray, local_pairs: IntArray, end_terms: IntArray, spheres: Spheres, slack: float
) -> Extremes:
    """Return the extremes over the pairs that lie next to each other on their strand, and the end terms of ν.

    The end terms (a vertex against its neighbour, or the neighbour's edge) belong to ν and to the ball rungs alone: a
    contact there folds an open end back on itself and lets nothing pass.
    """
    best = fresh_extremes()
    for k in range(len(local_pairs)):
        climb_pair(local_pairs[k, 0], local_pairs[k, 1], (0, 0, 0), 0, motion, edges, spheres, slack, best)
    for k in range(len(end_terms)):
        a, b, c, d = end_terms[k]
        _, _, n0 = closest_points(row(motion.x0, a), row(motion.x0, b), row(motion.x0, c), row(motion.x0, d))
        _, _, n1 = closest_points(row(motion.x1, a), row(motion.x1, b), row(motion.x1, c), row(motion.x1, d))
        near0, near1 = norm(n0), norm(n1)
        best.values[NU0_PROVEN] = min(best.values[NU0_PROVEN], near0 * (1.0 - DUAL_ERROR) - slack)
        best.values[NU1_PROVEN] = min(best.values[NU1_PROVEN], near1 * (1.0 - DUAL_ERROR) - slack)
        best.values[NU1] = min(best.values[NU1], near1)
        if near0 < best.values[NU0]:
            best.values[NU0], best.nu_class[0] = near0, 0
            best.nu_witness[0], best.nu_witness[1], best.nu_witness[2], best.nu_witness[3] = a, b, c, d
    return best


@njit(cache=True, nogil=True)
def climb_candidates(
    motion: StepMotion,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    pads: FloatArray,
    periodic: bool,
    spheres: Spheres,
    slack: float,
    best: Extremes,
) -> tuple[float, int]:
    """Climb every pair whose padded spheres meet; return the greatest drift of an image among them, and their count."""
    radii = spheres.half + pads
    pairs, images = candidate_pairs(spheres.mid0, spheres.mid1, radii, motion.cell0, motion.cell1, periodic)
    drift, move = 0.0, motion.cell1 - motion.cell0
    tested = 0
    for k in range(len(pairs)):
        i, j = pairs[k]
        image = (images[k, 0], images[k, 1], images[k, 2])
        home = image[0] == 0 and image[1] == 0 and image[2] == 0
        if home and are_neighbours(i, j, following):
            continue
        if not home:
            drift = max(drift, norm(lattice_vector(image, move)))
        kind = 1 if trace[i] == trace[j] else 2
        climb_pair(i, j, image, kind, motion, edges, spheres, slack, best)
        tested += 1
    return drift, tested


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

    Guarantee
    ---------
    Proven: if the rung is not OPEN, no two edges that do not share a vertex meet at any time of the step, in any image.
    """
    displacement, vertex = greatest_displacement(motion.x0, motion.x1)
    slack = PLACING_ERROR * greatest_coordinate(motion) if periodic else 0.0
    spheres = spheres_of(motion, edges)
    local = climb_local(motion, edges, local_pairs, end_terms, spheres, slack)
    has_self, has_inter = has_pairs(trace, following, periodic)
    edge_length = 2.0 * spheres.half.mean() if len(edges) else 0.0
    reach = min(local.values[NU0], edge_length)
    best, drift = copy_extremes(local), 0.0
    while len(edges) > 0:
        pads = np.maximum(0.5 * reach, 0.5 * RATIO_REACH * spheres.motion)
        best = copy_extremes(local)
        drift, _ = climb_candidates(motion, edges, following, trace, pads, periodic, spheres, slack, best)
        lost = (has_self and best.least[1] > reach) or (has_inter and best.least[2] > reach)
        if not lost or reach >= WIDEST_REACH * edge_length:
            break
        reach = min(2.0 * reach + 0.1 * edge_length, WIDEST_REACH * edge_length)
    return conclude(best, displacement, vertex, drift, reach, has_self, has_inter)


@njit(cache=True, nogil=True)
def greatest_coordinate(motion: StepMotion) -> float:
    """Return the greatest coordinate that placing an image can meet, Å."""
    cells = np.abs(motion.cell0).sum() + np.abs(motion.cell1).sum()
    return max(np.abs(motion.x0).max(), np.abs(motion.x1).max()) + cells


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
    best: Extremes, displacement: float, vertex: int, drift: float, reach: float, has_self: bool, has_inter: bool
) -> StepMeasure:
    """Return the step's measure: the ball rungs, the rung of the step, and clearances capped at what was searched."""
    counts = best.rung_pairs.copy()
    clearances, witness = best.least.copy(), best.witness.copy()
    moved = displacement * (1.0 + 8.0 * UNIT_ROUNDOFF)
    ball = best.values[NU0_PROVEN] - 2.0 * moved - drift
    two_frame_ball = 0.5 * (best.values[NU0_PROVEN] + best.values[NU1_PROVEN] - 2.0 * moved - drift)
    rung = BROAD_PHASE
    for k in range(BROAD_PHASE, N_RUNGS):
        if counts[k] > 0:
            rung = k
    if max(ball, two_frame_ball) > 0.0:
        rung = BALL if ball > 0.0 else TWO_FRAME_BALL
        total = counts.sum()
        counts[:] = 0
        counts[rung] = total
        for kind in range(3):
            clearances[kind] = max(clearances[kind], max(ball, two_frame_ball))
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
    )
