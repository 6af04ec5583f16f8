"""Bezier curves of any degree: points, subdivision, hodograph, derivatives, elevation, curvature.

A curve of degree n has control points P_0 … P_n, an array of shape (n + 1, dim), and the points
B(u) = Σ C(n, i) u^i (1-u)^(n-i) P_i. All is done by de Casteljau's algorithm, whose every sum is a convex combination.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STANDSTILL = 1e-280
"""A squared velocity below this has lost digits to underflow, or soon would: the curve stands still there."""


@njit(cache=True, nogil=True)
def split(points: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
    """Return the control points of the two parts of a curve, over [0, u] and over [u, 1]; each of shape (n + 1, dim).

    The last point of the first is the first point of the second, bit for bit.
    """
    n = len(points) - 1
    left, right = np.empty_like(points), points.copy()
    for k in range(n + 1):
        left[k] = right[0]
        for i in range(n - k):
            for axis in range(points.shape[1]):
                right[i, axis] = (1.0 - u) * right[i, axis] + u * right[i + 1, axis]
    return left, right


@njit(cache=True, nogil=True)
def halve(points: FloatArray, left: FloatArray, right: FloatArray) -> None:
    """Write the control points of the two halves of a curve, which may be one of the outputs itself (`right`).

    Each average is rounded once, so a point of either half is off by at most n·u times the greatest coordinate.
    """
    n = len(points) - 1
    for axis in range(points.shape[1]):
        for i in range(n + 1):
            right[i, axis] = points[i, axis]
        for k in range(n + 1):
            left[k, axis] = right[0, axis]
            for i in range(n - k):
                right[i, axis] = 0.5 * (right[i, axis] + right[i + 1, axis])


@njit(cache=True, nogil=True)
def part(points: FloatArray, low: float, high: float) -> FloatArray:
    """Return the control points of the part of a curve over [low, high], shape (n + 1, dim); high > 0."""
    first, _ = split(points, high)
    _, second = split(first, low / high)
    return second


@njit(cache=True, nogil=True)
def evaluate(points: FloatArray, u: FloatArray) -> FloatArray:
    """Return the points of a curve at parameters u, shape (len(u), dim).

    Examples
    --------
    >>> evaluate(np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]]), np.array([0.0, 0.5])).tolist()
    [[0.0, 0.0], [1.0, 1.0]]
    """
    found = np.empty((len(u), points.shape[1]))
    row = np.empty(len(points))
    for k in range(len(u)):
        for axis in range(points.shape[1]):
            row[:] = points[:, axis]
            for stop in range(len(points) - 1, 0, -1):
                for i in range(stop):
                    row[i] = (1.0 - u[k]) * row[i] + u[k] * row[i + 1]
            found[k, axis] = row[0]
    return found


@njit(cache=True, nogil=True)
def hodograph(points: FloatArray) -> FloatArray:
    """Return the differences of consecutive control points, shape (n, dim): the hodograph of the paper, section 3."""
    found = np.empty((len(points) - 1, points.shape[1]))
    for i in range(len(found)):
        for axis in range(points.shape[1]):
            found[i, axis] = points[i + 1, axis] - points[i, axis]
    return found


@njit(cache=True, nogil=True)
def derivative(points: FloatArray) -> FloatArray:
    """Return the control points of the derivative, of degree n - 1: n times the hodograph; 0 for a single point."""
    if len(points) == 1:
        return np.zeros_like(points)
    return (len(points) - 1) * hodograph(points)


@njit(cache=True, nogil=True)
def elevate(points: FloatArray, degree: int) -> FloatArray:
    """Return the same curve by more control points, shape (degree + 1, dim); `degree` is at least its own."""
    found = points.copy()
    while len(found) <= degree:
        n = len(found)
        higher = np.empty((n + 1, points.shape[1]))
        higher[0], higher[n] = found[0], found[n - 1]
        for i in range(1, n):
            share = i / n
            for axis in range(points.shape[1]):
                higher[i, axis] = share * found[i - 1, axis] + (1.0 - share) * found[i, axis]
        found = higher
    return found


@njit(cache=True, nogil=True)
def curvature(points: FloatArray, u: FloatArray) -> FloatArray:
    """Return the curvature |B' x B''|/|B'|³ of a curve in space at parameters u, 1/Å, shape (len(u),).

    Parameters
    ----------
    points : ndarray, shape (n + 1, 3)
        Control points, Å.
    u : ndarray
        Parameters; where the curve stands still (a cusp) the curvature is infinite.
    """
    first = derivative(points)
    velocity, bend = evaluate(first, u), evaluate(derivative(first), u)
    found = np.empty(len(u))
    for k in range(len(u)):
        a, b = velocity[k], bend[k]
        x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        squared = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
        found[k] = np.sqrt(x * x + y * y + z * z) / squared**1.5 if squared > STANDSTILL else np.inf
    return found
