"""The rung of the ladder that settles a pair of edges, and what the pair adds to the extremes of its step.

Here are rungs 2 to 4, and the end terms of ν. For the whole ladder see `mdtopo.ladder`. Pairs go through in batches:
first those are sorted out that are too far apart to matter, which most are; the others wait until there are enough of
them, and are then measured in full.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.contacts import SURELY
from mdtopo.curves import StepMotion
from mdtopo.extremes import (
    NU0,
    NU0_PROVEN,
    NU1,
    NU1_PROVEN,
    RATIO,
    Extremes,
    keep_clearance,
    keep_nu,
    keep_ratio,
)
from mdtopo.geometry.distances import closest_points, dual_bound
from mdtopo.geometry.lattice import basis_of, lattice_vector
from mdtopo.geometry.pairlanes import (
    ALONG,
    END,
    GAP,
    LOW0,
    LOW1,
    NEAR0,
    NEAR1,
    NEAREST,
    RHO,
    ROOM,
    START,
    TURN,
    Workbench,
    copy_lane,
    corners_at,
    flag_far,
    gap_at,
    measure_lanes,
    shift_edge,
    write_edge,
)
from mdtopo.geometry.pairs import hull_clearance
from mdtopo.geometry.vectors import norm, row, subtract
from mdtopo.reach import RATIO_REACH
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]
BoolArray = NDArray[np.bool_]
FlagArray = NDArray[np.uint8]

RELATIVE_MOTION, DIRECTION = int(Rung.RELATIVE_MOTION), int(Rung.DIRECTION)

RATIO_GUARD = 1.0 - 1e-15
"""A ratio this much below the greatest one is not looked at: a product and a quotient are rounded differently."""


@njit(cache=True, nogil=True)
def climb_pairs(
    pairs: IntArray,
    images: IntArray,
    local: bool,
    motion: StepMotion,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    slack: float,
    placing: float,
    first_reach: float,
    bench: Workbench,
    best: Extremes,
    is_open: BoolArray,
) -> float:
    """Climb a list of pairs up to rung 4, and return the greatest drift of an image among them, Å.

    Images are left out whose slabs keep them further away than `first_reach`: some are listed by chance only.
    Pairs that no rung settles are marked in `is_open`. Where the list is not the local one, pairs that are local are
    passed over: they have been climbed already. What a pair adds to the step's extremes is kept; of a pair that stays
    open all but its clearance. (Arrays are named once, outside the loop: each time that one is taken out of a record,
    or handed to a function, its references are counted, which costs more than measuring a pair.)
    """
    fresh, lanes, far, of_lane = bench.fresh, bench.lanes, bench.far, bench.of_lane
    x0, x1, values, least, waiting, drift = motion.x0, motion.x1, best.values, best.least, 0, 0.0
    basis0, basis1 = basis_of(motion.cell0), basis_of(motion.cell1)
    image, kind, shift0, shift1 = (0, 0, 0), 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for first in range(0, len(pairs), ROOM):
        nu, count = max(values[NU0], values[NU1]), min(ROOM, len(pairs) - first)
        for k in range(count):
            i, j = pairs[first + k, 0], pairs[first + k, 1]
            if not local:
                kind = 1 if trace[i] == trace[j] else 2
            fresh[NEAREST * ROOM + k] = max(least[kind], nu)
            write_edge(fresh, 0, np.uint64(k), x0, x1, edges, i)
            write_edge(fresh, 6, np.uint64(k), x0, x1, edges, j)
            if len(images) > 0:
                image = (images[first + k, 0], images[first + k, 1], images[first + k, 2])
                shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
                shift_edge(fresh, np.uint64(k), shift0, shift1)
                move = norm(subtract(shift1, shift0))
                if move > drift and not gap_at(fresh, k, slack) > first_reach:
                    drift = move
        flag_far(fresh, values[RATIO], slack, far)
        for k in range(count):
            if far[k] != 0:
                continue
            i, j = pairs[first + k, 0], pairs[first + k, 1]
            if len(images) > 0:
                image = (images[first + k, 0], images[first + k, 1], images[first + k, 2])
            if not local and image == (0, 0, 0) and are_neighbours(i, j, following):
                continue
            copy_lane(fresh, np.uint64(k), lanes, np.uint64(waiting))
            of_lane[waiting], waiting = first + k, waiting + 1
            if waiting == ROOM:
                settle_lanes(
                    lanes, of_lane, waiting, pairs, local, edges, trace, slack, placing, first_reach, best, is_open
                )
                waiting = 0
    settle_lanes(lanes, of_lane, waiting, pairs, local, edges, trace, slack, placing, first_reach, best, is_open)
    return drift


@njit(cache=True, nogil=True)
def settle_lanes(
    lanes: FloatArray,
    of_lane: IntArray,
    count: int,
    pairs: IntArray,
    local: bool,
    edges: IntArray,
    trace: IntArray,
    slack: float,
    placing: float,
    first_reach: float,
    best: Extremes,
    is_open: BoolArray,
) -> None:
    """Measure the pairs of a batch, and take them into the extremes, each under its rung; see `climb_pairs`.

    A pair that the search may miss, as it is further apart than `first_reach` and has a small ratio, is never the
    greatest ratio; one whose boxes or slabs are apart may be listed or not, and is not counted. The hull, which is the
    best that one direction can prove, is measured only where all else leaves a pair at or below the least clearance.
    """
    measure_lanes(lanes, count, slack, placing)
    values, least, rung_pairs, kind = best.values, best.least, best.rung_pairs, 0
    for k in range(count):
        n = of_lane[k]
        i, j = pairs[n, 0], pairs[n, 1]
        if not local:
            kind = 1 if trace[i] == trace[j] else 2
        near0, near1 = lanes[NEAR0 * ROOM + k], lanes[NEAR1 * ROOM + k]
        low0, low1, rho = lanes[LOW0 * ROOM + k], lanes[LOW1 * ROOM + k], lanes[RHO * ROOM + k]
        if low0 < values[NU0_PROVEN] or low1 < values[NU1_PROVEN] or near1 < values[NU1] or near0 <= values[NU0]:
            keep_nu(edges, i, j, kind, near0, near1, low0, low1, best)
        counts = kind == 0 or near0 + near1 <= 2.0 * first_reach or RATIO_REACH * rho >= low0 + low1
        if counts and not rho < values[RATIO] * (low0 + low1) * RATIO_GUARD:
            keep_ratio(edges, i, j, rho, low0, low1, best)
        gap, along, turn = lanes[GAP * ROOM + k], lanes[ALONG * ROOM + k], lanes[TURN * ROOM + k]
        still = 0.5 * (low0 + low1 - rho)
        clearance = max(max(gap, along - slack), max(still, turn))
        if 0.0 < clearance <= least[kind]:
            start, end = corners_at(lanes, START, k), corners_at(lanes, END, k)
            clearance = max(clearance, hull_clearance(start, end, SURELY * (least[kind] + placing)) - placing)
        # tests are for what is proved, so that a NaN proves nothing
        if not clearance > 0.0:
            is_open[n] = True
            continue
        if clearance <= least[kind]:
            keep_clearance(edges, i, j, kind, clearance, best)
        if not (gap > 0.0 or along > 0.0):
            rung_pairs[RELATIVE_MOTION if still > 0.0 else DIRECTION] += 1


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
