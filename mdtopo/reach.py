"""The pairs of edges that must be looked at, so that no extreme of a step is missed."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.broadphase import candidate_pairs, images_can_meet, least_shift
from mdtopo.geometry.bundles import bundle_starts, diagonal_of, edge_boxes, joint_boxes, near_in_bundles
from mdtopo.geometry.lattice import basis_of
from mdtopo.geometry.pairs import BOUND_ERROR
from mdtopo.spheres import Spheres, midpoints

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]

RATIO_REACH = 1.25
"""Pairs whose ratio is at least 1/1.25 = 0.8 are always in reach: they have d0 + d1 ≤ 1.25 ρ, and ρ is at most the sum
of the two edges' greatest displacements."""

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
    share = 0.5 * RATIO_REACH if ratio * RATIO_REACH <= 1.0 else 0.5 / ratio
    pads = np.empty(len(spheres.half))
    for k in range(len(pads)):
        pad = max(0.5 * reach, share * spheres.motion[k]) * REACH_GUARD + slack
        pads[k] = pad + 8.0 * BOUND_ERROR * (spheres.half[k] + spheres.motion[k] + pad)
    return pads


@njit(cache=True, nogil=True)
def pairs_in_reach(
    motion: StepMotion, periodic: bool, edges: IntArray, trace: IntArray, spheres: Spheres, pads: FloatArray
) -> tuple[IntArray, IntArray, bool]:
    """Return pairs of edges, their images, and whether all were found; see `candidate_pairs` and `near_in_bundles`.

    Only where images can meet are they looked for: the search without them is several times faster. They cannot where
    they are shifted by more than the diagonal of all boxes together, or by what `images_can_meet` finds.
    """
    starts, no_images = bundle_starts(trace), np.empty((0, 3), dtype=np.int64)
    boxes = edge_boxes(motion.x0, motion.x1, edges, pads, starts)
    bundles = joint_boxes(boxes, starts)
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    if periodic and not diagonal_of(bundles) * REACH_GUARD < least_shift(basis0, basis1):
        mid0, mid1, radii = midpoints(motion.x0, edges), midpoints(motion.x1, edges), spheres.half + pads
        if images_can_meet(mid0, mid1, radii, basis0, basis1):
            return candidate_pairs(mid0, mid1, radii, motion.cell0, motion.cell1, periodic)
    return near_in_bundles(boxes, bundles, starts, trace), no_images, True


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
