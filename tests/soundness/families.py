"""Motions of two edges, chosen to lie where a certificate is easily wrong: (n, 4, 3) at the start and at the end."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Motions = tuple[Points, Points]
Generator = np.random.Generator


def meeting(rng: Generator, gaps: Points, speeds: Points, *, tilt: float | Points = 1.0) -> Motions:
    """Two edges that at one time of the step are `gap` apart across their common normal, at points inside both.

    The sign of the gap says on which side; with a motion that is larger than the gap the edges pass, or just do not.
    `tilt` is the angle between them.
    """
    n = len(gaps)
    first, other = unit(rng, n), unit(rng, n)
    second = first + np.reshape(tilt, (-1, 1)) * other
    normal = np.cross(first, other)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    s, r = rng.uniform(0.05, 0.95, size=(2, n, 1))
    x = np.empty((n, 4, 3))
    x[:, 0], x[:, 1] = -s * first, (1 - s) * first
    x[:, 2], x[:, 3] = -r * second, (1 - r) * second
    x[:, 2:] += (gaps[:, np.newaxis] * normal)[:, np.newaxis]
    velocity = rng.normal(size=(n, 4, 3)) * speeds[:, np.newaxis, np.newaxis]
    t = rng.uniform(size=(n, 1, 1))
    return x - t * velocity, x + (1 - t) * velocity


def unit(rng: Generator, n: int) -> Points:
    v = rng.normal(size=(n, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def powers(rng: Generator, n: int, low: float, high: float) -> Points:
    return np.asarray(10.0 ** rng.uniform(low, high, size=n))


def signs(rng: Generator, n: int) -> Points:
    return rng.choice([-1.0, 1.0], size=n)


def in_hex(x0: Points, x1: Points) -> str:
    """Return the positions at both ends so that they can be typed in again to the last bit."""
    return " -> ".join(str([[v.hex() for v in p] for p in x.tolist()]) for x in (x0, x1))


def random_motions(rng: Generator, n: int) -> Motions:
    x0 = rng.normal(size=(n, 4, 3))
    return x0, x0 + rng.normal(size=(n, 4, 3)) * powers(rng, n, -2, 0.3)[:, np.newaxis, np.newaxis]


def near_touching(rng: Generator, n: int) -> Motions:
    gaps = signs(rng, n) * powers(rng, n, -15, -3)
    return meeting(rng, gaps, np.abs(gaps) * powers(rng, n, -2, 1))


def grazing(rng: Generator, n: int) -> Motions:
    """The gap is far below the motion: whether they pass is decided in the last digits."""
    return meeting(rng, signs(rng, n) * powers(rng, n, -15, -3), powers(rng, n, -3, 0))


def near_parallel(rng: Generator, n: int) -> Motions:
    tilt, gaps = powers(rng, n, -12, -2), signs(rng, n) * powers(rng, n, -12, -2)
    return meeting(rng, gaps, np.abs(gaps) * powers(rng, n, -1, 1), tilt=tilt)


def lattice_points(rng: Generator, n: int) -> Motions:
    """Small integers: planes, common points, overlaps and edges without length all occur."""
    x0 = rng.integers(-3, 4, size=(n, 4, 3)).astype(float)
    move = rng.integers(-1, 2, size=(n, 4, 3)) * (rng.random((n, 4, 1)) < 0.4)
    return x0, x0 + move


def coplanar(rng: Generator, n: int) -> Motions:
    x0, x1 = lattice_points(rng, n)
    plane = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
    x0[:, :, 2] = x1[:, :, 2] = 0.0
    turned = rng.random(n) < 0.5  # about half of them are in a plane no longer, by rounding
    x0[turned], x1[turned] = x0[turned] @ plane, x1[turned] @ plane
    return x0, x1


def far_away(rng: Generator, n: int) -> Motions:
    """Heights of a few units in the last place at large offsets: their midpoints cannot be told apart."""
    base = 2.0 ** rng.integers(14, 31, size=(n, 1, 1))
    ulp = np.spacing(base)
    x0 = np.concatenate([rng.normal(size=(n, 4, 2)), np.zeros((n, 4, 1))], axis=2)
    x0[:, :, 2] = rng.integers(0, 3, size=(n, 4)) * ulp[:, :, 0]
    x0 += base
    x1 = x0.copy()
    x1[:, 2:, 2] += rng.integers(-2, 3, size=(n, 1)) * ulp[:, :, 0]
    x1[:, :2, 2] += rng.integers(0, 2, size=(n, 1)) * ulp[:, :, 0]
    return x0, x1


def tiny_and_huge(rng: Generator, n: int) -> Motions:
    x0, x1 = near_touching(rng, n)
    size = powers(rng, n, -6, 6)[:, np.newaxis, np.newaxis]
    return x0 * size, x1 * size


def float32_data(rng: Generator, n: int) -> Motions:
    x0, x1 = meeting(rng, signs(rng, n) * powers(rng, n, -7, -3), powers(rng, n, -7, -1))
    shift = rng.uniform(-50, 50, size=(n, 1, 3))
    return tuple((x * 3.8 + shift).astype(np.float32).astype(np.float64) for x in (x0, x1))  # type: ignore[return-value]


def hundredths(rng: Generator, n: int) -> Motions:
    """Coordinates rounded to 0.01 Å, as XTC files hold them."""
    x0, x1 = meeting(rng, signs(rng, n) * powers(rng, n, -3, -1), powers(rng, n, -3, -1))
    shift = rng.uniform(-50, 50, size=(n, 1, 3))
    return np.round(x0 * 3.8 + shift, 2), np.round(x1 * 3.8 + shift, 2)


def extreme_scales(rng: Generator, n: int) -> Motions:
    """Squares that underflow, fourth powers that do, and coordinates up to the limit of what is accepted."""
    x0, x1 = meeting(rng, signs(rng, n) * powers(rng, n, -3, 0), powers(rng, n, -2, 0.3))
    size = powers(rng, n, -170, 11)[:, np.newaxis, np.newaxis]
    return x0 * size, x1 * size


FAMILIES: dict[str, Callable[[Generator, int], Motions]] = {
    "random": random_motions,
    "near touching": near_touching,
    "grazing": grazing,
    "near parallel": near_parallel,
    "lattice points": lattice_points,
    "coplanar": coplanar,
    "far away": far_away,
    "tiny and huge": tiny_and_huge,
    "float32": float32_data,
    "hundredths": hundredths,
    "extreme scales": extreme_scales,
}
