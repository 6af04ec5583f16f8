"""The edges of a step as moving spheres, and what rounding adds to where they are."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.vectors import Vector, add, dot, row, scale, subtract

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
    mid0, mid1 : ndarray, shape (m, 3)
        Midpoints at both ends of the step, Å.
    half, motion : ndarray, shape (m,)
        Greatest half length, and greatest motion of an end, Å.
    rows : ndarray, shape (m, 14)
        Midpoints and half edges at both ends, greatest half length and motion, once more: whoever looks at pairs of
        edges finds all of one edge in two places in memory instead of ten.
    """

    mid0: FloatArray
    mid1: FloatArray
    half: FloatArray
    motion: FloatArray
    rows: FloatArray


MID0, MID1, SPAN0, SPAN1, HALF, MOTION = 0, 3, 6, 9, 12, 13
"""Where in a row of `Spheres.rows` its parts begin."""


@njit(cache=True, nogil=True)
def spheres_of(motion: StepMotion, edges: IntArray) -> Spheres:
    """Return the bounding spheres of the edges, moving linearly; proven for all times, as lengths are convex in t."""
    m, x0, x1 = len(edges), motion.x0, motion.x1
    mid0, mid1, half, moved = np.empty((m, 3)), np.empty((m, 3)), np.empty(m), np.empty(m)
    rows = np.empty((m, 14))
    for k in range(m):
        a, b = edges[k, 0], edges[k, 1]
        a0, b0, a1, b1 = row(x0, a), row(x0, b), row(x1, a), row(x1, b)
        first, second = scale(0.5, subtract(b0, a0)), scale(0.5, subtract(b1, a1))
        from_a, from_b = subtract(a1, a0), subtract(b1, b0)
        mid0[k, 0], mid0[k, 1], mid0[k, 2] = scale(0.5, add(a0, b0))
        mid1[k, 0], mid1[k, 1], mid1[k, 2] = scale(0.5, add(a1, b1))
        half[k] = np.sqrt(max(dot(first, first), dot(second, second)))
        moved[k] = np.sqrt(max(dot(from_a, from_a), dot(from_b, from_b)))
        for axis in range(3):
            rows[k, MID0 + axis], rows[k, MID1 + axis] = mid0[k, axis], mid1[k, axis]
        rows[k, SPAN0], rows[k, SPAN0 + 1], rows[k, SPAN0 + 2] = first
        rows[k, SPAN1], rows[k, SPAN1 + 1], rows[k, SPAN1 + 2] = second
        rows[k, HALF], rows[k, MOTION] = half[k], moved[k]
    return Spheres(mid0, mid1, half, moved, rows)


@njit(cache=True, nogil=True)
def part_of(rows: FloatArray, k: int, start: int) -> Vector:
    """Return three numbers of a row of `Spheres.rows`: one of its vectors."""
    return rows[k, start], rows[k, start + 1], rows[k, start + 2]


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
    greatest, cells = 0.0, 0.0
    for i in range(len(motion.x0)):
        for axis in range(3):
            greatest = max(greatest, abs(motion.x0[i, axis]), abs(motion.x1[i, axis]))
    for k in range(3):
        for axis in range(3):
            cells += abs(motion.cell0[k, axis]) + abs(motion.cell1[k, axis])
    return greatest + cells
