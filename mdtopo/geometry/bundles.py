"""Which edges of moving strands may come near each other? Boxes of a few edges in a row first, then boxes of edges.

A box is tight about an edge where a sphere is not: among compact strands four times fewer pairs have boxes that meet.
Neighbours along a strand are near in space, so a bundle of them is found once instead of edge by edge. The box of a
bundle is tried against many others in a row, without a branch, so that the compiler tries eight or sixteen of them at
a time; indices are unsigned there, because of a signed one it would have to ask whether it counts from the end. There
are no periodic images here; `mdtopo.geometry.broadphase` has them.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import GRID_GUARD, SLICES, cells_between, grown_rows, sorted_into_cells
from mdtopo.geometry.lattice import Counts
from mdtopo.geometry.vectors import Vector, norm, subtract

IntArray = NDArray[np.signedinteger[Any]]
FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

BUNDLE = 4
"""Edges in a bundle. Fewer cost more to find; more have looser boxes, and more pairs of edges to try in them."""

ORDINARY = 2.0
"""Boxes beyond this multiple of the mean size are large, and looked up one by one; that costs more than wide cells."""

LIKELY_MEETINGS = 8
"""Room for so many pairs of boxes for each box, at first."""

NARROWING = 2.0**-22
"""What a box grows by, as a multiple of its coordinates, so that rounding to float32 (2^-24 of them) only widens it."""

SHIFTING = 2.0**-50
"""And as a multiple of the greatest coordinate: for the subtraction of the corner (2^-53 of it) that comes before."""

ONE, THREE, EIGHT = np.uint64(1), np.uint64(3), np.uint64(8)


@njit(cache=True, nogil=True)
def near_boxes(boxes: FloatArray, trace: IntArray) -> IntArray:
    """Return every pair of boxes that meet, neighbours along a trace left out.

    Parameters
    ----------
    boxes : ndarray, shape (m, 6)
        Of each edge, or of what goes along it: least x, y, z, then greatest x, y, z, Å; see `edge_boxes`. At least one.
    trace : ndarray of int, shape (m,)
        The trace of each, in trace order: where two in a row have the same trace, the second starts where the first
        ends.

    Returns
    -------
    pairs : ndarray of int32, shape (k, 2)
        Edges i < j, without those at most two places apart on one trace. (Around the end of a ring they are listed.) Of
        dense strands these are the largest array of a step.

    Guarantee
    ---------
    Conservative: two edges of a pair that is missing are further apart than the sum of their pads, along one of the
    axes, at every time of the step: an edge stays in the box that holds both its ends before and after.
    """
    starts = bundle_starts(trace)
    bundles = joint_boxes(boxes, starts)
    near, order = meeting_boxes(bundles)
    return edge_pairs(near, starts[order], bundles[order], sorted_boxes(boxes, starts, order), last_neighbours(trace))


@njit(cache=True, nogil=True)
def edge_boxes(x0: FloatArray, x1: FloatArray, edges: IntArray, pads: FloatArray) -> FloatArray:
    """Return the box that each edge stays in, enlarged by its pad: rows (least x, y, z, greatest x, y, z)."""
    boxes = np.empty((len(edges), 6))
    for k in range(len(edges)):
        a, b, pad = edges[k, 0], edges[k, 1], pads[k]
        for axis in range(3):
            p, q, r, s = x0[a, axis], x0[b, axis], x1[a, axis], x1[b, axis]
            boxes[k, axis] = min(min(p, q), min(r, s)) - pad
            boxes[k, axis + 3] = max(max(p, q), max(r, s)) + pad
    return boxes


@njit(cache=True, nogil=True)
def diagonal_of(boxes: FloatArray) -> float:
    """Return how long the diagonal is of the box that holds all boxes, Å: no two points in them are further apart."""
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for k in range(len(boxes)):
        low = (min(low[0], boxes[k, 0]), min(low[1], boxes[k, 1]), min(low[2], boxes[k, 2]))
        high = (max(high[0], boxes[k, 3]), max(high[1], boxes[k, 4]), max(high[2], boxes[k, 5]))
    return norm(subtract(high, low))


@njit(cache=True, nogil=True)
def bundle_starts(trace: IntArray) -> IntArray:
    """Return the first edge of each bundle, and the number of edges at the end; a bundle has edges of one trace."""
    starts, count = np.empty(len(trace) + 1, dtype=np.int64), 0
    for k in range(len(trace)):
        if count == 0 or k - starts[count - 1] == BUNDLE or trace[k] != trace[k - 1]:
            starts[count] = k
            count += 1
    starts[count] = len(trace)
    return starts[: count + 1]


@njit(cache=True, nogil=True)
def joint_boxes(boxes: FloatArray, starts: IntArray) -> FloatArray:
    """Return the box that holds the boxes of each bundle."""
    joint = np.empty((len(starts) - 1, 6))
    for n in range(len(joint)):
        for axis in range(3):
            low, high = boxes[starts[n], axis], boxes[starts[n], axis + 3]
            for k in range(starts[n] + 1, starts[n + 1]):
                low, high = min(low, boxes[k, axis]), max(high, boxes[k, axis + 3])
            joint[n, axis], joint[n, axis + 3] = low, high
    return joint


@njit(cache=True, nogil=True)
def last_neighbours(trace: IntArray) -> IntArray:
    """Return the last edge, at most two places on, that lies on the same trace."""
    last, n = np.empty(len(trace), dtype=np.int64), len(trace)
    for k in range(n):
        last[k] = k
        if k + 1 < n and trace[k + 1] == trace[k]:
            last[k] = k + 2 if k + 2 < n and trace[k + 2] == trace[k] else k + 1
    return last


@njit(cache=True, nogil=True)
def meeting_boxes(boxes: FloatArray) -> tuple[IntArray, IntArray]:
    """Return every pair of boxes that meet, and each box with itself, and in which order; in float32, a few more.

    Boxes that are near each other in space are so in this order, and the pairs are pairs of places in it.

    Each box lies in the cell of its centre. Boxes of ordinary size that meet lie in the same cell or in adjacent ones;
    larger ones look as far as they can reach. Cells go all across the system along y: so the boxes to try lie in few
    long rows, and more of them in vain, which is far quicker than many short rows.
    """
    n = len(boxes)
    places = np.empty((n, 4))  # centre, and half the longest side
    for k in range(n):
        size = 0.0
        for axis in range(3):
            places[k, axis] = 0.5 * (boxes[k, axis] + boxes[k, axis + 3])
            size = max(size, 0.5 * (boxes[k, axis + 3] - boxes[k, axis]))
        places[k, 3] = size * GRID_GUARD
    order, starts, shape, low, width = sorted_into_cells(places, ORDINARY, True)
    places = places[order]
    narrow, found = narrowed(boxes, order), np.empty((LIKELY_MEETINGS * n + 64, 2), dtype=np.int64)
    count = _scan_ordinary(starts, shape, width, narrow, places, found)
    if count >= len(found):  # one row more is needed than there are pairs: see there
        found = np.empty((count + 1, 2), dtype=np.int64)
        count = _scan_ordinary(starts, shape, width, narrow, places, found)
    found, count = _scan_large(starts, shape, low, width, narrow, places, found, count)
    return found[:count], order


@njit(cache=True, nogil=True)
def narrowed(boxes: FloatArray, order: IntArray) -> SingleArray:
    """Return boxes in float32, in the given order, seen from their least corner, shape (6, n); none is smaller."""
    greatest, low = 0.0, (np.inf, np.inf, np.inf)
    for k in range(len(boxes)):
        low = (min(low[0], boxes[k, 0]), min(low[1], boxes[k, 1]), min(low[2], boxes[k, 2]))
        for axis in range(6):
            greatest = max(greatest, abs(boxes[k, axis]))
    found, rounding = np.empty((6, len(order)), dtype=np.float32), SHIFTING * greatest
    for p in range(len(order)):
        for axis in range(3):
            a, b = boxes[order[p], axis] - low[axis], boxes[order[p], axis + 3] - low[axis]
            found[axis, p] = np.float32(a - NARROWING * abs(a) - rounding)
            found[axis + 3, p] = np.float32(b + NARROWING * abs(b) + rounding)
    return found


@njit(cache=True, nogil=True)
def _scan_ordinary(
    starts: IntArray,
    shape: Counts,
    width: float,
    narrow: SingleArray,
    places: FloatArray,
    found: IntArray,
) -> np.int64:
    """Write the pairs of ordinary boxes, and each box with itself, into `found` while there is room; return how many.

    A cell meets the rest of its own row, and the rows beside it that come later. Here a large box is turned inside
    out, with which it meets nobody. A pair that does not meet is written too, where the next one will overwrite it, so
    the last row of `found` is never a pair's.
    """
    n = len(places)
    nx, ny, nz = shape
    b, eights = narrow.copy(), np.zeros(n // 8 + 2, dtype=np.uint64)
    flags, count, last = eights.view(np.uint8), np.uint64(n), np.uint64(len(found) - 1)
    for k in range(n):
        found[k, 0] = found[k, 1] = k
        if 2.0 * places[k, 3] > width:
            b[:3, k], b[3:, k] = np.inf, -np.inf
    for cell in range(nx * ny * nz):
        begin, end = np.uint64(starts[cell]), np.uint64(starts[cell + 1])
        if begin == end:
            continue
        along, across, above = cell % nx, (cell // nx) % ny, cell // (nx * ny)
        left, right = max(along - SLICES, 0), min(along + SLICES + 1, nx)
        for layer in range(above, min(above + 2, nz)):
            for line in range(across if layer == above else max(across - 1, 0), min(across + 2, ny)):
                first_cell = (layer * ny + line) * nx
                own_row = line == across and layer == above
                lower, upper = np.uint64(starts[first_cell + left]), np.uint64(starts[first_cell + right])
                for p in range(begin, end):
                    first = p + ONE if own_row else lower
                    size = upper - first
                    x, y, z, u, v, w = b[0, p], b[1, p], b[2, p], b[3, p], b[4, p], b[5, p]
                    for k in range(size):
                        q = first + k
                        below = (b[0, q] <= u) & (b[1, q] <= v) & (b[2, q] <= w)
                        flags[k] = below & (b[3, q] >= x) & (b[4, q] >= y) & (b[5, q] >= z)
                    for k in range(size, size + EIGHT):
                        flags[k] = 0
                    for h in range((size + EIGHT - ONE) >> THREE):
                        if eights[h] != 0:
                            for k in range(EIGHT * h, EIGHT * h + EIGHT):
                                at = min(count, last)
                                found[at, 0], found[at, 1] = p, first + k
                                count += np.uint64(flags[k])
    return np.int64(count)


@njit(cache=True, nogil=True)
def _scan_large(
    starts: IntArray,
    shape: Counts,
    low: Vector,
    width: float,
    narrow: SingleArray,
    places: FloatArray,
    found: IntArray,
    count: np.int64,
) -> tuple[IntArray, np.int64]:
    """Add the pairs of which one box is large: each looks as far as it can reach, and of two the later one looks."""
    nx, ny, nz = shape
    largest = places[:, 3].max()
    for p in range(len(places)):
        if not 2.0 * places[p, 3] > width:
            continue
        far, b = (places[p, 3] + largest) * GRID_GUARD, narrow[:, p]
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
                        below = (narrow[0, q] <= b[3]) & (narrow[1, q] <= b[4]) & (narrow[2, q] <= b[5])
                        count += below & (narrow[3, q] >= b[0]) & (narrow[4, q] >= b[1]) & (narrow[5, q] >= b[2])
    return found, count


@njit(cache=True, nogil=True)
def sorted_boxes(boxes: FloatArray, starts: IntArray, order: IntArray) -> FloatArray:
    """Return the boxes of the edges, those of a bundle in four rows: bundles in the given order, and so near in memory.

    A row without an edge holds a box that is turned inside out, which meets nobody.
    """
    found = np.empty((BUNDLE * len(order), 6))
    for p in range(len(order)):
        first, stop = starts[order[p]], starts[order[p] + 1]
        for n in range(BUNDLE):
            for axis in range(3):
                low, high = np.inf, -np.inf
                if first + n < stop:
                    low, high = boxes[first + n, axis], boxes[first + n, axis + 3]
                found[BUNDLE * p + n, axis], found[BUNDLE * p + n, axis + 3] = low, high
    return found


@njit(cache=True, nogil=True)
def edge_pairs(near: IntArray, firsts: IntArray, bundles: FloatArray, boxes: FloatArray, last: IntArray) -> IntArray:
    """Return the pairs of edges, of bundles that meet, whose own boxes meet; without neighbours along a trace.

    Parameters
    ----------
    near : ndarray of int, shape (k, 2)
        Pairs of bundles.
    firsts, bundles, boxes : ndarray
        First edge and box of each bundle, and the boxes of its edges, see `sorted_boxes`.
    last : ndarray of int
        Of each edge its last neighbour, see `last_neighbours`.
    """
    found, count, done = np.empty((2 * len(last) + 64, 2), dtype=np.int32), 0, 0
    while True:
        done, count = _edge_pairs_into(found, count, near, done, firsts, bundles, boxes, last)
        if done == len(near):
            return found[:count]
        found = grown_rows(found, 3 * len(found) // 2)  # by half: while it is copied, both are held


@njit(cache=True, nogil=True)
def _edge_pairs_into(
    found: IntArray,
    count: int,
    near: IntArray,
    done: int,
    firsts: IntArray,
    bundles: FloatArray,
    boxes: FloatArray,
    last: IntArray,
) -> tuple[int, int]:
    """Go on with `edge_pairs` behind so many pairs of bundles while there is room; return how many are done and found.

    A loop that puts a larger array in the place of `found` would count the references of both in every round.
    """
    for n in range(done, len(near)):
        if count + BUNDLE * BUNDLE > len(found):
            return n, count
        p, q = np.uint64(near[n, 0]), np.uint64(near[n, 1])
        if firsts[p] > firsts[q]:
            p, q = q, p
        first, second = firsts[p], firsts[q]
        for a in range(BUNDLE):
            row = np.uint64(BUNDLE) * p + np.uint64(a)
            x, y, z, u, v, w = boxes[row, 0], boxes[row, 1], boxes[row, 2], boxes[row, 3], boxes[row, 4], boxes[row, 5]
            below = (bundles[q, 0] <= u) & (bundles[q, 1] <= v) & (bundles[q, 2] <= w)
            if not below & (bundles[q, 3] >= x) & (bundles[q, 4] >= y) & (bundles[q, 5] >= z):
                continue
            i, begin = first + a, 0
            if second <= i + 2:
                begin = max(last[i] + 1 - second, 0)
            for b in range(begin, BUNDLE):
                row = np.uint64(BUNDLE) * q + np.uint64(b)
                found[count, 0], found[count, 1] = i, second + b
                below = (boxes[row, 0] <= u) & (boxes[row, 1] <= v) & (boxes[row, 2] <= w)
                count += below & (boxes[row, 3] >= x) & (boxes[row, 4] >= y) & (boxes[row, 5] >= z)
    return len(near), count
