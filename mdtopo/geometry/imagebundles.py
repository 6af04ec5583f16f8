"""Which edges of moving strands may come near each other, or near a periodic image of one? Bundles, and their ghosts.

As `mdtopo.geometry.bundles`, in a cell: each bundle is brought home, and images of bundles that can reach one there
stand beside them as ghosts (`mdtopo.geometry.broadphase`). Where strands are dense, this lists several times fewer
pairs of edges than spheres do, for far fewer of them are looked at one by one.
"""

from typing import Any, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.boxgrid import meeting_boxes
from mdtopo.geometry.broadphase import between_images, comes_later, with_ghosts
from mdtopo.geometry.bundles import (
    BUNDLE,
    ROW,
    Meetings,
    bundle_starts,
    joint_boxes,
    narrowed_boxes,
    pairs_across,
    pairs_along,
    rounded_down,
    rounded_up,
)
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.lattice import Basis, lattice_vector, total_length

IntArray = NDArray[np.signedinteger[Any]]
FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
Single: TypeAlias = tuple[np.float32, np.float32, np.float32]

FURTHEST_BUNDLE = 3.0
"""Cells. Where bundles could reach further, they have so many images that edges are better looked at one by one."""

SHIFT_ERROR = 16.0 * UNIT_ROUNDOFF
"""Rounding of a lattice vector, as a multiple of the lengths of the basis, times the greatest count."""

MOVING = np.float32(2.0**-22)
"""What a box grows by when it is moved, as a share of the two numbers: their sum is off by 2^-24 of it, this product by
2^-23 of itself, and the difference of both by 2^-24 of it. Numbers so small that products underflow are below
`mdtopo.geometry.bundles.LEAST_GROWTH`, by which the box and the move were rounded already."""


@njit(cache=True, nogil=True)
def near_boxes_in_cell(
    boxes: FloatArray, trace: IntArray, basis0: Basis, basis1: Basis
) -> tuple[IntArray, IntArray, bool]:
    """Return every pair of boxes that meet and their images, see `pairs_of_images`, and whether they were found.

    For `boxes` and `trace` see `mdtopo.geometry.bundles.near_boxes`. Where bundles have too many images, nothing is.
    """
    starts = bundle_starts(trace)
    narrow = narrowed_boxes(boxes, starts)
    meetings = meetings_in_cell(joint_boxes(narrow, starts), basis0, basis1)
    if len(meetings.source) == 0:
        return np.empty((0, 2), dtype=np.int32), np.empty((0, 3), dtype=np.int64), False
    pairs, images = pairs_of_images(narrow, meetings, starts, trace, basis0, basis1)
    return pairs, images, True


@njit(cache=True, nogil=True)
def meetings_in_cell(bundles: SingleArray, basis0: Basis, basis1: Basis) -> Meetings:
    """Return which bundles meet, images included; nothing is placed where they have too many images.

    Parameters
    ----------
    bundles : ndarray of float32, shape (6, n)
        From `mdtopo.geometry.bundles.joint_boxes`, of the strands as they are.
    basis0, basis1
        The cell at both ends of the step. `mdtopo.geometry.broadphase.cell_drift` must be below `MAX_CELL_DRIFT`.

    Guarantee
    ---------
    Conservative: two bundles of which an image of one meets the other at some time are a pair, once for each such image
    but for the two that follow each other along the strands and are shifted alike.
    """
    n = bundles.shape[1]
    centres, radii = np.empty((n, 3)), np.zeros(n)
    for k in range(n):
        for axis in range(3):
            low, high = np.float64(bundles[axis, k]), np.float64(bundles[axis + 3, k])
            centres[k, axis] = 0.5 * (low + high)
            radii[k] += (0.5 * (high - low)) ** 2
        radii[k] = np.sqrt(radii[k])
    source, images = with_ghosts(centres, centres, radii, basis0, basis1, FURTHEST_BUNDLE)
    if len(source) == 0:
        return Meetings(np.empty((0, 2), dtype=np.int32), source, source, images)
    placed, source, images = _placed_boxes(bundles, source, images, basis0, basis1)
    near, order = meeting_boxes(placed, n, False)
    return Meetings(_without_neighbours(near, order, source, images), order, source, images)


@njit(cache=True, nogil=True)
def _placed_boxes(
    bundles: SingleArray, source: IntArray, images: IntArray, basis0: Basis, basis1: Basis
) -> tuple[SingleArray, IntArray, IntArray]:
    """Return the boxes of the bundles at home, of ghosts that meet the box of all these, and what is placed then."""
    n, count = bundles.shape[1], 0
    placed = np.empty((6, len(source)), dtype=np.float32)
    home, rounding = np.empty(6, dtype=np.float32), SHIFT_ERROR * (total_length(basis0) + total_length(basis1))
    home[:3], home[3:] = np.inf, -np.inf
    for p in range(len(source)):
        least, greatest = shifts_of(images[p], basis0, basis1, rounding)
        meets = True
        for axis in range(3):
            low = sum_down(bundles[axis, source[p]], least[axis])
            high = sum_up(bundles[axis + 3, source[p]], greatest[axis])
            placed[axis, count], placed[axis + 3, count] = low, high
            if p < n:
                home[axis], home[axis + 3] = min(home[axis], low), max(home[axis + 3], high)
            else:
                meets &= low <= home[axis + 3] and high >= home[axis]
        source[count], images[count] = source[p], images[p]
        count += meets
    return placed[:, :count].copy(), source[:count].copy(), images[:count].copy()


@njit(cache=True, nogil=True)
def shifts_of(image: IntArray, basis0: Basis, basis1: Basis, rounding: float) -> tuple[Single, Single]:
    """Return the least and the greatest move of an image along each axis during the step, rounded outwards, Å.

    `rounding` is that of a shift by one lattice vector.
    """
    counts = (image[0], image[1], image[2])
    start, end = lattice_vector(counts, basis0), lattice_vector(counts, basis1)
    far = max(abs(counts[0]), abs(counts[1]), abs(counts[2]))
    rounding *= far
    return (
        rounded_down(min(start[0], end[0]) - rounding),
        rounded_down(min(start[1], end[1]) - rounding),
        rounded_down(min(start[2], end[2]) - rounding),
    ), (
        rounded_up(max(start[0], end[0]) + rounding),
        rounded_up(max(start[1], end[1]) + rounding),
        rounded_up(max(start[2], end[2]) + rounding),
    )


@njit(cache=True, nogil=True, forceinline=True)
def sum_down(x: np.float32, y: np.float32) -> np.float32:
    """Return a sum in single precision that is not greater."""
    return x + y - MOVING * (abs(x) + abs(y))


@njit(cache=True, nogil=True, forceinline=True)
def sum_up(x: np.float32, y: np.float32) -> np.float32:
    """Return a sum in single precision that is not less."""
    return x + y + MOVING * (abs(x) + abs(y))


@njit(cache=True, nogil=True)
def _without_neighbours(near: IntArray, order: IntArray, source: IntArray, images: IntArray) -> IntArray:
    """Return the pairs of placed bundles less those that follow each other along the strands and are shifted alike.

    The edges of these are tried in a row.
    """
    count = 0
    for k in range(len(near)):
        p, q = order[near[k, 0]], order[near[k, 1]]
        near[count, 0], near[count, 1] = near[k, 0], near[k, 1]
        count += not (
            abs(source[p] - source[q]) <= 1
            and images[p, 0] == images[q, 0]
            and images[p, 1] == images[q, 1]
            and images[p, 2] == images[q, 2]
        )
    return near[:count]


@njit(cache=True, nogil=True)
def moved_in_order(boxes: SingleArray, meetings: Meetings, basis0: Basis, basis1: Basis) -> SingleArray:
    """Return the boxes of the edges of all placed bundles, as `mdtopo.geometry.bundles.boxes_in_order` does."""
    order, source, images = meetings.order, meetings.source, meetings.images
    found, rounding = (
        np.empty(len(order) * ROW, np.float32),
        SHIFT_ERROR * (total_length(basis0) + total_length(basis1)),
    )
    for p in range(len(order)):
        first, at = np.uint64(BUNDLE * source[order[p]]), np.uint64(ROW * p)
        least, greatest = shifts_of(images[order[p]], basis0, basis1, rounding)
        for axis in range(3):
            lows, highs = at + np.uint64(BUNDLE * axis), at + np.uint64(BUNDLE * (axis + 3))
            for k in range(BUNDLE):
                place = np.uint64(k)
                found[lows + place] = sum_down(boxes[axis, first + place], least[axis])
                found[highs + place] = sum_up(boxes[axis + 3, first + place], greatest[axis])
    return found


@njit(cache=True, nogil=True)
def pairs_of_images(
    boxes: SingleArray, meetings: Meetings, starts: IntArray, trace: IntArray, basis0: Basis, basis1: Basis
) -> tuple[IntArray, IntArray]:
    """Return every pair of edges, images included, whose boxes meet, neighbours along a trace left out.

    Parameters
    ----------
    boxes, starts, trace : ndarray
        See `mdtopo.geometry.bundles.pairs_of_meetings`.
    meetings : Meetings
        From `meetings_in_cell`, of these boxes or of larger ones.
    basis0, basis1
        The cell at both ends of the step.

    Returns
    -------
    pairs : ndarray of int32, shape (k, 2)
        Edges i ≤ j.
    images : ndarray of int, shape (k, 3)
        Lattice counts of the second edge; for i = j the first that is not 0 is positive.

    Guarantee
    ---------
    Conservative: as of `pairs_of_meetings`, for each image of the second edge; each pair and image appears once.
    """
    along, count = pairs_along(boxes, starts, trace)
    across, of_across = pairs_across_images(boxes, meetings, meetings.near, starts, basis0, basis1)
    return with_images(along[:count], across, of_across)


@njit(cache=True, nogil=True)
def with_images(along: IntArray, across: IntArray, of_across: IntArray) -> tuple[IntArray, IntArray]:
    """Return pairs without an image, and pairs with one, in one list."""
    count, size = len(along), len(along) + len(across)
    pairs, images = np.empty((size, 2), dtype=np.int32), np.zeros((size, 3), dtype=np.int64)
    pairs[:count], pairs[count:], images[count:] = along, across, of_across
    return pairs, images


@njit(cache=True, nogil=True)
def pairs_across_images(
    boxes: SingleArray, meetings: Meetings, near: IntArray, starts: IntArray, basis0: Basis, basis1: Basis
) -> tuple[IntArray, IntArray]:
    """Return the pairs of edges that meet across some pairs of placed bundles, in a row, as `pairs_of_images` does."""
    source, placed = meetings.source, meetings.images
    ids = BUNDLE * np.arange(len(source) + 1)
    sorted_boxes = moved_in_order(boxes, meetings, basis0, basis1)
    pairs = pairs_across(np.empty((0, 2), dtype=np.int32), 0, near, ids, meetings.order, sorted_boxes)
    images = np.empty((len(pairs), 3), dtype=np.int64)
    for k in range(len(pairs)):
        p, q = pairs[k, 0] // BUNDLE, pairs[k, 1] // BUNDLE
        i = starts[source[p]] + pairs[k, 0] % BUNDLE
        j = starts[source[q]] + pairs[k, 1] % BUNDLE
        image = between_images(placed, p, q)
        if comes_later(i, j, image):
            i, j, image = j, i, (-image[0], -image[1], -image[2])
        pairs[k, 0], pairs[k, 1] = i, j
        images[k, 0], images[k, 1], images[k, 2] = image
    return pairs, images
