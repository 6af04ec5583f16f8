"""How close each vertex came in one step: the clearance of every edge, not only of the pair that came closest.

The rungs are those of `mdtopo.ladder`. There a pair is measured in full only where it may be the closest of the step;
here where it may be the closest of one of its two edges. So this costs more than the ladder, and is done for one step
of many.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.bisection import bisected_clearance
from mdtopo.geometry.lattice import Basis, Counts, basis_of, lattice_vector
from mdtopo.geometry.pairlanes import (
    ALONG,
    END,
    GAP,
    LOW0,
    LOW1,
    RHO,
    ROOM,
    START,
    TURN,
    corners_at,
    ends_of_edges,
    fresh_lanes,
    measure_lanes,
    shift_edge,
    write_edge,
)
from mdtopo.geometry.pairs import BOUND_ERROR, Corners, hull_clearance, is_far, relative_motion
from mdtopo.geometry.passage import PASSES, moving_pair, passages
from mdtopo.geometry.vectors import Vector, add, dot, norm, subtract
from mdtopo.ladder import WIDEST_REACH
from mdtopo.reach import REACH_GUARD, has_pairs, pairs_in_reach
from mdtopo.rungs import are_neighbours
from mdtopo.spheres import (
    HALF,
    LEAST_SLACK,
    MID0,
    MID1,
    MOTION,
    PLACING_ERROR,
    SPAN0,
    SPAN1,
    Spheres,
    edge_rows,
    greatest_coordinate,
    mean_edge_length,
    part_of,
    spheres_of,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]


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
    further away than the nearest edge that is known already is not looked for, nor what is further away than
    `WIDEST_REACH` mean edge lengths, which no value exceeds.
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
    spheres, rows, least = spheres_of(motion, edges), edge_rows(motion, edges), np.full(len(edges), np.inf)
    ends = ends_of_edges(motion.x0, motion.x1, edges)
    has_self, has_inter = has_pairs(trace, following, periodic)
    widest = WIDEST_REACH * mean_edge_length(spheres) if has_self or has_inter else np.inf
    ceilings, no_images = np.full(len(edges), widest), np.empty((0, 3), dtype=np.int64)
    lower_ceilings(local_pairs, rows, slack, ceilings)
    if has_self or has_inter:
        pads = ceiling_pads(ceilings, spheres, slack)
        pairs, images, countable = pairs_in_reach(motion, periodic, edges, trace, spheres, pads)
        if not countable:
            return np.zeros(len(edges))
        pairs, images = near_pairs(pairs, images, motion, following, rows, slack, ceilings)
        lower_bounds(pairs, images, motion, ends, slack, placing, least)
    lower_bounds(local_pairs, no_images, motion, ends, slack, placing, least)
    for e in range(len(edges)):
        least[e] = min(least[e], ceilings[e])
        if least[e] == np.inf:
            least[e] = np.nan
    return least


@njit(cache=True, nogil=True)
def lower_ceilings(pairs: IntArray, rows: FloatArray, slack: float, ceilings: FloatArray) -> None:
    """Lower the ceiling of both edges of each pair, none of them an image, to what its clearance cannot exceed.

    That is the distance of two points, with room for rounding: the clearance is below it in rounding too.
    """
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        centre0 = subtract(part_of(rows, j, MID0), part_of(rows, i, MID0))
        centre1 = subtract(part_of(rows, j, MID1), part_of(rows, i, MID1))
        start = squared_distance(centre0, part_of(rows, i, SPAN0), part_of(rows, j, SPAN0))
        end = squared_distance(centre1, part_of(rows, i, SPAN1), part_of(rows, j, SPAN1))
        ceiling = np.sqrt(min(start, end)) * REACH_GUARD + slack
        ceilings[i], ceilings[j] = min(ceilings[i], ceiling), min(ceilings[j], ceiling)


@njit(cache=True, nogil=True)
def squared_distance(centre: Vector, first: Vector, second: Vector) -> float:
    """Return the least squared distance of an end of one edge to one of the other, or of their midpoints, Å²."""
    across, along = subtract(second, first), add(first, second)
    ac, bd, ad, bc = subtract(centre, across), add(centre, across), add(centre, along), subtract(centre, along)
    ends = min(min(dot(ac, ac), dot(bd, bd)), min(dot(ad, ad), dot(bc, bc)))
    return min(ends, dot(centre, centre))


@njit(cache=True, nogil=True)
def ceiling_pads(ceilings: FloatArray, spheres: Spheres, slack: float) -> FloatArray:
    """Return by how much the edges are enlarged, Å, so that every pair that may lower one of its two bounds is found.

    With any T, max(T/2, c - T/2) of one edge and of another are together not less than the greater of their c. Where T
    is about the middle of them, most pads are about half a ceiling. What is further apart by half of both motions has
    a clearance above both ceilings by the relative motion alone. For what rounding adds see `search_pads`.
    """
    half, pads = 0.5 * np.mean(ceilings), np.empty(len(ceilings))
    for e in range(len(ceilings)):
        pad = (max(half, ceilings[e] - half) + 0.5 * spheres.motion[e]) * REACH_GUARD + slack
        pads[e] = pad + 4.0 * BOUND_ERROR * (spheres.half[e] + spheres.motion[e] + pad)
    return pads


@njit(cache=True, nogil=True)
def near_pairs(
    pairs: IntArray,
    images: IntArray,
    motion: StepMotion,
    following: IntArray,
    rows: FloatArray,
    slack: float,
    ceilings: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Return the pairs, and their images, that are not local and may come nearer than a ceiling for all that slabs say.

    The ceilings of these are lowered.
    """
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    image, has_images = (0, 0, 0), len(images) > 0
    found, found_images, count = np.empty_like(pairs), np.empty_like(images), 0
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        if has_images:
            image = (images[k, 0], images[k, 1], images[k, 2])
        if image == (0, 0, 0) and are_neighbours(i, j, following):
            continue
        centre0, centre1, image_move = centres(rows, i, j, image, basis0, basis1)
        f0, g0 = part_of(rows, i, SPAN0), part_of(rows, j, SPAN0)
        f1, g1 = part_of(rows, i, SPAN1), part_of(rows, j, SPAN1)
        halves, moved = rows[i, HALF] + rows[j, HALF], rows[i, MOTION] + rows[j, MOTION] + image_move + slack
        wanted = max(ceilings[i], ceilings[j])
        if is_far(centre0, centre1, f0, g0, f1, g1, halves, moved, wanted, np.inf, slack):
            continue
        found[count, 0], found[count, 1] = i, j
        if has_images:
            found_images[count, 0], found_images[count, 1], found_images[count, 2] = image
        count += 1
        squared = min(squared_distance(centre0, f0, g0), squared_distance(centre1, f1, g1))
        ceiling = np.sqrt(squared) * REACH_GUARD + slack
        ceilings[i], ceilings[j] = min(ceilings[i], ceiling), min(ceilings[j], ceiling)
    return found[:count], found_images[:count]


@njit(cache=True, nogil=True, inline="always")
def centres(
    rows: FloatArray, i: int, j: int, image: Counts, basis0: Basis, basis1: Basis
) -> tuple[Vector, Vector, float]:
    """Return the vectors from midpoint to midpoint at both ends, and how far the image of the second edge moves."""
    centre0 = subtract(part_of(rows, j, MID0), part_of(rows, i, MID0))
    centre1 = subtract(part_of(rows, j, MID1), part_of(rows, i, MID1))
    if image == (0, 0, 0):
        return centre0, centre1, 0.0
    shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
    return add(centre0, shift0), add(centre1, shift1), norm(subtract(shift1, shift0))


@njit(cache=True, nogil=True)
def lower_bounds(
    pairs: IntArray,
    images: IntArray,
    motion: StepMotion,
    ends: FloatArray,
    slack: float,
    placing: float,
    least: FloatArray,
) -> None:
    """Lower the bound of both edges of each pair to what is proved of it; 0 where nothing is."""
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    lanes, has_images = fresh_lanes(), len(images) > 0
    for first in range(0, len(pairs), ROOM):
        count = min(ROOM, len(pairs) - first)
        for k in range(count):
            write_edge(lanes, 0, np.uint64(k), ends, pairs[first + k, 0])
            write_edge(lanes, 6, np.uint64(k), ends, pairs[first + k, 1])
            if has_images:
                image = (images[first + k, 0], images[first + k, 1], images[first + k, 2])
                shift_edge(lanes, np.uint64(k), lattice_vector(image, basis0), lattice_vector(image, basis1))
        measure_lanes(lanes, count, slack, placing)
        for k in range(count):
            gap, along, turn = lanes[GAP * ROOM + k], lanes[ALONG * ROOM + k], lanes[TURN * ROOM + k]
            still = 0.5 * (lanes[LOW0 * ROOM + k] + lanes[LOW1 * ROOM + k] - lanes[RHO * ROOM + k])
            bound = max(max(gap, along - slack), max(still, turn))
            if not bound > 0.0:
                bound = dear_clearance(corners_at(lanes, START, k), corners_at(lanes, END, k), placing)
            i, j = pairs[first + k, 0], pairs[first + k, 1]
            least[i], least[j] = min(least[i], bound), min(least[j], bound)


@njit(cache=True, nogil=True)
def dear_clearance(start: Corners, end: Corners, placing: float) -> float:
    """Return the clearance of one pair of edges that none of the cheap rungs settles, Å; 0 where none is proved.

    Parameters
    ----------
    start, end : Corners
        Ends of the two edges at both ends of the step.
    placing : float
        Rounding of the positions, Å.
    """
    clearance = hull_clearance(start, end) - placing
    # tests are for what is proved, so that a NaN proves nothing
    if not clearance > 0.0:
        state, _, _, _ = passages(start, end, placing)
        rho = relative_motion(start, end) + placing
        clearance = 0.0 if state == PASSES else bisected_clearance(moving_pair(start, end, placing), rho)
    return clearance if clearance > 0.0 else 0.0
