"""Which of the local pairs can matter in a step? Most are far apart in the same way, and lie in a row along a strand.

Along a strand the pair behind a pair has three of its vertices in common with it. So the coordinates of a piece of
strand are laid out once, and all pairs of the piece are tried on them, eight at a time.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.extremes import NU0, NU1, RATIO, fresh_extremes
from mdtopo.geometry.pairlanes import Workbench, are_far
from mdtopo.geometry.windows import WIDE, fresh_window, put_vertex, vertex_at
from mdtopo.rungs import climb_pairs

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
FlagArray = NDArray[np.uint8]

SAMPLE = 64
"""So many pairs are climbed first: what they come to is what the others are held against."""

ALL_FAR = np.uint64(0x0101010101010101)
"""Eight flags in a row."""

SHORTEST = 8
"""A shorter piece is not tried: each of its pairs is climbed."""


@njit(cache=True, nogil=True)
def near_local_pairs(
    local_pairs: IntArray,
    motion: StepMotion,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    slack: float,
    placing: float,
    bench: Workbench,
) -> IntArray:
    """Return the local pairs without those that can change none of the step's extremes, see `mdtopo.rungs.climb_pairs`.

    Guarantee
    ---------
    Proven: a pair that is left out stays further apart than ν at both ends and than the least clearance, and has a
    smaller ratio than the greatest one; what the first pairs come to are bounds of all these.
    """
    if len(local_pairs) <= 2 * SAMPLE:
        return local_pairs
    best, is_open = fresh_extremes(), np.zeros(SAMPLE, dtype=np.bool_)
    some, no_images = local_pairs[:SAMPLE], np.empty((0, 3), dtype=np.int64)
    climb_pairs(some, no_images, True, motion, edges, following, trace, slack, placing, 0.0, bench, best, is_open)
    nearest, ratio = max(best.least[0], max(best.values[NU0], best.values[NU1])), best.values[RATIO]
    window, eights = fresh_window(), np.zeros(WIDE // 8, dtype=np.uint64)
    far = eights.view(np.uint8)
    near, count, first = np.empty_like(local_pairs), 0, 0
    while first < len(local_pairs):
        length = length_of_piece(local_pairs, edges, first)
        if length >= SHORTEST:
            fill_pairs(window, motion.x0, motion.x1, edges[local_pairs[first, 0], 0], length + 3)
            flag_window(window, nearest, ratio, slack, far)
        else:
            far[:length] = 0
        for h in range((length + 7) // 8):
            if eights[h] != ALL_FAR:
                for k in range(8 * h, min(8 * h + 8, length)):
                    near[count, 0], near[count, 1] = local_pairs[first + k, 0], local_pairs[first + k, 1]
                    count += 1 - far[k]
        first += length
    return near[:count]


@njit(cache=True, nogil=True)
def length_of_piece(pairs: IntArray, edges: IntArray, first: int) -> int:
    """Return how many pairs from `first` on, `WIDE` at most, have consecutive vertices, each pair one further."""
    vertex = edges[pairs[first, 0], 0]
    for k in range(min(WIDE, len(pairs) - first)):
        i, j, v = pairs[first + k, 0], pairs[first + k, 1], vertex + k
        one = (edges[i, 0] == v) & (edges[i, 1] == v + 1)
        if not one & (edges[j, 0] == v + 2) & (edges[j, 1] == v + 3):
            return max(k, 1)
    return min(WIDE, len(pairs) - first)


@njit(cache=True, nogil=True)
def fill_pairs(window: FloatArray, x0: FloatArray, x1: FloatArray, vertex: int, count: int) -> None:
    """Lay out so many consecutive vertices at both ends of the step."""
    for k in range(count):
        put_vertex(window, k, x0, x1, vertex + k)


@njit(cache=True, nogil=True)
def flag_window(window: FloatArray, nearest: float, ratio: float, slack: float, far: FlagArray) -> None:
    """Flag which local pairs of a window are far, as `mdtopo.geometry.pairlanes.flag_far` does for any pairs."""
    for k in range(WIDE):
        a0, b0, c0 = vertex_at(window, 0, k), vertex_at(window, 0, k + 1), vertex_at(window, 0, k + 2)
        a1, b1, c1 = vertex_at(window, 3, k), vertex_at(window, 3, k + 1), vertex_at(window, 3, k + 2)
        start, end = (a0, b0, c0, vertex_at(window, 0, k + 3)), (a1, b1, c1, vertex_at(window, 3, k + 3))
        far[k] = are_far(start, end, nearest, ratio, slack)
