"""Pieces of strands laid out side by side, so that the compiler works on eight edges at a time.

The ends of consecutive edges are consecutive vertices. Their coordinates are laid out once, all x in a row, then all y,
then all z, at the start of the step and at its end; what is found of the edges lies behind them in the same piece of
memory. `mdtopo.geometry.pairlanes` says why so.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.vectors import Vector, dot, scale, subtract

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDE = 64
"""Edges of a piece at most."""

STRIDE = WIDE + 8
"""Room for a row of numbers: a piece has one vertex more than edges, or three more than pairs of next neighbours."""

COORDINATES = 6
"""Rows that are filled in: x, y, z at the start of the step, and at its end."""

HALF, MOTION = 6, 7
"""Rows that `measure_edges` writes."""

LOW, HIGH = 8, 11
"""Rows that `bound_edges` writes, three each."""

N_ROWS = 14

ONE = np.uint64(1)


@njit(cache=True, nogil=True)
def fresh_window() -> FloatArray:
    """Return room for one piece."""
    return np.zeros(N_ROWS * STRIDE)


@njit(cache=True, nogil=True, forceinline=True)
def put_vertex(window: FloatArray, k: int, x0: FloatArray, x1: FloatArray, vertex: int) -> None:
    """Write the coordinates of a vertex into place k."""
    at, v = np.uint64(k), np.uint64(vertex)  # of a signed index the compiler would ask whether it counts from the end
    for axis in range(3):
        window[np.uint64(axis * STRIDE) + at] = x0[v, axis]
        window[np.uint64((axis + 3) * STRIDE) + at] = x1[v, axis]


@njit(cache=True, nogil=True, forceinline=True)
def fill_window(window: FloatArray, x0: FloatArray, x1: FloatArray, edges: IntArray, first: int) -> int:
    """Lay out the edges from `first` on that follow each other, `WIDE` at most, and return how many they are."""
    count = 0
    while True:
        edge = np.uint64(first + count)
        put_vertex(window, count, x0, x1, edges[edge, 0])
        count += 1
        is_last = count == WIDE or first + count == len(edges)
        if is_last or edges[edge + ONE, 0] != edges[edge, 1]:
            put_vertex(window, count, x0, x1, edges[edge, 1])
            return count


@njit(cache=True, nogil=True, forceinline=True)
def vertex_at(window: FloatArray, row: int, k: int) -> Vector:
    """Return one vertex of a window, at the start of the step (row 0) or at its end (row 3)."""
    return window[row * STRIDE + k], window[(row + 1) * STRIDE + k], window[(row + 2) * STRIDE + k]


@njit(cache=True, nogil=True, forceinline=True)
def write_row(window: FloatArray, row: int, out: FloatArray, first: int) -> None:
    """Write a row to an array from place `first` on: `WIDE` numbers, the last ones without meaning in a short piece."""
    for k in range(WIDE):
        out[np.uint64(first) + np.uint64(k)] = window[row * STRIDE + k]


@njit(cache=True, nogil=True)
def measure_edges(window: FloatArray) -> None:
    """Write the greater half length of each edge at the two ends of the step, and the greater motion of its ends, Å."""
    for k in range(WIDE):
        a0, b0, a1, b1 = ends_at(window, k)
        first, second = scale(0.5, subtract(b0, a0)), scale(0.5, subtract(b1, a1))
        from_a, from_b = subtract(a1, a0), subtract(b1, b0)
        window[HALF * STRIDE + k] = np.sqrt(max(dot(first, first), dot(second, second)))
        window[MOTION * STRIDE + k] = np.sqrt(max(dot(from_a, from_a), dot(from_b, from_b)))


@njit(cache=True, nogil=True)
def bound_edges(window: FloatArray) -> None:
    """Write the box that each edge stays in: its least and its greatest x, y, z at the two ends of the step."""
    for k in range(WIDE):
        a0, b0, a1, b1 = ends_at(window, k)
        for axis in range(3):
            low, high = min(a0[axis], b0[axis]), max(a0[axis], b0[axis])
            window[(LOW + axis) * STRIDE + k] = min(low, min(a1[axis], b1[axis]))
            window[(HIGH + axis) * STRIDE + k] = max(high, max(a1[axis], b1[axis]))


@njit(cache=True, nogil=True, forceinline=True)
def ends_at(window: FloatArray, k: int) -> tuple[Vector, Vector, Vector, Vector]:
    """Return both ends of an edge, at the start of the step and at its end."""
    return vertex_at(window, 0, k), vertex_at(window, 0, k + 1), vertex_at(window, 3, k), vertex_at(window, 3, k + 1)
