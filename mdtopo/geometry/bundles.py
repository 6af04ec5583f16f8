"""Which edges of moving strands may come near each other? Boxes of a few edges in a row first, then boxes of edges.

A box is tight about an edge where a sphere is not: among compact strands four times fewer pairs have boxes that meet.
Neighbours along a strand are near in space, so a bundle of them is found once instead of edge by edge
(`mdtopo.geometry.boxgrid`); and the edges of all bundles that meet one are tried together, eight or sixteen at a time.

Boxes are in single precision, which only widens them: seen from about their middle, as rows of numbers: least x of all,
least y, least z, then the greatest. An edge has a place in them: a bundle has `BUNDLE` places, and those without
an edge, at the end of a trace, hold a box that is turned inside out, which meets nobody.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.boxgrid import meeting_boxes
from mdtopo.geometry.broadphase import grown_rows
from mdtopo.geometry.vectors import Vector, norm, row, subtract
from mdtopo.geometry.windows import HIGH, LOW, STRIDE, WIDE, bound_edges, fill_window, fresh_window

IntArray = NDArray[np.signedinteger[Any]]
FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
FlagArray = NDArray[np.uint8]
WholeArray = NDArray[np.uint64]

BUNDLE = 8
"""Edges in a bundle. Fewer cost more to find; more have looser boxes, and more pairs of edges to try in them. A window
holds whole bundles."""

NARROWING = 2.0**-22
"""What a box grows by, as a multiple of its coordinates: the rounding to float32 (2^-24 of them), and of the difference
before it (2^-53), then only widens it."""

LEAST_GROWTH = 2.0**-140
"""Å. And by this much, as small numbers are rounded more coarsely in float32 (2^-150)."""

MIDDLE = 9
"""Points of which the middle is taken."""

SPARE = WIDE
"""Places behind the last bundle: a window is written whole, and its last numbers may have no meaning."""

CROWD = 128
"""Edges that are tried together, at most."""

GROUP = 16
"""And of these so many at a time."""

ROW = 6 * BUNDLE
"""Numbers of a bundle in `boxes_in_order`."""

EIGHT = np.uint64(8)


class Meetings(NamedTuple):
    """Which bundles meet.

    Attributes
    ----------
    near : ndarray of int32, shape (k, 2)
        Pairs of bundles, as places in `order`; those of the same first bundle in a row, and none that follow each other
        along the traces.
    order : ndarray of int, shape (n,)
        Bundles, those near in space near each other. Where there are images, a bundle here is a placed one.
    source, images : ndarray of int, shapes (n,) and (n, 3), or (0,) and (0, 3)
        Of each placed bundle which one it is, and by how many lattice vectors it is moved: see
        `mdtopo.geometry.imagebundles`. Empty where there are no images.
    """

    near: IntArray
    order: IntArray
    source: IntArray
    images: IntArray


@njit(cache=True, nogil=True)
def near_boxes(boxes: FloatArray, trace: IntArray) -> IntArray:
    """Return every pair of boxes that meet, neighbours along a trace left out; see `pairs_of_meetings`.

    Parameters
    ----------
    boxes : ndarray, shape (m, 6)
        Of what goes along each edge: least x, y, z, then greatest x, y, z, Å. At least one.
    trace : ndarray of int, shape (m,)
        The trace of each, in trace order: where two in a row have the same trace, the second starts where the first
        ends.
    """
    starts = bundle_starts(trace)
    narrow = narrowed_boxes(boxes, starts)
    return pairs_of_meetings(narrow, meetings_of(joint_boxes(narrow, starts)), starts, trace)


@njit(cache=True, nogil=True)
def meetings_of(bundles: SingleArray) -> Meetings:
    """Return which bundles meet, without images; see `joint_boxes`."""
    near, order = meeting_boxes(bundles, bundles.shape[1], True)
    return Meetings(near, order, np.empty(0, dtype=np.int64), np.empty((0, 3), dtype=np.int64))


@njit(cache=True, nogil=True)
def pairs_of_meetings(boxes: SingleArray, meetings: Meetings, starts: IntArray, trace: IntArray) -> IntArray:
    """Return every pair of edges whose boxes meet, neighbours along a trace left out.

    Parameters
    ----------
    boxes : ndarray of float32, shape (6, p)
        Of all places, see `edge_boxes`.
    meetings : Meetings
        Of these boxes, or of larger ones.
    starts, trace : ndarray of int
        See `bundle_starts` and `near_boxes`.

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
    found, count = pairs_along(boxes, starts, trace)
    return pairs_across(found, count, meetings.near, starts, meetings.order, boxes_in_order(boxes, meetings.order))


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
def middle_of(points: FloatArray) -> Vector:
    """Return the median along each axis of a few of the points: some that are far away do not move it."""
    x, y, z = np.empty(MIDDLE), np.empty(MIDDLE), np.empty(MIDDLE)
    for k in range(MIDDLE):
        x[k], y[k], z[k] = row(points, k * (len(points) - 1) // (MIDDLE - 1))
    return median_of(x), median_of(y), median_of(z)


@njit(cache=True, nogil=True)
def median_of(values: FloatArray) -> float:
    """Return the median of an odd number of values."""
    for k in range(len(values)):
        below = 0
        for i in range(len(values)):
            below += values[i] < values[k] or (values[i] == values[k] and i < k)
        if below == len(values) // 2:
            return values[k]
    return values[0]


@njit(cache=True, nogil=True, forceinline=True)
def rounded_down(x: float) -> np.float32:
    """Return a number in single precision that is not greater."""
    return np.float32(x - NARROWING * abs(x) - LEAST_GROWTH)


@njit(cache=True, nogil=True, forceinline=True)
def rounded_up(x: float) -> np.float32:
    """Return a number in single precision that is not less."""
    return np.float32(x + NARROWING * abs(x) + LEAST_GROWTH)


@njit(cache=True, nogil=True)
def edge_boxes(x0: FloatArray, x1: FloatArray, edges: IntArray, pads: FloatArray, starts: IntArray) -> SingleArray:
    """Return the box that each edge stays in, enlarged by its pad, shape (6, places).

    Parameters
    ----------
    x0, x1 : ndarray, shape (n, 3)
        Vertices at the start and the end of the step, Å.
    edges : ndarray of int, shape (m, 2)
        At least one. They follow each other within a trace and nowhere else: so a piece of strand has whole bundles.
    pads : ndarray, shape (m,)
        By how much each edge is enlarged, Å.
    starts : ndarray of int
        See `bundle_starts`.

    Raises
    ------
    ValueError
        If edges of one trace do not follow each other: a bug.
    """
    boxes = np.empty((6, BUNDLE * (len(starts) - 1) + SPARE), dtype=np.float32)
    window, padding = fresh_window(), np.zeros(WIDE)
    origin, first, place = middle_of(x0), 0, np.uint64(0)
    while first < len(edges):
        count = fill_window(window, x0, x1, edges, first)
        bound_edges(window)
        for k in range(count):
            padding[k] = pads[first + k]
        for axis in range(3):
            for k in range(WIDE):
                low = window[(LOW + axis) * STRIDE + k] - origin[axis]
                boxes[axis, place + np.uint64(k)] = rounded_down(low - padding[k])
            for k in range(WIDE):
                high = window[(HIGH + axis) * STRIDE + k] - origin[axis]
                boxes[axis + 3, place + np.uint64(k)] = rounded_up(high + padding[k])
        first += count
        place += np.uint64(BUNDLE * ((count + BUNDLE - 1) // BUNDLE))
    if place != np.uint64(BUNDLE * (len(starts) - 1)):
        raise ValueError("edges of one trace do not follow each other")
    turn_empty_places(boxes, starts)
    return boxes


@njit(cache=True, nogil=True)
def narrowed_boxes(boxes: FloatArray, starts: IntArray) -> SingleArray:
    """Return boxes as `edge_boxes` does, of boxes that are known, shape (m, 6)."""
    narrow, origin = np.empty((6, BUNDLE * (len(starts) - 1) + SPARE), dtype=np.float32), middle_of(boxes)
    for n in range(len(starts) - 1):
        for k in range(starts[n], starts[n + 1]):
            place = BUNDLE * n + k - starts[n]
            for axis in range(3):
                narrow[axis, place] = rounded_down(boxes[k, axis] - origin[axis])
                narrow[axis + 3, place] = rounded_up(boxes[k, axis + 3] - origin[axis])
    turn_empty_places(narrow, starts)
    return narrow


@njit(cache=True, nogil=True)
def turn_empty_places(boxes: SingleArray, starts: IntArray) -> None:
    """Write a box that is turned inside out where a bundle has no edge."""
    for n in range(len(starts) - 1):
        for place in range(BUNDLE * n + starts[n + 1] - starts[n], BUNDLE * n + BUNDLE):
            for axis in range(3):
                boxes[axis, place], boxes[axis + 3, place] = np.inf, -np.inf


@njit(cache=True, nogil=True)
def joint_boxes(boxes: SingleArray, starts: IntArray) -> SingleArray:
    """Return the box that holds the boxes of each bundle, shape (6, n)."""
    joint = np.empty((6, len(starts) - 1), dtype=np.float32)
    for n in range(len(starts) - 1):
        for axis in range(3):
            place = np.uint64(BUNDLE * n)
            low, high = boxes[axis, place], boxes[axis + 3, place]
            for k in range(1, BUNDLE):
                low = min(low, boxes[axis, place + np.uint64(k)])
                high = max(high, boxes[axis + 3, place + np.uint64(k)])
            joint[axis, n], joint[axis + 3, n] = low, high
    return joint


@njit(cache=True, nogil=True)
def diagonal_of(boxes: SingleArray) -> float:
    """Return how long the diagonal is of the box that holds all boxes, Å: no two points in them are further apart."""
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for k in range(boxes.shape[1]):
        low = (min(low[0], boxes[0, k]), min(low[1], boxes[1, k]), min(low[2], boxes[2, k]))
        high = (max(high[0], boxes[3, k]), max(high[1], boxes[4, k]), max(high[2], boxes[5, k]))
    return norm(subtract(high, low))


@njit(cache=True, nogil=True)
def pairs_along(boxes: SingleArray, starts: IntArray, trace: IntArray) -> tuple[IntArray, int]:
    """Return the pairs of edges whose boxes meet of one bundle, or of two that follow each other, and how many.

    All boxes are tried in a row, each against the one three places on, then four places on, and so on. Those one or two
    places on are neighbours, except where one trace ends and another begins.
    """
    n, places = len(starts) - 1, BUNDLE * (len(starts) - 1)
    found, count = np.empty((2 * places + 64, 2), dtype=np.int32), 0
    eights = np.zeros(places // 8 + 2, dtype=np.uint64)  # room for a last gap too
    for gap in range(3, 2 * BUNDLE):
        if count + places + 8 > len(found):
            found = grown_rows(found, 3 * len(found) // 2 + places)
        _flag_at_gap(boxes, max(places - gap, 0), np.uint64(gap), eights.view(np.uint8))
        count = _pairs_at_gap(starts, gap, eights, found, count)
    if count + 3 * n > len(found):
        found = grown_rows(found, len(found) + 3 * n)
    for m in range(n - 1):
        i = starts[m + 1] - 1
        if trace[i] != trace[i + 1] and i - starts[m] >= BUNDLE - 2:
            count = _pairs_between_traces(boxes, starts, m, found, count)
    return found, count


@njit(cache=True, nogil=True)
def _pairs_at_gap(starts: IntArray, gap: int, eights: WholeArray, found: IntArray, count: int) -> int:
    """Add the pairs that are flagged, see `_flag_at_gap`, less those of bundles further apart; return how many."""
    flags, n = eights.view(np.uint8), len(starts) - 1
    for h in range((BUNDLE * n) // 8):
        if eights[h] != 0:
            for k in range(8 * h, 8 * h + 8):
                one, other = k // BUNDLE, (k + gap) // BUNDLE
                found[count, 0] = starts[one] + k % BUNDLE
                found[count, 1] = starts[min(other, n)] + (k + gap) % BUNDLE
                count += flags[k] & (other - one <= 1)
    return count


@njit(cache=True, nogil=True)
def _flag_at_gap(b: SingleArray, size: int, gap: np.uint64, flags: FlagArray) -> None:
    """Flag which of the first boxes, so many, meet the one that is so many places on; no flag is left behind them."""
    for k in range(np.uint64(size)):
        q = k + gap
        below = (b[0, q] <= b[3, k]) & (b[1, q] <= b[4, k]) & (b[2, q] <= b[5, k])
        flags[k] = below & (b[3, q] >= b[0, k]) & (b[4, q] >= b[1, k]) & (b[5, q] >= b[2, k])
    flags[size : size + 2 * BUNDLE] = 0


@njit(cache=True, nogil=True)
def _pairs_between_traces(boxes: SingleArray, starts: IntArray, m: int, found: IntArray, count: int) -> int:
    """Add what of two bundles of different traces is one or two places apart and meets; return how many pairs that is.

    Places without an edge hold boxes that meet nobody.
    """
    for k, q in ((BUNDLE - 1, BUNDLE), (BUNDLE - 1, BUNDLE + 1), (BUNDLE - 2, BUNDLE)):
        one, other = BUNDLE * m + k, BUNDLE * m + q
        meet = True
        for axis in range(3):
            meet &= boxes[axis, other] <= boxes[axis + 3, one] and boxes[axis, one] <= boxes[axis + 3, other]
        if meet:
            found[count, 0], found[count, 1] = starts[m] + k, starts[m + 1] + q - BUNDLE
            count += 1
    return count


@njit(cache=True, nogil=True)
def boxes_in_order(boxes: SingleArray, order: IntArray) -> SingleArray:
    """Return the boxes of the edges, those of a bundle together: bundles in the given order, and so near in memory.

    Of each bundle first the least x of its edges, then the least y, and so on: shape (6·BUNDLE·n,).
    """
    found = np.empty(len(order) * ROW, dtype=np.float32)
    for p in range(len(order)):
        for axis in range(6):
            for k in range(BUNDLE):
                found[np.uint64(ROW * p + BUNDLE * axis + k)] = boxes[axis, np.uint64(BUNDLE * order[p] + k)]
    return found


@njit(cache=True, nogil=True)
def pairs_across(
    found: IntArray, count: int, near: IntArray, starts: IntArray, order: IntArray, boxes: SingleArray
) -> IntArray:
    """Return the pairs that are found already, and those across bundles that meet.

    Parameters
    ----------
    found, count
        See `pairs_along`.
    near, order : ndarray of int
        See `Meetings`; `near` may be some pairs of it in a row.
    starts, boxes : ndarray
        See `bundle_starts` and `boxes_in_order`.
    """
    done = 0
    while True:
        if count + BUNDLE * CROWD + 8 > len(found):  # by half: while it is copied, both are held
            found = grown_rows(found, 3 * len(found) // 2 + BUNDLE * CROWD + 8)
        done, count = _pairs_across_into(found, count, near, done, starts, order, boxes)
        if done == len(near):
            return found[:count]


@njit(cache=True, nogil=True)
def _pairs_across_into(
    found: IntArray, count: int, near: IntArray, done: int, starts: IntArray, order: IntArray, boxes: SingleArray
) -> tuple[int, int]:
    """Go on with `pairs_across` behind so many pairs of bundles while there is room; return what is done and found.

    (A loop that puts a larger array in the place of `found` would count the references of both in every round.)
    """
    crowd, edge_of = np.empty(6 * CROWD, dtype=np.float32), np.empty(CROWD, dtype=np.int64)
    eights = np.zeros(CROWD // 8, dtype=np.uint64)
    flags = eights.view(np.uint8)
    while done < len(near) and count + BUNDLE * CROWD + 8 <= len(found):
        p = near[done, 0]
        bundle, size = order[p], np.uint64(0)
        while done < len(near) and near[done, 0] == p and size < np.uint64(CROWD):
            q = near[done, 1]
            other, done = order[q], done + 1
            for k in range(BUNDLE):
                edge_of[size + np.uint64(k)] = starts[other] + k
                for axis in range(6):
                    to = np.uint64(axis * CROWD + k) + size
                    crowd[to] = boxes[np.uint64(ROW) * np.uint64(q) + np.uint64(BUNDLE * axis + k)]
            size += np.uint64(BUNDLE)
        groups = (size + np.uint64(GROUP - 1)) // np.uint64(GROUP)
        for k in range(size, groups * np.uint64(GROUP)):
            crowd[k], crowd[np.uint64(3 * CROWD) + k], edge_of[k] = np.inf, -np.inf, 0
        for a in range(BUNDLE):
            i, at = starts[bundle] + a, np.uint64(ROW) * np.uint64(p) + np.uint64(a)
            _flag_crowd(crowd, groups, boxes, at, flags)
            for h in range(groups * np.uint64(GROUP // 8)):
                if eights[h] != 0:
                    for k in range(EIGHT * h, EIGHT * h + EIGHT):
                        found[count, 0], found[count, 1] = min(i, edge_of[k]), max(i, edge_of[k])
                        count += flags[k]
    return done, count


@njit(cache=True, nogil=True, forceinline=True)
def _flag_crowd(crowd: SingleArray, groups: np.uint64, boxes: SingleArray, at: np.uint64, flags: FlagArray) -> None:
    """Flag which boxes of a crowd, so many groups, meet the one whose least x is at this place of `boxes`."""
    x, y, z = boxes[at], boxes[at + np.uint64(BUNDLE)], boxes[at + np.uint64(2 * BUNDLE)]
    u, v, w = boxes[at + np.uint64(3 * BUNDLE)], boxes[at + np.uint64(4 * BUNDLE)], boxes[at + np.uint64(5 * BUNDLE)]
    for group in range(groups):
        for n in range(GROUP):
            k = group * np.uint64(GROUP) + np.uint64(n)
            below = (crowd[k] <= u) & (crowd[np.uint64(CROWD) + k] <= v) & (crowd[np.uint64(2 * CROWD) + k] <= w)
            above = (crowd[np.uint64(3 * CROWD) + k] >= x) & (crowd[np.uint64(4 * CROWD) + k] >= y)
            flags[k] = below & above & (crowd[np.uint64(5 * CROWD) + k] >= z)
