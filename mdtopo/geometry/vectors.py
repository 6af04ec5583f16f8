"""Arithmetic of points held as tuples (x, y, z), inlined by the compiler."""

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

Vector: TypeAlias = tuple[float, float, float]


@njit(cache=True, nogil=True)
def row(x: NDArray[np.float64], i: int) -> Vector:
    """Return row i of an array of shape (n, 3)."""
    return x[i, 0], x[i, 1], x[i, 2]


@njit(cache=True, nogil=True)
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True, nogil=True)
def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, nogil=True)
def scale(factor: float, a: Vector) -> Vector:
    """Return factor · a."""
    return factor * a[0], factor * a[1], factor * a[2]


@njit(cache=True, nogil=True)
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True)
def norm(a: Vector) -> float:
    """Return the Euclidean length."""
    return np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@njit(cache=True, nogil=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True, forceinline=True)
def extent(a: Vector) -> float:
    """Return |x| + |y| + |z|: never less than the length, and without a root."""
    return abs(a[0]) + abs(a[1]) + abs(a[2])


@njit(cache=True, nogil=True, forceinline=True)
def quotient(a: float, b: float) -> float:
    """Return a/b as IEEE 754 has it, NaN and infinities included.

    Python's own division must raise where b is 0; a loop that may stop there is not run for several pairs at a time.
    """
    return np.divide(a, b)
