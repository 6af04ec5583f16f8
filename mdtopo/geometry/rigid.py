"""The one rotation that all strands of a step have in common."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

ELONGATED = 0.1
"""Sum of the lesser singular values over the greatest one, under which a set is long and thin."""

CLEARLY = 0.2
"""A rotation is clearly better than another when its sum of squares is less than this fraction of the other's."""


@njit(cache=True, nogil=True)
def covariance(
    x0: NDArray[np.float64], x1: NDArray[np.float64], vertices: NDArray[np.int64], offsets: NDArray[np.int64]
) -> tuple[NDArray[np.float64], float]:
    """Return Σ (x1 - c1)ᵀ(x0 - c0), shape (3, 3), and Σ |x1 - c1|² + |x0 - c0|², each group about its own centroid.

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
    total, size = np.zeros((3, 3)), 0.0
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
                a, b = x1[i, k] - c1[k], x0[i, k] - c0[k]
                size += a * a + b * b
                for m in range(3):
                    total[k, m] += a * (x0[i, m] - c0[m])
    return total, size


def best_rotations(correlations: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the proper rotations that bring x1 closest to x0 (Kabsch 1976, 1978), det = +1.

    Parameters
    ----------
    correlations : ndarray, shape (k, 3, 3)
        Σ (x1 - c1)ᵀ(x0 - c0) of each step.
    sizes : ndarray, shape (k,)
        Σ |x1 - c1|² + |x0 - c0|² of each step.

    Returns
    -------
    rotations : ndarray, shape (k, 3, 3)
        To be applied as ``rotation @ x``. Each depends on its own correlation alone, bit for bit.

    Notes
    -----
    Points that lie nearly on a line do not tell how they have turned about it; the fit then takes whatever noise says,
    up to half a turn. There the least rotation that aligns the lines stands, unless the other is clearly better.
    """
    u, weights, vt = np.linalg.svd(correlations)
    sign = np.where(np.linalg.det(u) * np.linalg.det(vt) < 0.0, -1.0, 1.0)
    vt[:, 2] *= sign[:, np.newaxis]
    rotations = np.swapaxes(vt, 1, 2) @ np.swapaxes(u, 1, 2)
    for k in np.flatnonzero(weights[:, 1] + weights[:, 2] <= ELONGATED * weights[:, 0]):
        least = _least_turn(u[k, :, 0], vt[k, 0]) if weights[k, 0] > 0.0 else np.eye(3)
        if not _misfit(rotations[k], correlations[k], sizes[k]) < CLEARLY * _misfit(least, correlations[k], sizes[k]):
            rotations[k] = least
    return rotations


def _misfit(rotation: NDArray[np.float64], correlation: NDArray[np.float64], size: float) -> float:
    """Return Σ |R(x1 - c1) - (x0 - c0)|²."""
    return float(size - 2.0 * np.sum(rotation * correlation.T))


def _least_turn(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least rotation that takes the unit vector a to b (Rodrigues)."""
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-14:  # opposite: a half turn about any axis at right angles to a
        axis = np.eye(3)[np.argmin(np.abs(a))]
        axis = axis - a * (axis @ a)
        axis /= np.linalg.norm(axis)
        half_turn: NDArray[np.float64] = 2.0 * np.outer(axis, axis) - np.eye(3)
        return half_turn
    x, y, z = np.cross(a, b)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: NDArray[np.float64] = np.eye(3) + k + k @ k / (1.0 + cosine)
    return turn


def rotation_angles(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles of rotations, shape (k, 3, 3), in degrees from 0 to 180."""
    skew = rotations - np.swapaxes(rotations, 1, 2)
    sine = np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2)
    cosine = np.trace(rotations, axis1=1, axis2=2) - 1.0
    return np.degrees(np.arctan2(sine, cosine))
