"""Which edges of moving strands may come near each other? Boxes of a few edges in a row first, then boxes of edges.

A box is tight about an edge where a sphere is not: among compact strands four times fewer pairs have boxes that meet.
Neighbours along a strand are near in space, so a bundle of them is found in the cell grid once instead of edge by edge.
There are no periodic images here; `mdtopo.geometry.broadphase` has them.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import GRID_GUARD, SLICES, cells_between, grown_rows, sorted_into_cells
from mdtopo.geometry.lattice import Counts
from mdtopo.geometry.vectors import Vector

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

BUNDLE = 4
"""Edges in a bundle. Fewer cost more in the grid; more have looser boxes, and more pairs of edges to try in them."""


@njit(cache=True, nogil=True)
def near_edges(x0: FloatArray, x1: FloatArray, edges: IntArray, trace: IntArray, pads: FloatArray) -> IntArray:
    """Return every pair of linearly moving edges whose padded boxes meet, neighbours along a trace left out.

    Parameters
    ----------
    x0, x1 : ndarray, shape (n, 3)
        Vertices at the start and the end of the step, Å.
    edges : ndarray of int, shape (m, 2)
        At least one, in trace order: where two in a row have the same trace, the second starts where the first ends.
    trace : ndarray of int, shape (m,)
        The trace of each edge.
    pads : ndarray, shape (m,)
        By how much the box of each edge is enlarged, Å; more than the rounding of a coordinate.

    Returns
    -------
    pairs : ndarray of int, shape (k, 2)
        Edges i < j, without those at most two places apart on one trace. (Around the end of a ring they are listed.)

    Guarantee
    ---------
    Conservative: two edges of a pair that is missing are further apart than the sum of their pads, along one of the
    axes, at every time of the step: an edge stays in the box that holds both its ends before and after.
    """
    return near_boxes(edge_boxes(x0, x1, edges, pads), trace)


@njit(cache=True, nogil=True)
def near_boxes(boxes: FloatArray, trace: IntArray) -> IntArray:
    """Return every pair of boxes that meet, in the order of their edges, neighbours along a trace left out.

    Parameters
    ----------
    boxes : ndarray, shape (m, 6)
        Of each edge, or of what goes along it: least x, y, z, then greatest x, y, z, Å.
    trace : ndarray of int, shape (m,)
        The trace of each, in trace order.

    Returns
    -------
    pairs : ndarray of int, shape (k, 2)
        Edges i < j, without those at most two places apart on one trace; see `near_edges`.
    """
    starts = bundle_starts(trace)
    bundles = joint_boxes(boxes, starts)
    return edge_pairs(meeting_boxes(bundles), starts, bundles, boxes, last_neighbours(trace))


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
def meeting_boxes(boxes: FloatArray) -> IntArray:
    """Return every pair of boxes that meet, lower index first, and each box with itself.

    Each box lies in the cell of its centre. Boxes of ordinary size that meet lie in the same cell or in adjacent ones;
    larger ones look as far as they can reach.
    """
    n = len(boxes)
    places = np.empty((n, 4))  # centre, and half the longest side
    for k in range(n):
        size = 0.0
        for axis in range(3):
            places[k, axis] = 0.5 * (boxes[k, axis] + boxes[k, axis + 3])
            size = max(size, 0.5 * (boxes[k, axis + 3] - boxes[k, axis]))
        places[k, 3] = size * GRID_GUARD
    order, starts, shape, low, width = sorted_into_cells(places)
    boxes, places = boxes[order], places[order]
    found = np.empty((6 * n + 64, 2), dtype=np.int64)
    for k in range(n):
        found[k, 0] = found[k, 1] = k
    found, count = _scan_ordinary(order, starts, shape, width, boxes, places, found, n)
    found, count = _scan_large(order, starts, shape, low, width, boxes, places, found, count)
    return found[:count]


@njit(cache=True, nogil=True)
def _scan_ordinary(
    order: IntArray,
    starts: IntArray,
    shape: Counts,
    width: float,
    boxes: FloatArray,
    places: FloatArray,
    found: IntArray,
    count: int,
) -> tuple[IntArray, int]:
    """Add the pairs of ordinary boxes: a cell meets the rest of its own row, and the rows beside it that come later.

    Here a large box is turned inside out, with which it meets nobody.
    """
    nx, ny, nz = shape
    boxes = boxes.copy()
    for p in range(len(boxes)):
        if 2.0 * places[p, 3] > width:
            boxes[p, :3], boxes[p, 3:] = np.inf, -np.inf
    for cell in range(nx * ny * nz):
        begin, end = starts[cell], starts[cell + 1]
        if begin == end:
            continue
        a, b, c = cell % nx, (cell // nx) % ny, cell // (nx * ny)
        left, right = max(a - SLICES, 0), min(a + SLICES + 1, nx)
        for other_c in range(c, min(c + 2, nz)):
            for other_b in range(b if other_c == c else max(b - 1, 0), min(b + 2, ny)):
                first_cell = (other_c * ny + other_b) * nx
                own_row = other_b == b and other_c == c
                lower, upper = starts[first_cell + left], starts[first_cell + right]
                if count + (end - begin) * (upper - lower) > len(found):
                    found = grown_rows(found, 2 * len(found) + (end - begin) * (upper - lower))
                for p in range(begin, end):
                    count = _append_meeting(p, p + 1 if own_row else lower, upper, order, boxes, found, count)
    return found, count


@njit(cache=True, nogil=True, inline="always")
def _append_meeting(
    p: int, lower: int, upper: int, order: IntArray, boxes: FloatArray, found: IntArray, count: int
) -> int:
    """Append the pairs of box p with those of a range that it meets, and return the new count; without a branch."""
    i, x, y, z = order[p], boxes[p, 0], boxes[p, 1], boxes[p, 2]
    u, v, w = boxes[p, 3], boxes[p, 4], boxes[p, 5]
    for q in range(lower, upper):
        j = order[q]
        found[count, 0], found[count, 1] = min(i, j), max(i, j)
        below = (boxes[q, 0] <= u) & (boxes[q, 1] <= v) & (boxes[q, 2] <= w)
        count += below & (boxes[q, 3] >= x) & (boxes[q, 4] >= y) & (boxes[q, 5] >= z)
    return count


@njit(cache=True, nogil=True)
def _scan_large(
    order: IntArray,
    starts: IntArray,
    shape: Counts,
    low: Vector,
    width: float,
    boxes: FloatArray,
    places: FloatArray,
    found: IntArray,
    count: int,
) -> tuple[IntArray, int]:
    """Add the pairs of which one box is large: each looks as far as it can reach, and of two the later one looks."""
    nx, ny, nz = shape
    largest = places[:, 3].max()
    for p in range(len(boxes)):
        if not 2.0 * places[p, 3] > width:
            continue
        far = (places[p, 3] + largest) * GRID_GUARD
        left, right = cells_between(places[p, 0] - low[0], far, width / SLICES, nx)
        first_b, last_b = cells_between(places[p, 1] - low[1], far, width, ny)
        first_c, last_c = cells_between(places[p, 2] - low[2], far, width, nz)
        for c in range(first_c, last_c + 1):
            for b in range(first_b, last_b + 1):
                first_cell = (c * ny + b) * nx
                lower, upper = starts[first_cell + left], starts[first_cell + right + 1]
                if count + upper - lower > len(found):
                    found = grown_rows(found, 2 * len(found) + upper - lower)
                for q in range(lower, upper):
                    if q < p or not 2.0 * places[q, 3] > width:
                        count = _append_meeting(p, q, q + 1, order, boxes, found, count)
    return found, count


@njit(cache=True, nogil=True)
def edge_pairs(near: IntArray, starts: IntArray, bundles: FloatArray, boxes: FloatArray, last: IntArray) -> IntArray:
    """Return the pairs of edges, of bundles that meet, whose own boxes meet; without neighbours along a trace."""
    found, count = np.empty((4 * len(boxes) + 64, 2), dtype=np.int64), 0
    for n in range(len(near)):
        first, second = near[n, 0], near[n, 1]
        if count + BUNDLE * BUNDLE > len(found):
            found = grown_rows(found, 2 * len(found))
        for i in range(starts[first], starts[first + 1]):
            x, y, z, u, v, w = boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3], boxes[i, 4], boxes[i, 5]
            below = (bundles[second, 0] <= u) & (bundles[second, 1] <= v) & (bundles[second, 2] <= w)
            if not below & (bundles[second, 3] >= x) & (bundles[second, 4] >= y) & (bundles[second, 5] >= z):
                continue
            for j in range(max(starts[second], last[i] + 1), starts[second + 1]):
                found[count, 0], found[count, 1] = i, j
                below = (boxes[j, 0] <= u) & (boxes[j, 1] <= v) & (boxes[j, 2] <= w)
                count += below & (boxes[j, 3] >= x) & (boxes[j, 4] >= y) & (boxes[j, 5] >= z)
    return found[:count]
