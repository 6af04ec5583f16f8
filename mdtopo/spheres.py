"""The edges of a step as moving spheres, and what rounding adds to where they are."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.vectors import add, dot, norm, row, scale, subtract

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PLACING_ERROR = 64.0 * UNIT_ROUNDOFF
"""Rounding of what is not a stored coordinate (a midpoint, a half edge, a vertex placed in the cell or at an image), as
a multiple of the greatest coordinate and cell vector that entered. A midpoint is off by u·√3 of the coordinate, an
image by 8u of each lattice vector, reduced ones included; ρ, which adds four of each, by less than 48u."""

LEAST_SLACK = 1e-140
"""Å. Added to that rounding: squares of lengths below 1e-160 Å underflow, and a radius or a motion came out as 0."""


class Spheres(NamedTuple):
    """The edges of a step as moving spheres: midpoints and half edges at both ends, greatest half length and motion."""

    mid0: FloatArray
    mid1: FloatArray
    span0: FloatArray
    span1: FloatArray
    half: FloatArray
    motion: FloatArray


@njit(cache=True, nogil=True)
def spheres_of(motion: StepMotion, edges: IntArray) -> Spheres:
    """Return the bounding spheres of the edges, moving linearly; proven for all times, as lengths are convex in t."""
    m = len(edges)
    mid0, mid1, half, moved = np.empty((m, 3)), np.empty((m, 3)), np.empty(m), np.empty(m)
    span0, span1 = np.empty((m, 3)), np.empty((m, 3))
    for k in range(m):
        a0, b0 = row(motion.x0, edges[k, 0]), row(motion.x0, edges[k, 1])
        a1, b1 = row(motion.x1, edges[k, 0]), row(motion.x1, edges[k, 1])
        mid0[k, 0], mid0[k, 1], mid0[k, 2] = scale(0.5, add(a0, b0))
        mid1[k, 0], mid1[k, 1], mid1[k, 2] = scale(0.5, add(a1, b1))
        span0[k, 0], span0[k, 1], span0[k, 2] = scale(0.5, subtract(b0, a0))
        span1[k, 0], span1[k, 1], span1[k, 2] = scale(0.5, subtract(b1, a1))
        half[k] = max(norm(row(span0, k)), norm(row(span1, k)))
        moved[k] = max(norm(subtract(a1, a0)), norm(subtract(b1, b0)))
    return Spheres(mid0, mid1, span0, span1, half, moved)


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
