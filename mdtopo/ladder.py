"""The rungs of the certificate ladder over all pairs of edges of one step.

Two moving edges (a, b) and (c, d) stay apart as long as the origin stays outside the convex hull of
V(t) = {a-c, a-d, b-c, b-d}, each of which moves linearly. With d0, d1 the edges' distances at the two ends, and ρ the
greatest motion of a member of V:

====  ================  ==============================================================  =======================
rung  name              settles the pair when                                           clearance
====  ================  ==============================================================  =======================
0     ball              every vertex moves less than ν0/2 (the paper)                   ν0 - 2m
1     two-frame ball    every vertex moves less than (ν0 + ν1)/2                        (ν0 + ν1)/2 - m
2     broad phase       the swept boxes of the edges, or the slabs across the line      the slabs' gap
                        of their centres, are apart
3     relative motion   ρ < d0 + d1                                                     (d0 + d1 - ρ)/2
4     direction         one w in {n0, n1, n0 + n1} has w·v > 0 for all v at both ends   min w·v/|w|
5     hull              the origin is outside conv(V0 ∪ V1)                             d*(V0 ∪ V1)
6     bisection         rung 3 holds in each piece of the step                          least over the pieces
7     exact             the edges pass through each other, or provably never meet       0
====  ================  ==============================================================  =======================

Guarantee: a clearance is a proven lower bound of the pair's distance at every time of the step, rounding included. What
no rung settles stays OPEN here, and goes to exact arithmetic (`mdtopo.passages`).

The numbers of a step (ν, greatest ratio, least clearance of each class) are exact minima and maxima over the pairs in
reach. A pair is measured in full only if a cheap bound does not already show that it cannot change any of them.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.contacts import Found, both_found, corners_of, decide_open
from mdtopo.curves import StepMotion
from mdtopo.extremes import (
    N_RUNGS,
    NU0,
    NU0_PROVEN,
    NU1,
    NU1_PROVEN,
    RATIO,
    Extremes,
    copy_extremes,
    fresh_extremes,
    keep_clearance,
    keep_nu,
    keep_ratio,
)
from mdtopo.geometry.broadphase import candidate_pairs, images_can_meet
from mdtopo.geometry.bundles import near_edges
from mdtopo.geometry.distances import UNIT_ROUNDOFF, closest_points, dual_bound
from mdtopo.geometry.lattice import Counts, basis_of, lattice_vector
from mdtopo.geometry.pairs import (
    BOUND_ERROR,
    cheap_bounds,
    direction_clearance,
    hull_clearance,
    is_apart_along_axis,
    is_far,
    is_idle,
    line_bound,
    relative_motion,
)
from mdtopo.geometry.vectors import add, dot, norm, row, scale, subtract
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BALL, TWO_FRAME_BALL, BROAD_PHASE = int(Rung.BALL), int(Rung.TWO_FRAME_BALL), int(Rung.BROAD_PHASE)
RELATIVE_MOTION, DIRECTION, HULL = int(Rung.RELATIVE_MOTION), int(Rung.DIRECTION), int(Rung.HULL)
OPEN = int(Rung.OPEN)

RATIO_REACH = 1.25
"""Pairs whose ratio is at least 1/1.25 = 0.8 are always in reach: they have d0 + d1 ≤ 1.25 ρ, and ρ is at most the sum
of the two edges' greatest displacements."""

REACH_GUARD = 1.0 + 1e-9
"""And this much further: rounding of a distance, a motion or a ratio loses no pair."""

WIDEST_REACH = 4.0
"""The search for a class without any pair in reach stops at this multiple of the mean edge length."""

FIRST_REACH = 1.4
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
    found : Found
        Passages, and pairs that are left to exact arithmetic.
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
    found: Found


class Spheres(NamedTuple):
    """The edges of a step as moving spheres: midpoints and half edges at both ends, greatest half length and motion."""

    mid0: FloatArray
    mid1: FloatArray
    span0: FloatArray
    span1: FloatArray
    half: FloatArray
    motion: FloatArray


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


@njit(cache=True, nogil=True, inline="always")
def settle_pair(
    i: int,
    j: int,
    image: Counts,
    kind: int,
    bounds: tuple[float, float, float],
    is_boxed_off: bool,
    motion: StepMotion,
    edges: IntArray,
    placing: float,
    first_reach: float,
    best: Extremes,
) -> bool:
    """Settle one pair of edges by the cheapest rung up to 5 that does, and return whether one did.

    What the pair adds to the step's extremes is kept; of a pair that stays open all but its clearance. A pair that the
    search may miss, as it is further apart than `first_reach` and has a small ratio, is never the greatest ratio.
    """
    gap, low0, low1 = bounds
    start, end = corners_of(i, j, image, motion, edges)
    _, _, n0 = closest_points(start[0], start[1], start[2], start[3])
    _, _, n1 = closest_points(end[0], end[1], end[2], end[3])
    low0 = max(dual_bound(n0, start[0], start[1], start[2], start[3]) - placing, low0)
    low1 = max(dual_bound(n1, end[0], end[1], end[2], end[3]) - placing, low1)
    rho = relative_motion(start, end) + placing
    near0, near1 = norm(n0), norm(n1)
    keep_nu(edges, i, j, kind, near0, near1, low0, low1, best)
    if kind == 0 or near0 + near1 <= 2.0 * first_reach or RATIO_REACH * rho >= low0 + low1:
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
            return False
    if rung != BROAD_PHASE and not is_boxed_off:
        best.rung_pairs[rung] += 1
    keep_clearance(edges, i, j, kind, clearance, best)
    return True


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
    first_reach: float,
    best: Extremes,
    is_open: BoolArray,
) -> float:
    """Climb a list of pairs up to rung 5, and return the greatest drift of an image among them, Å.

    Pairs that no rung settles are marked in `is_open`. Where the list is not the local one, pairs that are local are
    passed over: they have been climbed already. A pair is settled in full unless its cheap bounds show that it can
    change none of the step's extremes.
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
            if len(images) > 0:
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
        boxed_off = gap > 0.0 or is_apart_along_axis(centre0, centre1, f0, g0, f1, g1)
        if not idle:
            bounds = (gap, low0, low1)
            is_open[k] = not settle_pair(
                i, j, image, kind, bounds, boxed_off, motion, edges, placing, first_reach, best
            )
        elif not boxed_off:
            rung_pairs[RELATIVE_MOTION] += 1
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


@njit(cache=True, nogil=True, inline="always")
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
    Proven: if the rung is not OPEN and no passage is found, no two edges that do not share a vertex meet at any time of
    the step, in any image; and each passage that is found is one.
    """
    displacement, vertex = greatest_displacement(motion.x0, motion.x1)
    slack = PLACING_ERROR * (greatest_coordinate(motion) + motion.placing) + LEAST_SLACK
    placing = slack if periodic else 0.0  # without a cell, coordinates are as stored, and exact
    spheres = spheres_of(motion, edges)
    local, no_images = fresh_extremes(), np.empty((0, 3), dtype=np.int64)
    local_open = np.zeros(len(local_pairs), dtype=np.bool_)
    climb_pairs(
        local_pairs, no_images, True, motion, edges, following, trace, spheres, slack, placing, 0.0, local, local_open
    )
    local_found = decide_open(local_pairs, no_images, local_open, True, motion, edges, trace, placing, local)
    found = local_found
    meet_end_terms(motion, end_terms, placing, local)
    has_self, has_inter = has_pairs(trace, following, periodic)
    edge_length = mean_edge_length(spheres)
    widest = WIDEST_REACH * edge_length
    drift, best = 0.0, local
    first_reach = min(FIRST_REACH * local.values[NU0], edge_length)
    reach = max(first_reach, min(SPARE_REACH * likely_reach, widest))
    wanted, countable = 0.0, True
    while len(edges) > 0:
        pads = search_pads(spheres, reach, local.values[RATIO], slack)
        pairs, images, countable = pairs_in_reach(motion, periodic, edges, trace, spheres, pads)
        if not countable:
            break
        best = copy_extremes(local)
        is_open = np.zeros(len(pairs), dtype=np.bool_)
        drift = climb_pairs(
            pairs, images, False, motion, edges, following, trace, spheres, slack, placing, first_reach, best, is_open
        )
        others = decide_open(pairs, images, is_open, False, motion, edges, trace, placing, best)
        found = both_found(local_found, others)
        wanted = max(best.least[1] if has_self else 0.0, best.least[2] if has_inter else 0.0)
        if wanted <= reach or reach >= widest:
            break
        reach = min(min(wanted, 2.0 * reach + 0.1 * edge_length), widest)
    needed = min(wanted, reach)
    return conclude(best, displacement, vertex, drift, placing, reach, needed, countable, has_self, has_inter, found)


@njit(cache=True, nogil=True)
def mean_edge_length(spheres: Spheres) -> float:
    """Return the mean length of the edges, each at the end of the step where it is longer, Å."""
    total = 0.0
    for half in spheres.half:
        total += 2.0 * half
    return total / max(len(spheres.half), 1)


@njit(cache=True, nogil=True)
def search_pads(spheres: Spheres, reach: float, ratio: float, slack: float) -> FloatArray:
    """Return by how much the edges are enlarged, Å, so that all pairs that count are found to meet.

    Two edges of which the enlarged ones never meet stay more than `reach` apart. Rung 3 proves as much, since ρ is at
    most the sum of their motions: whether such a pair is looked at cannot be seen in a clearance. And their ratio is
    below both 1/RATIO_REACH and `ratio`, the greatest one of a pair that is known already.
    """
    share = 0.5 * RATIO_REACH if ratio * RATIO_REACH <= 1.0 else 0.5 / ratio
    pads = np.empty(len(spheres.half))
    for k in range(len(pads)):
        pads[k] = max(0.5 * (reach + spheres.motion[k]), share * spheres.motion[k]) * REACH_GUARD + slack
    return pads


@njit(cache=True, nogil=True)
def pairs_in_reach(
    motion: StepMotion, periodic: bool, edges: IntArray, trace: IntArray, spheres: Spheres, pads: FloatArray
) -> tuple[IntArray, IntArray, bool]:
    """Return pairs of edges, their images, and whether all were found; see `candidate_pairs` and `near_edges`.

    Only where images can meet are they looked for: the search without them is several times faster.
    """
    if periodic:
        radii = spheres.half + pads
        basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
        if images_can_meet(spheres.mid0, spheres.mid1, radii, basis0, basis1):
            return candidate_pairs(spheres.mid0, spheres.mid1, radii, motion.cell0, motion.cell1, periodic)
    return near_edges(motion.x0, motion.x1, edges, trace, pads), np.empty((0, 3), dtype=np.int64), True


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
    found: Found,
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
        if best.least[kind] > reach:  # whether the search met a pair out there is chance
            witness[kind] = -1
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
        found,
    )
