"""The rung of the ladder that settles a pair of edges, and what the pair adds to the extremes of its step.

Here are rungs 2 to 4, and the end terms of ν. For the whole ladder see `mdtopo.ladder`.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.contacts import corners_of
from mdtopo.curves import StepMotion
from mdtopo.extremes import (
    NU0,
    NU0_PROVEN,
    NU1,
    NU1_PROVEN,
    RATIO,
    Extremes,
    changes_nu,
    keep_clearance,
    keep_nu,
    keep_ratio,
)
from mdtopo.geometry.distances import closest_points, dual_bound
from mdtopo.geometry.lattice import basis_of, lattice_vector
from mdtopo.geometry.pairs import (
    BOUND_ERROR,
    Corners,
    axis_gap,
    cheap_bounds,
    direction_clearance,
    hull_clearance,
    is_far,
    is_idle,
    line_bound,
    relative_motion,
)
from mdtopo.geometry.vectors import add, norm, row, subtract
from mdtopo.reach import RATIO_REACH
from mdtopo.records import Rung
from mdtopo.spheres import HALF, MID0, MID1, MOTION, SPAN0, SPAN1, Spheres, part_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BROAD_PHASE, RELATIVE_MOTION = int(Rung.BROAD_PHASE), int(Rung.RELATIVE_MOTION)
DIRECTION = int(Rung.DIRECTION)

RATIO_GUARD = 1.0 - 1e-15
"""A ratio this much below the greatest one is not looked at: a product and a quotient are rounded differently."""


@njit(cache=True, nogil=True)
def settle_pair(
    start: Corners,
    end: Corners,
    bounds: tuple[float, float, float, float],
    least: float,
    placing: float,
) -> tuple[float, float, float, float, float, int, float]:
    """Settle one pair of edges by the cheapest rung up to 4 that does.

    Parameters
    ----------
    start, end : Corners
        Ends of the two edges at both ends of the step.
    bounds : tuple of 4 floats
        A gap of the slabs across the line of centres, the greatest gap of any slabs, and the distances at both ends;
        all of them lower bounds, proven.
    least : float
        The least clearance of the pair's class so far.
    placing : float
        Rounding of the positions, Å.

    Returns
    -------
    near0, near1, low0, low1 : float
        Distances at both ends: by closest points, and proven.
    rho : float
        Greatest relative motion of two corners.
    rung : int
        Which rung settles the pair.
    clearance : float
        The best that rungs 2, 3 and 5 prove; not positive where none of the rungs does. The hull is measured only where
        the cheaper ones leave the pair at or below `least`. It is never below the slabs' gap but for rounding, whatever
        the direction of these.
    """
    gap, apart, low0, low1 = bounds
    _, _, n0 = closest_points(start[0], start[1], start[2], start[3])
    _, _, n1 = closest_points(end[0], end[1], end[2], end[3])
    low0 = max(dual_bound(n0, start[0], start[1], start[2], start[3]) - placing, low0)
    low1 = max(dual_bound(n1, end[0], end[1], end[2], end[3]) - placing, low1)
    rho = relative_motion(start, end) + placing
    rung, clearance = BROAD_PHASE, max(max(gap, 0.5 * (low0 + low1 - rho)), apart)
    # tests are for what is proved, so that a NaN proves nothing
    if not gap > 0.0:
        rung = RELATIVE_MOTION
        if not 0.5 * (low0 + low1 - rho) > 0.0 and not apart > max(least, 0.0):
            rung, enough = DIRECTION, max(least, 0.0) + placing
            clearance = max(clearance, direction_clearance(n0, n1, start, end, enough) - placing)
    if 0.0 < clearance <= least:
        clearance = max(clearance, hull_clearance(start, end) - placing)
    return norm(n0), norm(n1), low0, low1, rho, rung, clearance


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
    """Climb a list of pairs up to rung 4, and return the greatest drift of an image among them, Å.

    Images are left out whose slabs keep them further away than `first_reach`: some are listed by chance only.
    Pairs that no rung settles are marked in `is_open`. Where the list is not the local one, pairs that are local are
    passed over: they have been climbed already. A pair is settled in full unless its cheap bounds show that it can
    change none of the step's extremes. What it adds to them is kept; of a pair that stays open all but its clearance. A
    pair that the search may miss, as it is further apart than `first_reach` and has a small ratio, is never the
    greatest ratio. (Arrays are named once, outside the loop: each time that one is taken out of a record, or handed to
    a function, its references are counted, which costs more than settling a pair.)
    """
    x0, x1 = motion.x0, motion.x1
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    rows, image_move = spheres.rows, 0.0
    values, least, rung_pairs = best.values, best.least, best.rung_pairs
    greatest_drift, image, kind = 0.0, (0, 0, 0), 0
    shift0, shift1 = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        centre0 = subtract(part_of(rows, j, MID0), part_of(rows, i, MID0))
        centre1 = subtract(part_of(rows, j, MID1), part_of(rows, i, MID1))
        if not local:
            if len(images) > 0:
                image = (images[k, 0], images[k, 1], images[k, 2])
            kind = 1 if trace[i] == trace[j] else 2
            if image != (0, 0, 0):
                shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
                centre0, centre1 = add(centre0, shift0), add(centre1, shift1)
                image_move = norm(subtract(shift1, shift0))
            elif are_neighbours(i, j, following):
                continue
            else:
                shift0, shift1, image_move = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
        f0, g0 = part_of(rows, i, SPAN0), part_of(rows, j, SPAN0)
        f1, g1 = part_of(rows, i, SPAN1), part_of(rows, j, SPAN1)
        halves = rows[i, HALF] + rows[j, HALF]
        if image_move > greatest_drift:
            gap, _, _, _ = cheap_bounds(centre0, centre1, f0, g0, f1, g1, halves, slack)
            if not gap > first_reach:
                greatest_drift = image_move
        nearest = max(least[kind], max(values[NU0], values[NU1]))
        moved = rows[i, MOTION] + rows[j, MOTION] + image_move + slack
        if is_far(centre0, centre1, f0, g0, f1, g1, halves, moved, nearest, values[RATIO], slack):
            continue
        gap, low0, low1, rho = cheap_bounds(centre0, centre1, f0, g0, f1, g1, halves, slack)
        along = axis_gap(centre0, centre1, f0, g0, f1, g1)
        boxed_off, apart = gap > 0.0 or along > 0.0, max(gap, along - slack)
        nu0, nu1, ratio = values[NU0], values[NU1], values[RATIO]
        idle = is_idle(apart, low0, low1, rho, least[kind], nu0, nu1, ratio)
        if not idle:
            rounding = slack + BOUND_ERROR * (norm(centre0) + norm(centre1) + halves)
            low0 = max(low0, line_bound(centre0, f0, g0) - rounding)
            low1 = max(low1, line_bound(centre1, f1, g1) - rounding)
            idle = is_idle(apart, low0, low1, rho, least[kind], nu0, nu1, ratio)
        if idle:
            rung_pairs[RELATIVE_MOTION] += not boxed_off
            continue
        start, end = corners_of(i, j, shift0, shift1, x0, x1, edges)
        near0, near1, low0, low1, rho, rung, clearance = settle_pair(
            start, end, (gap, apart, low0, low1), least[kind], placing
        )
        if changes_nu(near0, near1, low0, low1, values):
            keep_nu(edges, i, j, kind, near0, near1, low0, low1, best)
        counts = kind == 0 or near0 + near1 <= 2.0 * first_reach or RATIO_REACH * rho >= low0 + low1
        if counts and not rho < values[RATIO] * (low0 + low1) * RATIO_GUARD:
            keep_ratio(edges, i, j, rho, low0, low1, best)
        if not clearance > 0.0:
            is_open[k] = True
            continue
        if clearance <= least[kind]:
            keep_clearance(edges, i, j, kind, clearance, best)
        if rung != BROAD_PHASE and not boxed_off:
            rung_pairs[rung] += 1
    return greatest_drift


@njit(cache=True, nogil=True, inline="always")
def are_neighbours(i: int, j: int, following: IntArray) -> bool:
    """Return whether two edges share a vertex or have one edge between them: the local pairs, climbed on their own."""
    after_i, after_j = following[i], following[j]
    if i == j or after_i == j or after_j == i:
        return True
    return (after_i >= 0 and following[after_i] == j) or (after_j >= 0 and following[after_j] == i)


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
