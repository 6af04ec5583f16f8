"""The edges of a step as moving spheres, and what rounding adds to where they are."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.vectors import add, dot, row, scale, subtract
from mdtopo.geometry.windows import HALF, MOTION, WIDE, fill_window, fresh_window, measure_edges, write_row

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PLACING_ERROR = 64.0 * UNIT_ROUNDOFF
"""Rounding of what is not a stored coordinate (a midpoint, a half edge, a vertex placed in the cell or at an image), as
a multiple of the greatest coordinate and cell vector that entered. A midpoint is off by u·√3 of the coordinate, an
image by 8u of each lattice vector, reduced ones included; ρ, which adds four of each, by less than 48u."""

LEAST_SLACK = 1e-140
"""Å. Added to that rounding: squares of lengths below 1e-160 Å underflow, and a radius or a motion came out as 0."""


class Spheres(NamedTuple):
    """The edges of a step as moving spheres.

    Attributes
    ----------
    half, motion : ndarray, shape (m,)
        Greatest half length, and greatest motion of an end, Å.
    """

    half: FloatArray
    motion: FloatArray


@njit(cache=True, nogil=True)
def spheres_of(motion: StepMotion, edges: IntArray) -> Spheres:
    """Return the bounding spheres of the edges, moving linearly; proven for all times, as lengths are convex in t."""
    m, x0, x1, window, first = len(edges), motion.x0, motion.x1, fresh_window(), 0
    half, moved = np.empty(m + WIDE), np.empty(m + WIDE)
    while first < m:
        count = fill_window(window, x0, x1, edges, first)
        measure_edges(window)
        write_row(window, HALF, half, first)
        write_row(window, MOTION, moved, first)
        first += count
    return Spheres(half[:m], moved[:m])


@njit(cache=True, nogil=True)
def midpoints(x: FloatArray, edges: IntArray) -> FloatArray:
    """Return the midpoint of each edge, shape (m, 3), Å."""
    middle = np.empty((len(edges), 3))
    for k in range(len(edges)):
        middle[k, 0], middle[k, 1], middle[k, 2] = scale(0.5, add(row(x, edges[k, 0]), row(x, edges[k, 1])))
    return middle


@njit(cache=True, nogil=True)
def greatest_displacement(x0: FloatArray, x1: FloatArray) -> tuple[float, int]:
    """Return how far the vertex that moves most moves, Å, and which one it is."""
    best, vertex = -1.0, 0
    for i in range(len(x0)):
        d = subtract(row(x1, i), row(x0, i))
        squared = dot(d, d)
        if squared > best:
            best, vertex = squared, i
    return np.sqrt(best), vertex


@njit(cache=True, nogil=True)
def mean_edge_length(spheres: Spheres) -> float:
    """Return the mean length of the edges, each at the end of the step where it is longer, Å."""
    total = 0.0
    for half in spheres.half:
        total += 2.0 * half
    return total / max(len(spheres.half), 1)


@njit(cache=True, nogil=True)
def greatest_coordinate(motion: StepMotion) -> float:
    """Return the greatest coordinate that placing an image can meet, Å."""
    x0, x1, cells = motion.x0, motion.x1, 0.0
    start, end = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # by axis: six maxima that do not wait for each other
    for i in range(len(x0)):
        start = (max(start[0], abs(x0[i, 0])), max(start[1], abs(x0[i, 1])), max(start[2], abs(x0[i, 2])))
        end = (max(end[0], abs(x1[i, 0])), max(end[1], abs(x1[i, 1])), max(end[2], abs(x1[i, 2])))
    greatest = max(max(start[0], start[1], start[2]), max(end[0], end[1], end[2]))
    for k in range(3):
        for axis in range(3):
            cells += abs(motion.cell0[k, axis]) + abs(motion.cell1[k, axis])
    return greatest + cells
