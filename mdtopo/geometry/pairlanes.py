"""Many moving pairs of edges side by side, so that the compiler measures eight of them at a time.

It does so where a loop over the pairs has a length that it knows and no branch, calls nothing that it cannot inline,
divides without asking whether by zero, and finds all numbers in one piece of memory at distances that it knows. So a
batch is one flat array: number `row` of the pair in lane `k` lies at ``row * ROOM + k``. It is worked through in groups
of lanes; the last group may have some that nobody asks for. What is done of each pair is written as for one pair, with
the functions of `mdtopo.geometry.pairs`.

Indices are unsigned where they come out of an array: of a signed one the compiler would ask whether it counts from the
end.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.distances import closest_points, dual_bound
from mdtopo.geometry.pairs import (
    BOUND_ERROR,
    Corners,
    axis_gap,
    direction_clearance,
    is_far,
    line_bound,
    relative_motion,
    slab_gaps,
)
from mdtopo.geometry.vectors import Vector, add, extent, norm, scale, subtract

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
FlagArray = NDArray[np.uint8]

ROOM = 64
"""Lanes of a batch. All of its numbers fit into the fastest memory of a processor."""

GROUP = 16
"""Lanes that are measured at a time."""

START, END, NEAREST = 0, 12, 24
"""Rows that are filled in: the corners at both ends of the step, and the distance from which on a pair is not looked at
(see `flag_far`)."""

NEAR0, NEAR1, LOW0, LOW1, RHO, GAP, ALONG, TURN = 25, 26, 27, 28, 29, 30, 31, 32
"""Rows that `measure_lanes` writes."""

N_ROWS = 33

LATER = np.uint64((END - START) * ROOM)
"""From a number at the start of the step to the same one at its end."""


class Workbench(NamedTuple):
    """Room for sorting and measuring pairs, made once for many lists of them.

    Attributes
    ----------
    fresh, lanes : ndarray
        Two batches: pairs that are being sorted, and pairs that wait to be measured.
    far : ndarray of uint8, shape (ROOM,)
        See `flag_far`.
    of_lane : ndarray of int, shape (ROOM,)
        Which pair of the list is in each lane of `lanes`.
    """

    fresh: FloatArray
    lanes: FloatArray
    far: FlagArray
    of_lane: IntArray


@njit(cache=True, nogil=True)
def fresh_workbench() -> Workbench:
    """Return an empty workbench."""
    return Workbench(fresh_lanes(), fresh_lanes(), np.zeros(ROOM, np.uint8), np.zeros(ROOM, np.int64))


@njit(cache=True, nogil=True)
def fresh_lanes() -> FloatArray:
    """Return an empty batch. Lanes without a pair hold zeros, or what was there before."""
    return np.zeros(N_ROWS * ROOM)


@njit(cache=True, nogil=True, forceinline=True)
def write_edge(
    lanes: FloatArray, first: int, k: np.uint64, x0: FloatArray, x1: FloatArray, edges: IntArray, edge: int
) -> None:
    """Write the ends of an edge into a lane: those at the start of the step from row START + `first` on, 0 or 6."""
    a, b = np.uint64(edges[np.uint64(edge), 0]), np.uint64(edges[np.uint64(edge), 1])
    for axis in range(3):
        one, other = np.uint64((START + first + axis) * ROOM) + k, np.uint64((START + first + axis + 3) * ROOM) + k
        lanes[one], lanes[other] = x0[a, axis], x0[b, axis]
        lanes[one + LATER], lanes[other + LATER] = x1[a, axis], x1[b, axis]


@njit(cache=True, nogil=True, forceinline=True)
def vector_at(lanes: FloatArray, row: int, k: int) -> Vector:
    """Return the three numbers of a lane that begin with this row."""
    return lanes[row * ROOM + k], lanes[(row + 1) * ROOM + k], lanes[(row + 2) * ROOM + k]


@njit(cache=True, nogil=True, forceinline=True)
def corners_at(lanes: FloatArray, row: int, k: int) -> Corners:
    """Return the corners of a lane that begin with this row."""
    a, b = vector_at(lanes, row, k), vector_at(lanes, row + 3, k)
    return a, b, vector_at(lanes, row + 6, k), vector_at(lanes, row + 9, k)


@njit(cache=True, nogil=True, forceinline=True)
def shift_edge(lanes: FloatArray, k: np.uint64, shift0: Vector, shift1: Vector) -> None:
    """Move the second edge of a lane to an image."""
    for axis in range(3):
        for end in range(6, 12, 3):
            lanes[np.uint64((START + end + axis) * ROOM) + k] += shift0[axis]
            lanes[np.uint64((END + end + axis) * ROOM) + k] += shift1[axis]


@njit(cache=True, nogil=True, forceinline=True)
def copy_lane(source: FloatArray, k: np.uint64, target: FloatArray, other: np.uint64) -> None:
    """Copy what is filled in of one lane to a lane of another batch."""
    for row in range(NEAREST + 1):
        target[np.uint64(row * ROOM) + other] = source[np.uint64(row * ROOM) + k]


@njit(cache=True, nogil=True, forceinline=True)
def halves_of(corners: Corners) -> tuple[Vector, Vector, Vector]:
    """Return the vector from the midpoint of the first edge to that of the second, and half of each edge."""
    a, b, c, d = corners
    centre = scale(0.5, add(subtract(c, a), subtract(d, b)))
    return centre, scale(0.5, subtract(b, a)), scale(0.5, subtract(d, c))


@njit(cache=True, nogil=True)
def flag_far(lanes: FloatArray, ratio: float, slack: float, far: FlagArray) -> None:
    """Flag which lanes hold a pair that can change none of the step's extremes, see `is_far`.

    Parameters
    ----------
    lanes : ndarray
        A batch.
    ratio : float
        The greatest ratio so far.
    slack : float
        Rounding of the positions, Å.
    far : ndarray of uint8, shape (ROOM,)
        Set to 1 where the pair is at least its `NEAREST` apart, and its ratio is less than `ratio`; else to 0.
    """
    for k in range(ROOM):
        start, end = corners_at(lanes, START, k), corners_at(lanes, END, k)
        far[k] = are_far(start, end, lanes[NEAREST * ROOM + k], ratio, slack)


@njit(cache=True, nogil=True, forceinline=True)
def are_far(start: Corners, end: Corners, nearest: float, ratio: float, slack: float) -> bool:
    """Return whether the two edges of a pair are far apart, see `is_far`."""
    centre0, f0, g0 = halves_of(start)
    centre1, f1, g1 = halves_of(end)
    rho, reach = relative_motion(start, end) + slack, extent(f0) + extent(g0) + extent(f1) + extent(g1)
    return is_far(centre0, centre1, f0, g0, f1, g1, reach, rho, nearest, ratio, slack)


@njit(cache=True, nogil=True, forceinline=True)
def slabs_of(start: Corners, end: Corners, rho: float, slack: float) -> tuple[float, float, float]:
    """Return how far the slabs across the line of centres are apart at both ends, less rounding, and that rounding."""
    centre0, f0, g0 = halves_of(start)
    centre1, f1, g1 = halves_of(end)
    lengths = norm(centre0) + norm(centre1) + extent(f0) + extent(g0) + extent(f1) + extent(g1)
    rounding = slack + BOUND_ERROR * (lengths + rho)
    slab0, slab1 = slab_gaps(centre0, centre1, f0, g0, f1, g1)
    return slab0 - rounding, slab1 - rounding, rounding


@njit(cache=True, nogil=True)
def gap_at(lanes: FloatArray, k: int, slack: float) -> float:
    """Return how far one pair is apart at all times, Å: a lower bound, by slabs.

    They lie across the line of centres, or across an axis. So any pair that no search lists which looks so far is
    further apart by this measure too.
    """
    start, end = corners_at(lanes, START, k), corners_at(lanes, END, k)
    slab0, slab1, _ = slabs_of(start, end, relative_motion(start, end) + slack, slack)
    centre0, f0, g0 = halves_of(start)
    centre1, f1, g1 = halves_of(end)
    return max(min(slab0, slab1), axis_gap(centre0, centre1, f0, g0, f1, g1) - slack)


@njit(cache=True, nogil=True)
def measure_lanes(lanes: FloatArray, count: int, slack: float, placing: float) -> None:
    """Measure the pairs in the first `count` lanes, without the hull: all that rungs 2 to 4 need.

    Parameters
    ----------
    lanes : ndarray
        A batch. Written are the rows NEAR0 and NEAR1, the distances at both ends by closest points; LOW0 and LOW1, what
        is proved of them; RHO, the greatest relative motion of two corners; GAP, how far the slabs across the line of
        centres are apart at all times; ALONG, the same of the slabs across the axes, at best; TURN, the clearance by a
        direction that serves both ends.
    count : int
    slack, placing : float
        Rounding of the positions in general, and of these ones (0 where they are as stored), Å.

    Guarantee
    ---------
    Proven: LOW0, LOW1, GAP and TURN are lower bounds, and ALONG up to `slack`; RHO is an upper one.
    """
    for first in range(0, count, GROUP):
        _measure_group(lanes[first:], slack, placing)


@njit(cache=True, nogil=True)
def _measure_group(lanes: FloatArray, slack: float, placing: float) -> None:
    for k in range(GROUP):
        start, end = corners_at(lanes, START, k), corners_at(lanes, END, k)
        centre0, f0, g0 = halves_of(start)
        centre1, f1, g1 = halves_of(end)
        _, _, n0 = closest_points(start[0], start[1], start[2], start[3])
        _, _, n1 = closest_points(end[0], end[1], end[2], end[3])
        rho = relative_motion(start, end) + placing
        slab0, slab1, rounding = slabs_of(start, end, rho, slack)
        line0, line1 = line_bound(centre0, f0, g0), line_bound(centre1, f1, g1)
        low0 = dual_bound(n0, start[0], start[1], start[2], start[3]) - placing
        low1 = dual_bound(n1, end[0], end[1], end[2], end[3]) - placing
        lanes[NEAR0 * ROOM + k], lanes[NEAR1 * ROOM + k] = norm(n0), norm(n1)
        lanes[LOW0 * ROOM + k] = max(max(low0, 0.0), max(slab0, line0 - rounding))
        lanes[LOW1 * ROOM + k] = max(max(low1, 0.0), max(slab1, line1 - rounding))
        lanes[RHO * ROOM + k], lanes[GAP * ROOM + k] = rho, min(slab0, slab1)
        lanes[ALONG * ROOM + k] = axis_gap(centre0, centre1, f0, g0, f1, g1)
        lanes[TURN * ROOM + k] = direction_clearance(n0, n1, start, end) - placing
