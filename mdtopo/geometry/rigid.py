"""The one rotation that all strands of a step have in common."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

COLLINEAR = 1e-10
"""Second over first singular value under which a set is a line: no rotation about its axis can be told from none."""


@njit(cache=True, nogil=True)
def covariance(
    x0: NDArray[np.float64], x1: NDArray[np.float64], vertices: NDArray[np.int64], offsets: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return Σ (x1 - c1)ᵀ(x0 - c0), each group of vertices about its own centroid, shape (3, 3).

    Parameters
    ----------
    x0, x1 : ndarray, shape (n, 3)
        Positions before and after.
    vertices, offsets : ndarray of int
        Group g holds the vertices ``vertices[offsets[g]:offsets[g + 1]]``.

    Notes
    -----
    Centroids of strands, not of the whole, because in a periodic box the image in which a strand was written is
    arbitrary: the sum does not depend on it.
    """
    total = np.zeros((3, 3))
    for group in range(len(offsets) - 1):
        start, stop = offsets[group], offsets[group + 1]
        c0, c1 = np.zeros(3), np.zeros(3)
        for i in vertices[start:stop]:
            for k in range(3):
                c0[k] += x0[i, k]
                c1[k] += x1[i, k]
        c0 /= stop - start
        c1 /= stop - start
        for i in vertices[start:stop]:
            for k in range(3):
                a = x1[i, k] - c1[k]
                for m in range(3):
                    total[k, m] += a * (x0[i, m] - c0[m])
    return total


@njit(cache=True, nogil=True)
def best_rotation(correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the proper rotation that brings x1 closest to x0 (Kabsch 1976, 1978), det = +1.

    Parameters
    ----------
    correlation : ndarray, shape (3, 3)
        Σ (x1 - c1)ᵀ(x0 - c0).

    Returns
    -------
    rotation : ndarray, shape (3, 3)
        To be applied as ``rotation @ x``. The least rotation that does it where the points lie on a line; the
        identity where there is nothing to align.
    """
    u, sizes, vt = np.linalg.svd(correlation)
    if sizes[0] == 0.0:
        return np.eye(3)
    if sizes[1] <= COLLINEAR * sizes[0]:
        return _turn(u[:, 0].copy(), vt[0].copy())
    v = vt.T.copy()
    if np.linalg.det(u) * np.linalg.det(v) < 0.0:
        v[:, 2] = -v[:, 2]
    return v @ u.T.copy()


@njit(cache=True, nogil=True)
def _turn(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least rotation that takes the unit vector a to b (Rodrigues)."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if cosine < -1.0 + 1e-14:  # opposite: a half turn about any axis at right angles to a
        axis = np.zeros(3)
        axis[np.argmin(np.abs(a))] = 1.0
        axis -= a * (axis[0] * a[0] + axis[1] * a[1] + axis[2] * a[2])
        axis /= np.sqrt((axis * axis).sum())
        return 2.0 * np.outer(axis, axis) - np.eye(3)
    k = np.zeros((3, 3))
    k[0, 1], k[0, 2] = b[0] * a[1] - a[0] * b[1], b[0] * a[2] - a[0] * b[2]
    k[1, 2] = b[1] * a[2] - a[1] * b[2]
    k[1, 0], k[2, 0], k[2, 1] = -k[0, 1], -k[0, 2], -k[1, 2]
    return np.eye(3) + k + k @ k / (1.0 + cosine)


@njit(cache=True, nogil=True)
def rotation_angle(rotation: NDArray[np.float64]) -> float:
    """Return the angle of a rotation, in degrees, from 0 to 180."""
    x = rotation[2, 1] - rotation[1, 2]
    y = rotation[0, 2] - rotation[2, 0]
    z = rotation[1, 0] - rotation[0, 1]
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    return np.degrees(np.arctan2(np.sqrt(x * x + y * y + z * z), trace - 1.0))
