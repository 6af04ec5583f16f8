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
    before, after = group_centroids(x0, vertices, offsets), group_centroids(x1, vertices, offsets)
    return covariance_about(before, after, x0, x1, vertices, offsets)


@njit(cache=True, nogil=True)
def group_centroids(
    x: NDArray[np.float64], vertices: NDArray[np.int64], offsets: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the centroid of each group, shape (n_groups, 3); see `covariance`."""
    found = np.empty((len(offsets) - 1, 3))
    for group in range(len(found)):
        start, stop = offsets[group], offsets[group + 1]
        a, b, c = 0.0, 0.0, 0.0
        for i in vertices[start:stop]:
            a, b, c = a + x[i, 0], b + x[i, 1], c + x[i, 2]
        n = float(stop - start)
        found[group, 0], found[group, 1], found[group, 2] = a / n, b / n, c / n
    return found


@njit(cache=True, nogil=True)
def covariance_about(
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    x0: NDArray[np.float64],
    x1: NDArray[np.float64],
    vertices: NDArray[np.int64],
    offsets: NDArray[np.int64],
) -> tuple[NDArray[np.float64], float]:
    """Return what `covariance` does, where the centroids of x0 and x1 are known, shape (n_groups, 3)."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x_size, y_size, z_size = 0.0, 0.0, 0.0  # each sum on its own, so that none waits for another
    for group in range(len(offsets) - 1):
        p, q, r = before[group, 0], before[group, 1], before[group, 2]
        u, v, w = after[group, 0], after[group, 1], after[group, 2]
        for i in vertices[offsets[group] : offsets[group + 1]]:
            a, b, c = x1[i, 0] - u, x1[i, 1] - v, x1[i, 2] - w
            d, e, f = x0[i, 0] - p, x0[i, 1] - q, x0[i, 2] - r
            xx, xy, xz = xx + a * d, xy + a * e, xz + a * f
            yx, yy, yz = yx + b * d, yy + b * e, yz + b * f
            zx, zy, zz = zx + c * d, zy + c * e, zz + c * f
            x_size, y_size, z_size = x_size + (a * a + d * d), y_size + (b * b + e * e), z_size + (c * c + f * f)
    return np.array([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]), x_size + y_size + z_size


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
