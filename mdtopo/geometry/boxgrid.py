"""Which boxes meet? A cell grid in single precision, for boxes that are mostly of one size.

A box is tried against many others in a row, without a branch, so that the compiler tries eight or sixteen of them at a
time. Indices are unsigned there, because of a signed one it would have to ask whether it counts from the end. Periodic
images are ghosts, which `mdtopo.geometry.imagebundles` puts beside the boxes at home.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import GRID_GUARD, SLICES, cells_between, grown_rows, sorted_into_cells
from mdtopo.geometry.lattice import Counts
from mdtopo.geometry.vectors import Vector

IntArray = NDArray[np.signedinteger[Any]]
FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
WholeArray = NDArray[np.uint64]

ORDINARY = 2.0
"""Boxes beyond this multiple of the mean size are large, and looked up one by one; that costs more than wide cells."""

LIKELY_MEETINGS = 8
"""Room for so many pairs of boxes for each box, at first."""

MOST_ROWS = 5
"""Of cells that a box can meet: its own, and those beside it that come later."""

ZERO, ONE, TWO, THREE, FOUR, FIVE, SIX, EIGHT = (np.uint64(k) for k in (0, 1, 2, 3, 4, 5, 6, 8))


@njit(cache=True, nogil=True)
def meeting_boxes(boxes: SingleArray, n_home: int, in_a_row: bool) -> tuple[IntArray, IntArray]:
    """Return every pair of boxes that meet, of which one at least is at home, and in which order.

    Pairs of the same first box come one after the other, as pairs of places in the order. Boxes that are near each
    other in space are so in it.

    Each box lies in the cell of its centre. Boxes of ordinary size that meet lie in the same cell or in adjacent ones;
    larger ones look as far as they can reach. Cells go all across the system along y: so the boxes to try lie in few
    long rows, and more of them in vain, which is far quicker than many short rows.

    Parameters
    ----------
    boxes : ndarray of float32, shape (6, n)
        Least x, y, z and greatest x, y, z of each, Å. At least one.
    n_home : int
        So many of them are at home, the first ones; the others are ghosts.
    in_a_row : bool
        Whether each box and the next one are neighbours, which are not asked for.
    """
    places, apart = _places_of(boxes), 1 if in_a_row else 2
    order, starts, shape, low, width = sorted_into_cells(places, ORDINARY, True)
    places, n, number = places[order], len(order), np.zeros(len(order) + 8, dtype=np.uint64)
    sorted_boxes, found = np.empty((6, n), dtype=np.float32), np.empty((LIKELY_MEETINGS * n + 64, 2), dtype=np.int32)
    ghosts = order >= n_home
    for p in range(n):
        for axis in range(6):
            sorted_boxes[axis, p] = boxes[axis, order[p]]
        number[p] = apart * order[p]
    count = _scan_ordinary(starts, shape, width, sorted_boxes, places, ghosts, number, found)
    if count >= len(found):  # one row more is needed than there are pairs: see there
        found = np.empty((count + 1, 2), dtype=np.int32)
        count = _scan_ordinary(starts, shape, width, sorted_boxes, places, ghosts, number, found)
    found, count = _scan_large(starts, shape, low, width, sorted_boxes, places, ghosts, number, found, count)
    return found[:count], order


@njit(cache=True, nogil=True)
def _places_of(boxes: SingleArray) -> FloatArray:
    """Return the centre of each box, and half of its longest side, shape (n, 4), Å."""
    places = np.empty((boxes.shape[1], 4))
    for k in range(len(places)):
        size = 0.0
        for axis in range(3):
            low, high = np.float64(boxes[axis, k]), np.float64(boxes[axis + 3, k])
            places[k, axis] = 0.5 * (low + high)
            size = max(size, 0.5 * (high - low))
        places[k, 3] = size * GRID_GUARD
    return places


@njit(cache=True, nogil=True)
def _scan_ordinary(
    starts: IntArray,
    shape: Counts,
    width: float,
    boxes: SingleArray,
    places: FloatArray,
    ghosts: BoolArray,
    number: WholeArray,
    found: IntArray,
) -> np.int64:
    """Write the pairs of ordinary boxes into `found` while there is room, and return how many there are.

    A cell meets the rest of its own row, and the rows beside it that come later. Here a large box is turned inside
    out, with which it meets nobody; and among the boxes that a ghost is tried against, in rows 6 to 11, so is every
    other ghost. A pair that does not meet is written too, where the next one will overwrite it, so
    the last row of `found` is never a pair's.
    """
    n = len(places)
    nx, ny, nz = shape
    b, eights = np.empty((12 if ghosts.any() else 6, n), dtype=np.float32), np.zeros(n // 8 + 2, dtype=np.uint64)
    flags, count, last = eights.view(np.uint8), np.uint64(0), np.uint64(len(found) - 1)
    lower, upper = np.empty(MOST_ROWS, dtype=np.uint64), np.empty(MOST_ROWS, dtype=np.uint64)
    b[:6] = boxes
    for k in range(n):
        if 2.0 * places[k, 3] > width:
            b[:3, k], b[3:6, k] = np.inf, -np.inf
    if len(b) > 6:
        b[6:] = b[:6]
        for k in range(n):
            if ghosts[k]:
                b[6:9, k], b[9:, k] = np.inf, -np.inf
    for cell in range(nx * ny * nz):
        begin, end = np.uint64(starts[cell]), np.uint64(starts[cell + 1])
        if begin == end:
            continue
        along, across, above = cell % nx, (cell // nx) % ny, cell // (nx * ny)
        left, right, n_rows = max(along - SLICES, 0), min(along + SLICES + 1, nx), 0
        for layer in range(above, min(above + 2, nz)):
            for line in range(across if layer == above else max(across - 1, 0), min(across + 2, ny)):
                first_cell = (layer * ny + line) * nx
                lower[n_rows], upper[n_rows] = starts[first_cell + left], starts[first_cell + right]
                n_rows += 1
        for p in range(begin, end):
            x, y, z, u, v, w = b[0, p], b[1, p], b[2, p], b[3, p], b[4, p], b[5, p]
            lower[0], mine, o = p + ONE, number[p], SIX if ghosts[p] else ZERO
            for r in range(n_rows):
                first = lower[r]
                size = upper[r] - first
                for k in range(size):
                    q = first + k
                    below = (b[o, q] <= u) & (b[o + ONE, q] <= v) & (b[o + TWO, q] <= w)
                    flags[k] = below & (b[o + THREE, q] >= x) & (b[o + FOUR, q] >= y) & (b[o + FIVE, q] >= z)
                for k in range(size, size + EIGHT):
                    flags[k] = 0
                for h in range((size + EIGHT - ONE) >> THREE):
                    if eights[h] != 0:
                        for k in range(EIGHT * h, EIGHT * h + EIGHT):
                            at = min(count, last)
                            found[at, 0], found[at, 1] = p, first + k
                            other = number[first + k]
                            count += np.uint64(flags[k] & (other - mine != ONE) & (mine - other != ONE))
    return np.int64(count)


@njit(cache=True, nogil=True)
def _scan_large(
    starts: IntArray,
    shape: Counts,
    low: Vector,
    width: float,
    boxes: SingleArray,
    places: FloatArray,
    ghosts: BoolArray,
    number: WholeArray,
    found: IntArray,
    count: np.int64,
) -> tuple[IntArray, np.int64]:
    """Add the pairs of which one box is large: each looks as far as it can reach, and of two the later one looks."""
    nx, ny, nz = shape
    largest = places[:, 3].max()
    for p in range(len(places)):
        if not 2.0 * places[p, 3] > width:
            continue
        far, b = (places[p, 3] + largest) * GRID_GUARD, boxes[:, p]
        left, right = cells_between(places[p, 0] - low[0], far, width / SLICES, nx)
        first_line, last_line = cells_between(places[p, 1] - low[1], far, width, ny)
        first_layer, last_layer = cells_between(places[p, 2] - low[2], far, width, nz)
        for layer in range(first_layer, last_layer + 1):
            for line in range(first_line, last_line + 1):
                first_cell = (layer * ny + line) * nx
                lower, upper = starts[first_cell + left], starts[first_cell + right + 1]
                if count + upper - lower > len(found):
                    found = grown_rows(found, 2 * len(found) + upper - lower)
                for q in range(lower, upper):
                    if q < p or not 2.0 * places[q, 3] > width:
                        found[count, 0], found[count, 1] = p, q
                        below = (boxes[0, q] <= b[3]) & (boxes[1, q] <= b[4]) & (boxes[2, q] <= b[5])
                        below &= (number[p] - number[q] != ONE) & (number[q] - number[p] != ONE)
                        below &= not (ghosts[p] and ghosts[q])
                        count += below & (boxes[3, q] >= b[0]) & (boxes[4, q] >= b[1]) & (boxes[5, q] >= b[2])
    return found, count
