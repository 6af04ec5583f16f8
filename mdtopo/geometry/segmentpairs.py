"""Which segments of a moving curve may meet each other, or themselves? Those that chords do not tell apart.

Nearly all segments and pairs of a curve are settled by their chords and boxes (`segmentshapes`). What is left is
listed, for `mdtopo.geometry.subdivision` to settle.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import candidate_pairs, images_can_meet
from mdtopo.geometry.bundles import near_boxes
from mdtopo.geometry.distances import LEAST_SQUARE
from mdtopo.geometry.imagebundles import near_boxes_in_cell
from mdtopo.geometry.lattice import basis_of, lattice_vector
from mdtopo.geometry.segmenthulls import JOINT, PAIR, SELF
from mdtopo.geometry.segmentshapes import MID0, MID1, RADIUS, chord_separation
from mdtopo.geometry.vectors import Vector, add, norm

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]


@njit(cache=True, nogil=True)
def lone_checks(
    c0: FloatArray, c1: FloatArray, shapes: FloatArray, following: IntArray, rounding: float
) -> tuple[IntArray, FloatArray]:
    """Return what hulls have to check along the strands: segments (S1), joints (S2), and pairs with one between.

    Returns
    -------
    checks : ndarray of int, shape (k, 6)
        Rows (kind, segment, segment, image): all pairs with one segment between, but only those segments and joints
        that do not run along their chords all the time.
    lows : ndarray, shape (k,)
        What chords prove of the distance of the pairs; 0 for others.
    """
    m, count = c0.shape[0], 0
    checks, lows = np.zeros((3 * m, 6), dtype=np.int64), np.zeros(3 * m)
    error, unmoved = 2.0 * rounding, (0.0, 0.0, 0.0)
    for k in range(m):
        w = _both_chords(c0, c1, k)
        least = min(_least_step(c0, k, w), _least_step(c1, k, w))
        if not least > error * norm(w) + LEAST_SQUARE:
            checks[count, 0], checks[count, 1], checks[count, 2] = SELF, k, k
            count += 1
        after = following[k]
        if after < 0:
            continue
        w = add(w, _both_chords(c0, c1, after))
        least = min(_least_from_joint(c0, k, after, w), _least_from_joint(c1, k, after, w))
        if not least > error * norm(w) + LEAST_SQUARE:
            checks[count, 0], checks[count, 1], checks[count, 2] = JOINT, k, after
            count += 1
    first = count
    for k in range(m):
        after = _two_after(k, following)
        if after >= 0:
            checks[count, 0], checks[count, 1], checks[count, 2] = PAIR, k, after
            lows[count], _ = chord_separation(shapes, k, after, unmoved, unmoved, rounding)
            count += 1
    _bring_closest(first, checks[:count], lows[:count])
    return checks[:count], lows[:count]


@njit(cache=True, nogil=True)
def _two_after(k: int, following: IntArray) -> int:
    """Return the segment that has one between itself and segment k; -1 where there is none, or k is the one named.

    A ring of three has no such pair, and in a ring of four each is met from both sides.
    """
    after = following[k]
    after = following[after] if after >= 0 else -1
    if after < 0 or following[after] == k:
        return -1
    further = following[after]
    return -1 if further >= 0 and following[further] == k and after < k else after


@njit(cache=True, nogil=True)
def _bring_closest(first: int, checks: IntArray, lows: FloatArray) -> None:
    """Exchange the first pair of a list for the one with the least bound: what that proves spares most of the others.

    Pairs begin at row `first`.
    """
    closest = first
    for k in range(first, len(checks)):
        if lows[k] < lows[closest]:
            closest = k
    if closest > first:
        lows[first], lows[closest] = lows[closest], lows[first]
        for column in range(6):
            checks[first, column], checks[closest, column] = checks[closest, column], checks[first, column]


@njit(cache=True, nogil=True)
def _both_chords(c0: FloatArray, c1: FloatArray, k: int) -> Vector:
    n = c0.shape[1] - 1
    return (
        c0[k, n, 0] - c0[k, 0, 0] + c1[k, n, 0] - c1[k, 0, 0],
        c0[k, n, 1] - c0[k, 0, 1] + c1[k, n, 1] - c1[k, 0, 1],
        c0[k, n, 2] - c0[k, 0, 2] + c1[k, n, 2] - c1[k, 0, 2],
    )


@njit(cache=True, nogil=True)
def _least_step(c: FloatArray, k: int, w: Vector) -> float:
    """Return the least w·(P_(i+1) - P_i) of a segment."""
    least = np.inf
    for i in range(c.shape[1] - 1):
        step = w[0] * (c[k, i + 1, 0] - c[k, i, 0]) + w[1] * (c[k, i + 1, 1] - c[k, i, 1])
        least = min(least, step + w[2] * (c[k, i + 1, 2] - c[k, i, 2]))
    return least


@njit(cache=True, nogil=True)
def _least_from_joint(c: FloatArray, k: int, after: int, w: Vector) -> float:
    """Return the least w·(J - P_i), i < n, and w·(P'_j - J), j > 0, of two segments that meet at J."""
    n, least = c.shape[1] - 1, np.inf
    joint = w[0] * c[k, n, 0] + w[1] * c[k, n, 1] + w[2] * c[k, n, 2]
    for i in range(n):
        least = min(least, joint - (w[0] * c[k, i, 0] + w[1] * c[k, i, 1] + w[2] * c[k, i, 2]))
        j = i + 1
        least = min(least, w[0] * c[after, j, 0] + w[1] * c[after, j, 1] + w[2] * c[after, j, 2] - joint)
    return least


@njit(cache=True, nogil=True, inline="always")
def pair_checks(
    shapes: FloatArray,
    boxes: FloatArray,
    following: IntArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
    reach: float,
    rounding: float,
) -> tuple[IntArray, FloatArray, bool]:
    """Return the pairs of segments (S3) that chords do not prove to stay further apart than `reach`, Å.

    Parameters
    ----------
    shapes, boxes : ndarray, shape (m, 14) and (m, 6)
        From `mdtopo.geometry.segmentshapes.shapes_of`.
    following : ndarray of int, shape (m,)
        The segment that follows each one, -1 at an open end. Pairs with fewer than two segments between are left out.
    cell0, cell1 : ndarray, shape (3, 3)
        Lattice vectors at both ends; ignored unless periodic.
    periodic : bool
    reach, rounding : float
        `rounding` is how far a coordinate may be off, Å.

    Returns
    -------
    checks : ndarray of int, shape (k, 6)
        Rows (PAIR, i, j, image of j).
    lows : ndarray, shape (k,)
        What chords prove of their distances.
    is_complete : bool
        False where periodic images could not be counted.
    """
    pairs, images, is_complete = _pairs_in_reach(
        shapes, boxes, following, cell0, cell1, periodic, 0.5 * reach + rounding
    )
    basis0, basis1 = basis_of(cell0), basis_of(cell1)
    shift0, shift1, image = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0, 0, 0)
    checks, lows, count = np.empty((len(pairs), 6), dtype=np.int64), np.empty(len(pairs)), 0
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        if len(images) > 0:
            image = (images[k, 0], images[k, 1], images[k, 2])
        if image == (0, 0, 0):
            if _is_near_along_strand(i, j, following):
                continue
            shift0 = shift1 = (0.0, 0.0, 0.0)
        else:
            shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
        lows[count], _ = chord_separation(shapes, i, j, shift0, shift1, rounding)
        if lows[count] > reach:
            continue
        checks[count, 0], checks[count, 1], checks[count, 2] = PAIR, i, j
        checks[count, 3], checks[count, 4], checks[count, 5] = image
        count += 1
    _bring_closest(0, checks[:count], lows[:count])
    return checks[:count], lows[:count], is_complete


@njit(cache=True, nogil=True, inline="always")
def _pairs_in_reach(
    shapes: FloatArray,
    boxes: FloatArray,
    following: IntArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
    pad: float,
) -> tuple[IntArray, IntArray, bool]:
    """Return the pairs whose padded boxes meet, or spheres where there are many images; and whether all were found."""
    m = len(following)
    trace, padded = np.zeros(m, dtype=np.int64), np.empty((m, 6))
    for k in range(m):
        if k > 0:
            trace[k] = trace[k - 1] if following[k - 1] == k else trace[k - 1] + 1
        for axis in range(3):
            padded[k, axis], padded[k, axis + 3] = boxes[k, axis] - pad, boxes[k, axis + 3] + pad
    if periodic:
        mid0, mid1 = shapes[:, MID0 : MID0 + 3].copy(), shapes[:, MID1 : MID1 + 3].copy()
        radii, basis0, basis1 = shapes[:, RADIUS] + pad, basis_of(cell0), basis_of(cell1)
        if images_can_meet(mid0, mid1, radii, basis0, basis1):
            pairs, images, is_found = near_boxes_in_cell(padded, trace, basis0, basis1)
            if is_found:
                return pairs, images, True
            return candidate_pairs(mid0, mid1, radii, cell0, cell1, periodic)
    return near_boxes(padded, trace), np.empty((0, 3), dtype=np.int64), True


@njit(cache=True, nogil=True)
def _is_near_along_strand(i: int, j: int, following: IntArray) -> bool:
    """Return whether two segments are the same one, or have at most one segment between them."""
    for one, other in ((i, j), (j, i)):
        after = following[one]
        if one == other or after == other or (after >= 0 and following[after] == other):
            return True
    return False
