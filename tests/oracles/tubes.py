"""How thick a closed curve may be, by dense sampling: the circles through one point that touch the curve at another.

The radius of the tube is the least radius of such a circle (Gonzalez and Maddocks 1999, PNAS 96:4769): near the point
itself it tends to the radius of curvature, and across the curve it is half the distance where the line is normal at
both. So curvature and doubly normal pairs, which the package looks for one by one, need not be known here.
"""

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


class Samples(NamedTuple):
    """Points and unit tangents along a curve, shape (k, 3) each."""

    points: Points
    tangents: Points


def sampled(segments: Points, per_segment: int) -> Samples:
    """Return samples in the middle of equal parts of each segment, from the Bernstein polynomials."""
    n = segments.shape[1] - 1
    u = (np.arange(per_segment) + 0.5) / per_segment
    points = np.einsum("ku,mkx->mux", _bernstein(n, u), segments)
    slopes = np.einsum("ku,mkx->mux", _bernstein(n - 1, u), np.diff(segments, axis=1))
    return Samples(points.reshape(-1, 3), (slopes / np.linalg.norm(slopes, axis=2, keepdims=True)).reshape(-1, 3))


def _bernstein(n: int, u: Points) -> Points:
    return np.stack([comb(n, k) * u**k * (1 - u) ** (n - k) for k in range(n + 1)])


def thickness(segments: Points, per_segment: int) -> float:
    """Return the least radius among samples: never below the true one but for rounding, and O(1/k²) above it."""
    points, tangents = sampled(segments, per_segment)
    least = np.inf
    for x, tangent in zip(points, tangents, strict=True):
        apart = points - x
        squared = np.einsum("ij,ij->i", apart, apart)
        across = np.linalg.norm(np.cross(apart, tangent), axis=1)
        touching = across > 1e-9 * np.sqrt(squared)  # along the tangent the circle is a line
        least = min(least, float((squared[touching] / (2.0 * across[touching])).min(initial=np.inf)))
    return least


def least_distance(one: Points, other: Points, per_segment: int) -> float:
    """Return the least distance between samples of two curves."""
    a, b = sampled(one, per_segment).points, sampled(other, per_segment).points
    return min(float(np.linalg.norm(b - x, axis=1).min()) for x in a)
