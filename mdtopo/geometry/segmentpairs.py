"""Which segments of a moving curve may meet each other, or themselves? Those that chords do not tell apart.

A segment stays in the box of its control points, and within `away` of its chord: the greatest distance of a control
point from the matching point of the chord, at either end of the step. Nearly all segments and pairs of a curve are
settled by that; what is left is listed, for `mdtopo.geometry.subdivision` to settle.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import candidate_pairs, images_can_meet
from mdtopo.geometry.bundles import near_boxes
from mdtopo.geometry.distances import LEAST_SQUARE, UNIT_ROUNDOFF
from mdtopo.geometry.lattice import basis_of, lattice_vector
from mdtopo.geometry.segmenthulls import JOINT, PAIR, SELF
from mdtopo.geometry.vectors import Vector, add, dot, norm, row, subtract

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NEARLY_STANDSTILL = 1e-100
"""A direction shorter than this, Å, tells nothing."""


class Shapes(NamedTuple):
    """Where the segments of a curve are during a step: all in Å, one row for each segment.

    Attributes
    ----------
    mid0, mid1, half0, half1 : ndarray, shape (m, 3)
        Midpoints of the chords, and half the chords, at both ends.
    away, radii : ndarray, shape (m,)
        How far a segment strays from its chord, and from the midpoint of it.
    boxes : ndarray, shape (m, 6)
        Least x, y, z and greatest x, y, z that a control point has.
    """

    mid0: FloatArray
    mid1: FloatArray
    half0: FloatArray
    half1: FloatArray
    away: FloatArray
    radii: FloatArray
    boxes: FloatArray


@njit(cache=True, nogil=True)
def shapes_of(c0: FloatArray, c1: FloatArray) -> Shapes:
    """Return the shapes of segments whose control points move from c0 to c1, shape (m, n + 1, 3) each."""
    m = len(c0)
    shapes = Shapes(
        np.empty((m, 3)),
        np.empty((m, 3)),
        np.empty((m, 3)),
        np.empty((m, 3)),
        np.zeros(m),
        np.zeros(m),
        np.empty((m, 6)),
    )
    for k in range(m):
        for axis in range(3):
            shapes.boxes[k, axis], shapes.boxes[k, axis + 3] = np.inf, -np.inf
    _take_in(c0, shapes.mid0, shapes.half0, shapes)
    _take_in(c1, shapes.mid1, shapes.half1, shapes)
    for k in range(m):
        shapes.away[k], shapes.radii[k] = np.sqrt(shapes.away[k]), np.sqrt(shapes.radii[k])
    return shapes


@njit(cache=True, nogil=True)
def _take_in(c: FloatArray, mid: FloatArray, half: FloatArray, shapes: Shapes) -> None:
    """Write chords at one end of the step, and widen boxes and squared distances to what is found there."""
    n = c.shape[1] - 1
    for k in range(len(c)):
        for axis in range(3):
            first, last = c[k, 0, axis], c[k, n, axis]
            mid[k, axis], half[k, axis] = 0.5 * (first + last), 0.5 * (last - first)
        for i in range(n + 1):
            from_mid, from_chord, share = 0.0, 0.0, 2.0 * i / n - 1.0
            for axis in range(3):
                value = c[k, i, axis]
                shapes.boxes[k, axis] = min(shapes.boxes[k, axis], value)
                shapes.boxes[k, axis + 3] = max(shapes.boxes[k, axis + 3], value)
                here = value - mid[k, axis]
                there = here - share * half[k, axis]
                from_mid, from_chord = from_mid + here * here, from_chord + there * there
            shapes.radii[k] = max(shapes.radii[k], from_mid)
            shapes.away[k] = max(shapes.away[k], from_chord)


@njit(cache=True, nogil=True)
def lone_checks(c0: FloatArray, c1: FloatArray, following: IntArray, greatest: float, slack: float) -> IntArray:
    """Return what hulls have to check along the strands: segments (S1), joints (S2), and pairs with one between.

    Returns
    -------
    checks : ndarray of int, shape (k, 6)
        Rows (kind, segment, segment, image): all pairs with one segment between, but only those segments and joints
        that do not run along their chords all the time.
    """
    m, count = c0.shape[0], 0
    checks = np.zeros((3 * m, 6), dtype=np.int64)
    error = 2.0 * slack + 64.0 * UNIT_ROUNDOFF * greatest
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
        after = following[after]
        if after < 0 or following[after] == k or (following[following[after]] == k and after < k):
            continue  # a ring of three has no such pair, and one of four has each of them twice
        checks[count, 0], checks[count, 1], checks[count, 2] = PAIR, k, after
        count += 1
    return checks[:count]


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
    shapes: Shapes,
    following: IntArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
    reach: float,
    rounding: float,
) -> tuple[IntArray, bool]:
    """Return the pairs of segments (S3) that chords do not prove to stay further apart than `reach`, Å.

    Parameters
    ----------
    shapes : Shapes
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
    is_complete : bool
        False where periodic images could not be counted.
    """
    pairs, images, is_complete = _pairs_in_reach(shapes, following, cell0, cell1, periodic, 0.5 * reach + rounding)
    basis0, basis1 = basis_of(cell0), basis_of(cell1)
    shift0, shift1, image = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0, 0, 0)
    checks, count = np.empty((len(pairs), 6), dtype=np.int64), 0
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
        centre0 = add(subtract(row(shapes.mid0, j), row(shapes.mid0, i)), shift0)
        centre1 = add(subtract(row(shapes.mid1, j), row(shapes.mid1, i)), shift1)
        w = add(centre0, centre1)
        length = norm(w)
        start = dot(w, centre0) - abs(dot(w, row(shapes.half0, i))) - abs(dot(w, row(shapes.half0, j)))
        finish = dot(w, centre1) - abs(dot(w, row(shapes.half1, i))) - abs(dot(w, row(shapes.half1, j)))
        # of the slabs that hold the chords, less how far the segments may stray from these
        need = shapes.away[i] + shapes.away[j] + 4.0 * rounding + reach
        if min(start, finish) > length * need * (1.0 + 1e-12) and length > NEARLY_STANDSTILL:
            continue
        checks[count, 0], checks[count, 1], checks[count, 2] = PAIR, i, j
        checks[count, 3], checks[count, 4], checks[count, 5] = image
        count += 1
    return checks[:count], is_complete


@njit(cache=True, nogil=True, inline="always")
def _pairs_in_reach(
    shapes: Shapes, following: IntArray, cell0: FloatArray, cell1: FloatArray, periodic: bool, pad: float
) -> tuple[IntArray, IntArray, bool]:
    """Return the pairs whose padded boxes, or spheres where images can meet, meet; and whether all were found."""
    if periodic:
        radii = shapes.radii + pad
        if images_can_meet(shapes.mid0, shapes.mid1, radii, basis_of(cell0), basis_of(cell1)):
            return candidate_pairs(shapes.mid0, shapes.mid1, radii, cell0, cell1, periodic)
    m = len(following)
    trace, boxes = np.zeros(m, dtype=np.int64), np.empty((m, 6))
    for k in range(m):
        if k > 0:
            trace[k] = trace[k - 1] if following[k - 1] == k else trace[k - 1] + 1
        for axis in range(3):
            boxes[k, axis], boxes[k, axis + 3] = shapes.boxes[k, axis] - pad, shapes.boxes[k, axis + 3] + pad
    return near_boxes(boxes, trace), np.empty((0, 3), dtype=np.int64), True


@njit(cache=True, nogil=True)
def _is_near_along_strand(i: int, j: int, following: IntArray) -> bool:
    """Return whether two segments are the same one, or have at most one segment between them."""
    for one, other in ((i, j), (j, i)):
        after = following[one]
        if one == other or after == other or (after >= 0 and following[after] == other):
            return True
    return False


@njit(cache=True, nogil=True)
def separation_along(
    c0: FloatArray, c1: FloatArray, i: int, j: int, shift0: Vector, shift1: Vector, w: Vector, rounding: float
) -> float:
    """Return how far segments i and j (shifted) stay apart along w, a proven lower bound of their distance, Å.

    It proves nothing unless positive.
    """
    size = norm(w)
    if not size > NEARLY_STANDSTILL:
        return 0.0
    apart = min(_slab_between(c0, i, j, w) + dot(w, shift0), _slab_between(c1, i, j, w) + dot(w, shift1))
    return apart / size - 4.0 * rounding


@njit(cache=True, nogil=True)
def _slab_between(c: FloatArray, i: int, j: int, w: Vector) -> float:
    low, high = np.inf, -np.inf
    for k in range(c.shape[1]):
        high = max(high, w[0] * c[i, k, 0] + w[1] * c[i, k, 1] + w[2] * c[i, k, 2])
        low = min(low, w[0] * c[j, k, 0] + w[1] * c[j, k, 1] + w[2] * c[j, k, 2])
    return low - high
