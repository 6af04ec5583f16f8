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
from mdtopo.geometry.lattice import Basis, basis_of, lattice_vector
from mdtopo.geometry.pairlanes import (
    ALONG,
    END,
    GAP,
    LOW0,
    LOW1,
    NEAREST,
    RHO,
    ROOM,
    START,
    TURN,
    corners_at,
    flag_far,
    fresh_lanes,
    measure_lanes,
    shift_edge,
    write_edge,
)
from mdtopo.geometry.pairs import BOUND_ERROR, Corners, hull_clearance, relative_motion
from mdtopo.geometry.passage import PASSES, moving_pair, passages
from mdtopo.ladder import WIDEST_REACH
from mdtopo.reach import REACH_GUARD, has_pairs, pairs_in_reach
from mdtopo.rungs import are_neighbours
from mdtopo.spheres import (
    LEAST_SLACK,
    PLACING_ERROR,
    Spheres,
    greatest_coordinate,
    mean_edge_length,
    spheres_of,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]

SOME = 8 * ROOM
"""Pairs that are sorted out before those that are left are measured."""


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
    spheres = spheres_of(motion, edges)
    has_self, has_inter = has_pairs(trace, following, periodic)
    widest = WIDEST_REACH * mean_edge_length(spheres) if has_self or has_inter else np.inf
    least, no_images = np.full(len(edges), widest), np.empty((0, 3), dtype=np.int64)
    lower_bounds(local_pairs, no_images, motion, edges, slack, placing, least)
    if has_self or has_inter:
        pads = ceiling_pads(least, spheres, slack)
        pairs, images, countable = pairs_in_reach(motion, periodic, edges, trace, spheres, pads)
        if not countable:
            return np.zeros(len(edges))
        for first in range(0, len(pairs), SOME):  # not all at once: what is measured leaves fewer of the others
            some, of_some = pairs[first : first + SOME], images[first : first + SOME]
            near, of_near = near_pairs(some, of_some, motion, edges, following, slack, least)
            lower_bounds(near, of_near, motion, edges, slack, placing, least)
    for e in range(len(edges)):
        if least[e] == np.inf:
            least[e] = np.nan
    return least


@njit(cache=True, nogil=True)
def ceiling_pads(ceilings: FloatArray, spheres: Spheres, slack: float) -> FloatArray:
    """Return by how much the edges are enlarged, Å, so that every pair that may lower one of its two bounds is found.

    With any T, max(T/2, c - T/2) of one edge and of another are together not less than the greater of their ceilings
    c. Where T is about the middle of them, most pads are about half a ceiling. A pair that is not found has a clearance
    above both ceilings, and slabs say so: see `search_pads`, for what rounding adds too.
    """
    half, pads = 0.5 * np.mean(ceilings), np.empty(len(ceilings))
    for e in range(len(ceilings)):
        pad = max(half, ceilings[e] - half) * REACH_GUARD + slack
        pads[e] = pad + 8.0 * BOUND_ERROR * (spheres.half[e] + spheres.motion[e] + pad)
    return pads


@njit(cache=True, nogil=True)
def near_pairs(
    pairs: IntArray,
    images: IntArray,
    motion: StepMotion,
    edges: IntArray,
    following: IntArray,
    slack: float,
    least: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Return the pairs, and their images, that are not local and may lower a bound for all that slabs say."""
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    lanes, far, has_images = fresh_lanes(), np.empty(ROOM, dtype=np.uint8), len(images) > 0
    image, found, found_images, count = (0, 0, 0), np.empty_like(pairs), np.empty_like(images), 0
    for first in range(0, len(pairs), ROOM):
        size = min(ROOM, len(pairs) - first)
        write_pairs(lanes, pairs, images, first, size, motion, edges, basis0, basis1)
        for k in range(size):
            lanes[NEAREST * ROOM + k] = max(least[pairs[first + k, 0]], least[pairs[first + k, 1]])
        flag_far(lanes, np.inf, slack, far)
        for k in range(size):
            i, j = pairs[first + k, 0], pairs[first + k, 1]
            if has_images:
                image = (images[first + k, 0], images[first + k, 1], images[first + k, 2])
                found_images[count, 0], found_images[count, 1], found_images[count, 2] = image
            found[count, 0], found[count, 1] = i, j
            if far[k] == 0 and not (image == (0, 0, 0) and are_neighbours(i, j, following)):
                count += 1
    return found[:count], found_images[:count]


@njit(cache=True, nogil=True)
def write_pairs(
    lanes: FloatArray,
    pairs: IntArray,
    images: IntArray,
    first: int,
    size: int,
    motion: StepMotion,
    edges: IntArray,
    basis0: Basis,
    basis1: Basis,
) -> None:
    """Write the corners of so many pairs into a batch, from pair `first` on."""
    x0, x1, has_images = motion.x0, motion.x1, len(images) > 0
    for k in range(size):
        write_edge(lanes, 0, np.uint64(k), x0, x1, edges, pairs[first + k, 0])
        write_edge(lanes, 6, np.uint64(k), x0, x1, edges, pairs[first + k, 1])
        if has_images:
            image = (images[first + k, 0], images[first + k, 1], images[first + k, 2])
            shift_edge(lanes, np.uint64(k), lattice_vector(image, basis0), lattice_vector(image, basis1))


@njit(cache=True, nogil=True)
def lower_bounds(
    pairs: IntArray,
    images: IntArray,
    motion: StepMotion,
    edges: IntArray,
    slack: float,
    placing: float,
    least: FloatArray,
) -> None:
    """Lower the bound of both edges of each pair to what is proved of it; 0 where nothing is."""
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    lanes = fresh_lanes()
    for first in range(0, len(pairs), ROOM):
        count = min(ROOM, len(pairs) - first)
        write_pairs(lanes, pairs, images, first, count, motion, edges, basis0, basis1)
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
    clearance = hull_clearance(start, end, np.inf) - placing
    # tests are for what is proved, so that a NaN proves nothing
    if not clearance > 0.0:
        state, _, _, _ = passages(start, end, placing)
        rho = relative_motion(start, end) + placing
        clearance = 0.0 if state == PASSES else bisected_clearance(moving_pair(start, end, placing), rho, np.inf)
    return clearance if clearance > 0.0 else 0.0
