"""Where is a segment of a moving curve, and how far from another at least? Boxes, chords, and slabs across a direction.

A segment stays in the box of its control points, and within `AWAY` of its chord: the greatest distance of a control
point from the matching point of the chord, at either end of the step. Its shape is a row of numbers, because what is
known of two segments is asked of many pairs, and a row is what is quickest at hand.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.distances import closest_points
from mdtopo.geometry.pairs import slab_bound
from mdtopo.geometry.vectors import Vector, add, dot, norm, scale, subtract

FloatArray = NDArray[np.float64]

MID0, MID1, HALF0, HALF1, AWAY, RADIUS, SHAPE_WIDTH = 0, 3, 6, 9, 12, 13, 14
"""Columns of a shape: midpoint and half of the chord at the start and at the end of the step; how far the segment
strays from its chord at most, and from the midpoint of that; all in Å."""

NEARLY_STANDSTILL = 1e-100
"""A direction shorter than this, Å, tells nothing."""


@njit(cache=True, nogil=True)
def shapes_of(c0: FloatArray, c1: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return shapes and boxes of segments whose control points move from c0 to c1, shape (m, n + 1, 3) each.

    Returns
    -------
    shapes : ndarray, shape (m, 14)
    boxes : ndarray, shape (m, 6)
        Least x, y, z and greatest x, y, z that a control point has, Å.
    """
    m = len(c0)
    shapes, boxes = np.zeros((m, SHAPE_WIDTH)), np.empty((m, 6))
    for k in range(m):
        for axis in range(3):
            boxes[k, axis], boxes[k, axis + 3] = np.inf, -np.inf
    _take_in(c0, MID0, HALF0, shapes, boxes)
    _take_in(c1, MID1, HALF1, shapes, boxes)
    for k in range(m):
        shapes[k, AWAY], shapes[k, RADIUS] = np.sqrt(shapes[k, AWAY]), np.sqrt(shapes[k, RADIUS])
    return shapes, boxes


@njit(cache=True, nogil=True)
def _take_in(c: FloatArray, mid: int, half: int, shapes: FloatArray, boxes: FloatArray) -> None:
    """Write chords at one end of the step, and widen boxes and squared distances to what is found there."""
    n = c.shape[1] - 1
    shares = np.empty(n + 1)  # of the way along the chord, from -1 to 1
    for i in range(n + 1):
        shares[i] = 2.0 * i / n - 1.0
    for k in range(len(c)):
        first, last = (c[k, 0, 0], c[k, 0, 1], c[k, 0, 2]), (c[k, n, 0], c[k, n, 1], c[k, n, 2])
        middle, along = scale(0.5, add(first, last)), scale(0.5, subtract(last, first))
        low, high = (boxes[k, 0], boxes[k, 1], boxes[k, 2]), (boxes[k, 3], boxes[k, 4], boxes[k, 5])
        radius, away = shapes[k, RADIUS], shapes[k, AWAY]
        for i in range(n + 1):
            point = (c[k, i, 0], c[k, i, 1], c[k, i, 2])
            low = (min(low[0], point[0]), min(low[1], point[1]), min(low[2], point[2]))
            high = (max(high[0], point[0]), max(high[1], point[1]), max(high[2], point[2]))
            here = subtract(point, middle)
            there = subtract(here, scale(shares[i], along))
            radius, away = max(radius, dot(here, here)), max(away, dot(there, there))
        shapes[k, mid], shapes[k, mid + 1], shapes[k, mid + 2] = middle
        shapes[k, half], shapes[k, half + 1], shapes[k, half + 2] = along
        boxes[k, 0], boxes[k, 1], boxes[k, 2] = low
        boxes[k, 3], boxes[k, 4], boxes[k, 5] = high
        shapes[k, RADIUS], shapes[k, AWAY] = radius, away


@njit(cache=True, nogil=True)
def vector_of(shapes: FloatArray, k: int, column: int) -> Vector:
    """Return the vector that begins at a column of a shape."""
    return shapes[k, column], shapes[k, column + 1], shapes[k, column + 2]


@njit(cache=True, nogil=True)
def mean_chord(shapes: FloatArray) -> float:
    """Return the mean length of the chords at the start, Å."""
    total = 0.0
    for k in range(len(shapes)):
        total += norm(vector_of(shapes, k, HALF0))
    return 2.0 * total / max(len(shapes), 1)


@njit(cache=True, nogil=True, inline="always")
def chord_separation(
    shapes: FloatArray, i: int, j: int, shift0: Vector, shift1: Vector, rounding: float
) -> tuple[float, Vector]:
    """Return how far segments i and j (shifted) stay apart along the line of their midpoints, Å, and its direction.

    It is how far the slabs are apart that hold the chords, less how far the segments stray from these: a proven lower
    bound of their distance at every time, which tells nothing unless positive.
    """
    centre0 = add(subtract(vector_of(shapes, j, MID0), vector_of(shapes, i, MID0)), shift0)
    centre1 = add(subtract(vector_of(shapes, j, MID1), vector_of(shapes, i, MID1)), shift1)
    w = add(centre0, centre1)
    size = norm(w)
    if not size > NEARLY_STANDSTILL:
        return 0.0, w
    start = slab_bound(w, centre0, vector_of(shapes, i, HALF0), vector_of(shapes, j, HALF0))
    finish = slab_bound(w, centre1, vector_of(shapes, i, HALF1), vector_of(shapes, j, HALF1))
    return min(start, finish) * ((1.0 - 1e-12) / size) - shapes[i, AWAY] - shapes[j, AWAY] - 4.0 * rounding, w


@njit(cache=True, nogil=True)
def across_chords(shapes: FloatArray, i: int, j: int, shift0: Vector, shift1: Vector) -> Vector:
    """Return the direction between the closest points of two chords (the second one shifted), half way in time."""
    p = scale(0.5, add(vector_of(shapes, i, MID0), vector_of(shapes, i, MID1)))
    q = scale(0.5, add(add(vector_of(shapes, j, MID0), shift0), add(vector_of(shapes, j, MID1), shift1)))
    d = scale(0.5, add(vector_of(shapes, i, HALF0), vector_of(shapes, i, HALF1)))
    e = scale(0.5, add(vector_of(shapes, j, HALF0), vector_of(shapes, j, HALF1)))
    _, _, w = closest_points(subtract(q, e), add(q, e), subtract(p, d), add(p, d))
    return w


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


@njit(cache=True, nogil=True, inline="always")
def pair_separation(
    c0: FloatArray,
    c1: FloatArray,
    shapes: FloatArray,
    i: int,
    j: int,
    shift0: Vector,
    shift1: Vector,
    rounding: float,
    wanted: float,
) -> float:
    """Return a proven lower bound of the distance of segments i and j (shifted), Å, from one direction at a time.

    The cheapest come first, until one proves more than is wanted.
    """
    low, w = chord_separation(shapes, i, j, shift0, shift1, rounding)
    if low <= wanted:
        low = max(low, separation_along(c0, c1, i, j, shift0, shift1, w, rounding))
    if low <= wanted:
        w = across_chords(shapes, i, j, shift0, shift1)
        low = max(low, separation_along(c0, c1, i, j, shift0, shift1, w, rounding))
    return low
