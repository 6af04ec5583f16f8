"""The pairs of edges that must be looked at, so that no extreme of a step is missed."""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.broadphase import candidate_pairs, images_can_meet, least_shift
from mdtopo.geometry.bundles import (
    BUNDLE,
    SPARE,
    Meetings,
    boxes_in_order,
    bundle_starts,
    diagonal_of,
    edge_boxes,
    joint_boxes,
    meetings_of,
    pairs_across,
    pairs_along,
    pairs_of_meetings,
)
from mdtopo.geometry.imagebundles import meetings_in_cell, pairs_across_images, pairs_of_images, with_images
from mdtopo.geometry.lattice import basis_of
from mdtopo.geometry.pairs import BOUND_ERROR
from mdtopo.spheres import Spheres, midpoints

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]
SingleArray = NDArray[np.float32]

RATIO_REACH = 1.25
"""Pairs whose ratio is at least 1/1.25 = 0.8 are always in reach: they have d0 + d1 ≤ 1.25 ρ, and ρ is at most the sum
of the two edges' greatest displacements."""

LEAST_RATIO = 1e-300
"""Smaller ones need not be told from each other."""

REACH_GUARD = 1.0 + 1e-9
"""And this much further: rounding of a distance, a motion or a ratio loses no pair."""


@njit(cache=True, nogil=True)
def search_pads(spheres: Spheres, reach: float, ratio: float, slack: float) -> FloatArray:
    """Return by how much the edges are enlarged, Å, so that all pairs that count are found to meet.

    Two edges of which the enlarged ones never meet, as boxes or as swept spheres, stay more than `reach` apart. Rung 2
    proves as much: the slabs across an axis are further apart, or those across the line of centres, and what rounding
    takes from these is added here (see `slabs_of`: the line of centres is as long as both spheres are wide where they
    just miss each other, and the half edges enter by |x| + |y| + |z|). So whether such a pair is looked at cannot be
    seen in a clearance. And its ratio is below both 1/RATIO_REACH and `ratio`, the greatest one of a pair that is known
    already: ρ is at most the sum of the motions.
    """
    return closer_pads(spheres, reach, reach, ratio, ratio, slack)


@njit(cache=True, nogil=True)
def closer_pads(
    spheres: Spheres, closer: float, reach: float, ratio: float, greater_ratio: float, slack: float
) -> FloatArray:
    """Return by how much the edges are enlarged, Å, in a search that has begun with `search_pads`.

    Two of which the enlarged ones never meet stay more than `closer` apart, and have a ratio below both 1/RATIO_REACH
    and `ratio`, as there. And they stay more than `reach` apart too, or have a ratio below `greater_ratio`: the sum of
    their pads is at least `reach`, or what their motions may come to at that ratio.
    """
    share = 0.5 * RATIO_REACH if ratio * RATIO_REACH <= 1.0 else 0.5 / ratio
    greater_share, most = 0.5 / max(greater_ratio, LEAST_RATIO), reach - 0.5 * closer
    pads = np.empty(len(spheres.half))
    for k in range(len(pads)):
        motion = spheres.motion[k]
        pad = max(0.5 * closer, max(share * motion, min(greater_share * motion, most))) * REACH_GUARD + slack
        pads[k] = pad + 8.0 * BOUND_ERROR * (spheres.half[k] + motion + pad)
    return pads


class Search(NamedTuple):
    """A search for pairs, of which the bundles that meet are found.

    Attributes
    ----------
    boxes : ndarray of float32, shape (6, p)
        Of the edges, see `mdtopo.geometry.bundles.edge_boxes`.
    starts : ndarray of int
        See `mdtopo.geometry.bundles.bundle_starts`.
    meetings : Meetings
    is_bundled : bool
        False where bundles have too many images; then nothing is found yet.
    """

    boxes: SingleArray
    starts: IntArray
    meetings: Meetings
    is_bundled: bool


@njit(cache=True, nogil=True)
def pairs_in_reach(
    motion: StepMotion, periodic: bool, edges: IntArray, trace: IntArray, spheres: Spheres, pads: FloatArray
) -> tuple[IntArray, IntArray, bool]:
    """Return pairs of edges, their images, and whether all were found; see `candidate_pairs` and `pairs_of_meetings`.

    Where there are images, i ≤ j in each pair that was found by bundles; `images` is empty where none can meet.
    """
    search = begun_search(motion, periodic, edges, trace, spheres, pads)
    return found_pairs(search, motion, periodic, edges, trace, spheres, pads)


@njit(cache=True, nogil=True)
def begun_search(
    motion: StepMotion, periodic: bool, edges: IntArray, trace: IntArray, spheres: Spheres, pads: FloatArray
) -> Search:
    """Return which bundles meet of edges that are so much enlarged.

    Only where images can meet are they looked for: the search without them is faster. They cannot where they are
    shifted by more than the diagonal of all boxes together, or by what `images_can_meet` finds.
    """
    starts = bundle_starts(trace)
    boxes = edge_boxes(motion.x0, motion.x1, edges, pads, starts)
    bundles = joint_boxes(boxes, starts)
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    if periodic and not diagonal_of(bundles) * REACH_GUARD < least_shift(basis0, basis1):
        mid0, mid1, radii = midpoints(motion.x0, edges), midpoints(motion.x1, edges), spheres.half + pads
        if images_can_meet(mid0, mid1, radii, basis0, basis1):
            meetings = meetings_in_cell(bundles, basis0, basis1)
            return Search(boxes, starts, meetings, len(meetings.source) > 0)
    return Search(boxes, starts, meetings_of(bundles), True)


@njit(cache=True, nogil=True)
def found_pairs(
    search: Search,
    motion: StepMotion,
    periodic: bool,
    edges: IntArray,
    trace: IntArray,
    spheres: Spheres,
    pads: FloatArray,
) -> tuple[IntArray, IntArray, bool]:
    """Return what `pairs_in_reach` does, of a search that has begun."""
    boxes, starts, meetings, no_images = search.boxes, search.starts, search.meetings, np.empty((0, 3), dtype=np.int64)
    if not search.is_bundled:
        mid0, mid1, radii = midpoints(motion.x0, edges), midpoints(motion.x1, edges), spheres.half + pads
        return candidate_pairs(mid0, mid1, radii, motion.cell0, motion.cell1, periodic)
    if len(meetings.source) == 0:
        return pairs_of_meetings(boxes, meetings, starts, trace), no_images, True
    pairs, images = pairs_of_images(boxes, meetings, starts, trace, basis_of(motion.cell0), basis_of(motion.cell1))
    return pairs, images, True


@njit(cache=True, nogil=True)
def some_pairs(
    search: Search, motion: StepMotion, trace: IntArray, n_along: int, n_across: int
) -> tuple[IntArray, IntArray, float]:
    """Return some pairs of a search that has begun, their images, and how many across bundles there may be in all.

    They are those along so many bundles in a row, and across so many pairs of bundles.
    """
    boxes, starts, meetings = search.boxes, search.starts, search.meetings
    first = max((len(starts) - 1 - n_along) // 2, 0)
    places = boxes[:, BUNDLE * first : BUNDLE * (first + n_along) + SPARE].copy()
    along, count = pairs_along(places, starts[first : first + n_along + 1], trace)
    middle = max((len(meetings.near) - n_across) // 2, 0)
    near = meetings.near[middle : middle + n_across]
    share = len(meetings.near) / max(len(near), 1)
    if len(meetings.source) == 0:
        in_order, no_images = boxes_in_order(boxes, meetings.order), np.empty((0, 3), dtype=np.int64)
        pairs = pairs_across(along, count, near, starts, meetings.order, in_order)
        return pairs, no_images, share * (len(pairs) - count)
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    across, of_across = pairs_across_images(boxes, meetings, near, starts, basis0, basis1)
    pairs, images = with_images(along[:count], across, of_across)
    return pairs, images, share * len(across)


@njit(cache=True, nogil=True)
def narrower_search(search: Search, motion: StepMotion, edges: IntArray, pads: FloatArray) -> Search:
    """Return a search among the same bundles, of edges that are less enlarged."""
    boxes = edge_boxes(motion.x0, motion.x1, edges, pads, search.starts)
    return Search(boxes, search.starts, search.meetings, search.is_bundled)


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
