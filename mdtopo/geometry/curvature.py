"""The greatest curvature of Bezier segments, between two bounds that subdivision brings together.

κ² = |c' x c''|² / |c'|⁶ is a quotient of polynomials. Written in Bernstein form of one degree, with a positive
denominator, it is at most the greatest quotient of coefficients (Farouki 2012, on rational Bezier functions), which
tends to the truth with the square of a piece's length.
"""

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mdtopo.geometry.distances import UNIT_ROUNDOFF

FloatArray = NDArray[np.float64]

DEEPEST = 48
"""Halvings of a segment: only a cusp needs more."""

MOST_PIECES = 200_000
"""Pieces of one level; where more are left their bounds stand as they are."""

FLAT = 1e-9
"""A curvature below this, over the length of the control polygon, is not told from 0."""

HIGHEST_DEGREE = 60
"""Binomial numbers of six times the degree still have their digits."""


class Curvature(NamedTuple):
    """Bounds of κ_max, 1/Å, and where the lower one was found: segment and u."""

    lower: float
    upper: float
    segment: int
    u: float


def greatest_curvature(control_points: FloatArray, tolerance: float) -> Curvature:
    """Return bounds of the greatest curvature of Bezier segments.

    Parameters
    ----------
    control_points : ndarray, shape (m, degree + 1, 3)
        Å; the degree is at most `HIGHEST_DEGREE`.
    tolerance : float
        The bounds are this close to each other, relatively, unless a cusp or the number of pieces forbids it.

    Guarantee
    ---------
    Proven, rounding included: no point of a segment has a curvature above `upper`, which is infinite where a
    segment has a cusp, or nearly. `lower` is the curvature at a point, right to rounding.
    """
    n = control_points.shape[1] - 1
    if n < 2:
        return Curvature(0.0, 0.0, 0, 0.0)
    velocity = n * np.diff(control_points, axis=1)
    bend = (n - 1) * np.diff(velocity, axis=1)
    area = _cross_product(velocity, bend)
    speeds, areas = np.linalg.norm(velocity, axis=2).max(1), np.linalg.norm(area, axis=2).max(1)
    # rounding of c' x c'': each of the products of |c'| with a difference of c', in sums of at most n terms
    speed_error, area_error = 4 * UNIT_ROUNDOFF * speeds, 32 * n * n * UNIT_ROUNDOFF * speeds**2
    lengths = np.linalg.norm(np.diff(control_points, axis=1), axis=2).sum()
    floor = FLAT / lengths if lengths > 0.0 else 0.0
    segment, start = np.arange(len(velocity)), np.zeros(len(velocity))
    lower, at, upper = 0.0, (0, 0.0), 0.0
    for depth in range(DEEPEST + 1):
        rounding = depth * 2 * n * UNIT_ROUNDOFF
        bounds = _piece_bounds(
            velocity, area, speed_error + rounding * speeds[segment], area_error + rounding * areas[segment]
        )
        found = _middle_curvature(velocity, area)
        best = int(found.argmax())
        if found[best] > lower:
            lower, at = float(found[best]), (int(segment[best]), float(start[best] + 0.5 ** (depth + 1)))
        open_ = bounds > max(lower * (1.0 + tolerance), floor)
        upper = max(upper, float(bounds[~open_].max(initial=0.0)))
        if not open_.any():
            break
        if depth == DEEPEST or 2 * open_.sum() > MOST_PIECES:
            upper = max(upper, float(bounds[open_].max()))
            break
        velocity, area = _halves(velocity[open_]), _halves(area[open_])
        start = np.stack([start[open_], start[open_] + 0.5 ** (depth + 1)], 1).ravel()
        segment, speed_error, area_error = (np.repeat(x[open_], 2) for x in (segment, speed_error, area_error))
    return Curvature(lower, max(upper, lower), *at)


def _piece_bounds(
    velocity: FloatArray, area: FloatArray, speed_error: FloatArray, area_error: FloatArray
) -> FloatArray:
    """Return an upper bound of the curvature of each piece; infinite where |c'| is not bounded away from 0."""
    n = velocity.shape[1]  # the curve's degree
    greatest_speed, greatest_area = np.linalg.norm(velocity, axis=2).max(1), np.linalg.norm(area, axis=2).max(1)
    # |x + e|² ≤ |x|² + 2|x||e| + |e|², and the rounding of at most 8n sums of three products
    more_area = 2 * area_error * greatest_area + area_error**2 + 64 * n * UNIT_ROUNDOFF * greatest_area**2
    less_speed = 2 * speed_error * greatest_speed + speed_error**2 + 64 * n * UNIT_ROUNDOFF * greatest_speed**2
    square_area, square_speed = _scalar_product(area, area), _scalar_product(velocity, velocity)
    above = _elevated(square_area + more_area[:, None], 6 * (n - 1))
    below = square_speed - less_speed[:, None]
    regular = (below > 0.0).all(axis=1)
    below = np.where(regular[:, None], below, 1.0)
    cubes = _product(_product(below, below), below)  # all terms positive: relative rounding only
    bounds = np.sqrt((above / cubes).max(axis=1)) * (1.0 + 256 * n * UNIT_ROUNDOFF)
    return np.where(regular, bounds, np.inf)


def _middle_curvature(velocity: FloatArray, area: FloatArray) -> FloatArray:
    """Return the curvature in the middle of each piece."""
    speed = np.linalg.norm(_middle(velocity), axis=1)
    size = np.linalg.norm(_middle(area), axis=1)
    return np.divide(size, speed**3, out=np.zeros_like(size), where=speed**3 > 0.0)


def _middle(points: FloatArray) -> FloatArray:
    while points.shape[1] > 1:
        points = 0.5 * (points[:, 1:] + points[:, :-1])
    return points[:, 0]


def _halves(points: FloatArray) -> FloatArray:
    """Return both halves of each polynomial, one after the other, shape (2m, n + 1, dim)."""
    left, right, row = [], [], points
    while True:
        left.append(row[:, 0])
        right.append(row[:, -1])
        if row.shape[1] == 1:
            break
        row = 0.5 * (row[:, 1:] + row[:, :-1])
    both = np.stack([np.stack(left, 1), np.stack(right[::-1], 1)], axis=1)
    return both.reshape(-1, *points.shape[1:])


def _binomials(n: int) -> FloatArray:
    return np.array([float(comb(n, i)) for i in range(n + 1)])


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the Bernstein coefficients of the product of polynomials, row by row; shapes (m, n + 1) and (m, k + 1)."""
    n, k = a.shape[1] - 1, b.shape[1] - 1
    total, left, right = np.zeros((len(a), n + k + 1)), _binomials(n), _binomials(k)
    for i in range(n + 1):
        total[:, i : i + k + 1] += left[i] * right * a[:, i, None] * b
    return total / _binomials(n + k)


def _elevated(a: FloatArray, degree: int) -> FloatArray:
    return _product(a, np.ones((len(a), degree - a.shape[1] + 2)))


def _scalar_product(a: FloatArray, b: FloatArray) -> FloatArray:
    return _product(a[..., 0], b[..., 0]) + _product(a[..., 1], b[..., 1]) + _product(a[..., 2], b[..., 2])


def _cross_product(a: FloatArray, b: FloatArray) -> FloatArray:
    axes = [(1, 2), (2, 0), (0, 1)]
    return np.stack([_product(a[..., i], b[..., j]) - _product(a[..., j], b[..., i]) for i, j in axes], axis=2)
