"""How close each vertex came in one step: the clearance of every edge, not only of the pair that came closest.

The rungs are those of `mdtopo.ladder`. There a pair is measured in full only where it may be the closest of the step;
here where it may be the closest of one of its two edges. So this costs more than the ladder, and is done for one step
of many.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.contacts import corners_of
from mdtopo.curves import StepMotion
from mdtopo.geometry.bisection import bisected_clearance
from mdtopo.geometry.distances import closest_points, dual_bound
from mdtopo.geometry.lattice import Counts, basis_of, lattice_vector
from mdtopo.geometry.pairs import (
    BOUND_ERROR,
    cheap_bounds,
    direction_clearance,
    hull_clearance,
    is_far,
    line_bound,
    relative_motion,
)
from mdtopo.geometry.passage import PASSES, moving_pair, passages
from mdtopo.geometry.vectors import add, norm, row, subtract
from mdtopo.ladder import WIDEST_REACH
from mdtopo.reach import REACH_GUARD, has_pairs, pairs_in_reach
from mdtopo.rungs import are_neighbours
from mdtopo.spheres import (
    LEAST_SLACK,
    PLACING_ERROR,
    SPAN0,
    SPAN1,
    Spheres,
    greatest_coordinate,
    mean_edge_length,
    part_of,
    spheres_of,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@njit(cache=True, nogil=True)
def vertex_clearances(
    motion: StepMotion,
    periodic: bool,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    local_pairs: IntArray,
    least: float,
) -> FloatArray:
    """Return a lower bound of how close each vertex's edges came to any other edge in one step, Å, shape (n,).

    Parameters
    ----------
    motion : StepMotion
        From `mdtopo.curves.step_motion`; it must be usable.
    periodic : bool
        Whether there are images.
    edges, following, trace, local_pairs : ndarray of int
        See `mdtopo.records.Traces`.
    least : float
        The clearance of the step, as the ladder proves it for every pair, Å; 0 where it proves none.

    Guarantee
    ---------
    Proven: a pair of edges that share no vertex, of which one ends in vertex v, in any periodic image, is at least so
    far apart at every time of the step; 0 where they meet, or this is not proved. NaN where v has no such pair. What is
    further away than every local pair (or, without one, than `WIDEST_REACH` mean edge lengths) is not looked for, and
    the value does not exceed that.
    """
    of_edge = edge_clearances(motion, periodic, edges, following, trace, local_pairs)
    found = np.full(len(motion.x0), np.nan)
    for e in range(len(edges)):
        if np.isnan(of_edge[e]):
            continue
        value = max(of_edge[e], least)
        for k in range(2):
            vertex = edges[e, k]
            if not found[vertex] <= value:
                found[vertex] = value
    return found


@njit(cache=True, nogil=True)
def edge_clearances(
    motion: StepMotion, periodic: bool, edges: IntArray, following: IntArray, trace: IntArray, local_pairs: IntArray
) -> FloatArray:
    """Return a lower bound of how close each edge came to any edge that shares no vertex with it, Å; NaN without one.

    Guarantee
    ---------
    As of `vertex_clearances`.
    """
    slack = PLACING_ERROR * (greatest_coordinate(motion) + motion.placing) + LEAST_SLACK
    placing = slack if periodic else 0.0  # without a cell, coordinates are as stored, and exact
    spheres, least = spheres_of(motion, edges), np.full(len(edges), np.inf)
    no_images = np.empty((0, 3), dtype=np.int64)
    lower_bounds(local_pairs, no_images, True, motion, edges, following, spheres, slack, placing, least)
    widest, reach = WIDEST_REACH * mean_edge_length(spheres), 0.0
    for e in range(len(edges)):
        reach = max(reach, min(least[e], widest))
    pads = np.empty(len(edges))
    for e in range(len(edges)):
        pads[e] = 0.5 * (reach + spheres.motion[e]) * REACH_GUARD + slack
    pairs, images, countable = pairs_in_reach(motion, periodic, edges, trace, spheres, pads)
    if not countable:
        return np.zeros(len(edges))
    lower_bounds(pairs, images, False, motion, edges, following, spheres, slack, placing, least)
    has_self, has_inter = has_pairs(trace, following, periodic)
    for e in range(len(edges)):
        if has_self or has_inter:
            least[e] = min(least[e], reach)
        elif least[e] == np.inf:
            least[e] = np.nan
    return least


@njit(cache=True, nogil=True)
def lower_bounds(
    pairs: IntArray,
    images: IntArray,
    local: bool,
    motion: StepMotion,
    edges: IntArray,
    following: IntArray,
    spheres: Spheres,
    slack: float,
    placing: float,
    least: FloatArray,
) -> None:
    """Lower the bound of both edges of each pair to what is proved of it; where not `local`, local pairs are left out.

    A pair whose cheap bounds show that it lowers neither is passed over.
    """
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    mid0, mid1, rows, half = spheres.mid0, spheres.mid1, spheres.rows, spheres.half
    moves, image_move, image = spheres.motion, 0.0, (0, 0, 0)
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        centre0, centre1 = subtract(row(mid0, j), row(mid0, i)), subtract(row(mid1, j), row(mid1, i))
        if not local:
            if len(images) > 0:
                image = (images[k, 0], images[k, 1], images[k, 2])
            if image != (0, 0, 0):
                shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
                centre0, centre1 = add(centre0, shift0), add(centre1, shift1)
                image_move = norm(subtract(shift1, shift0))
            elif are_neighbours(i, j, following):
                continue
            else:
                image_move = 0.0
        f0, g0 = part_of(rows, i, SPAN0), part_of(rows, j, SPAN0)
        f1, g1 = part_of(rows, i, SPAN1), part_of(rows, j, SPAN1)
        wanted = max(least[i], least[j])
        moved = moves[i] + moves[j] + image_move + slack
        if is_far(centre0, centre1, f0, g0, f1, g1, half[i] + half[j], moved, wanted, np.inf, slack):
            continue
        gap, low0, low1, rho = cheap_bounds(centre0, centre1, f0, g0, f1, g1, half[i] + half[j], slack)
        known = max(gap, 0.5 * (low0 + low1 - rho))
        if known > 0.0 and known >= wanted:
            continue
        rounding = slack + BOUND_ERROR * (norm(centre0) + norm(centre1) + half[i] + half[j])
        low0 = max(low0, line_bound(centre0, f0, g0) - rounding)
        low1 = max(low1, line_bound(centre1, f1, g1) - rounding)
        known = max(known, 0.5 * (low0 + low1 - rho))
        if known > 0.0 and known >= wanted:
            continue
        bound = max(known, pair_clearance(i, j, image, (gap, low0, low1), motion, edges, placing))
        least[i], least[j] = min(least[i], bound), min(least[j], bound)


@njit(cache=True, nogil=True)
def pair_clearance(
    i: int,
    j: int,
    image: Counts,
    bounds: tuple[float, float, float],
    motion: StepMotion,
    edges: IntArray,
    placing: float,
) -> float:
    """Return the clearance of one pair of edges by the cheapest rung that proves one, Å; 0 where none does.

    Parameters
    ----------
    i, j : int
        The edges.
    image : tuple of 3 int
        The image of the second one.
    bounds : tuple of 3 floats
        Proven already: of the distance at all times, and at both ends of the step.
    motion, edges, placing
        As for `mdtopo.rungs.climb_pairs`.
    """
    gap, low0, low1 = bounds
    shift0, shift1 = lattice_vector(image, basis_of(motion.cell0)), lattice_vector(image, basis_of(motion.cell1))
    start, end = corners_of(i, j, shift0, shift1, motion.x0, motion.x1, edges)
    _, _, n0 = closest_points(start[0], start[1], start[2], start[3])
    _, _, n1 = closest_points(end[0], end[1], end[2], end[3])
    low0 = max(dual_bound(n0, start[0], start[1], start[2], start[3]) - placing, low0)
    low1 = max(dual_bound(n1, end[0], end[1], end[2], end[3]) - placing, low1)
    rho = relative_motion(start, end) + placing
    clearance = max(gap, 0.5 * (low0 + low1 - rho))
    # tests are for what is proved, so that a NaN proves nothing
    if not clearance > 0.0:
        clearance = direction_clearance(n0, n1, start, end, np.inf) - placing
    if not clearance > 0.0:
        clearance = hull_clearance(start, end) - placing
    if not clearance > 0.0:
        state, _, _, _ = passages(start, end, placing)
        clearance = 0.0 if state == PASSES else bisected_clearance(moving_pair(start, end, placing), rho)
    return clearance if clearance > 0.0 else 0.0
