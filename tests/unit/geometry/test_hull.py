"""d* against the oracle: never above the exact distance, and sharp."""

from fractions import Fraction

import numpy as np
import oracles
import pytest
from cases import curve_cases
from numpy.typing import NDArray

from mdtopo.geometry.hull import direction_bound, hull_distance, least_norm_point

Points = NDArray[np.float64]


def cloud(rng: np.random.Generator, n: int) -> Points:
    return rng.normal(size=(n, 3)) + rng.choice([0.5, 1.5, 4.0]) * rng.normal(size=3)


def on_a_grid(rng: np.random.Generator, n: int) -> Points:
    return (rng.integers(-2, 3, size=(n, 3)) + rng.integers(0, 3, size=3)).astype(float)


def plane(rng: np.random.Generator, n: int) -> Points:
    x = cloud(rng, n)
    x[:, 2] = 0.0
    return x


def tilted_plane(rng: np.random.Generator, n: int) -> Points:
    x = rng.normal(size=(n, 3))
    x[:, 2] = 1.0 + 0.3 * x[:, 0]
    return x


def line(rng: np.random.Generator, n: int) -> Points:
    return rng.normal(size=3) + rng.normal(size=(n, 1)) * rng.normal(size=3)


def duplicates(rng: np.random.Generator, n: int) -> Points:
    x = cloud(rng, max(n // 2, 1))
    return x[rng.integers(len(x), size=n)]


FAMILIES = {f.__name__: f for f in (cloud, on_a_grid, plane, tilted_plane, line, duplicates)}


@pytest.mark.parametrize("n", range(1, 13))
@pytest.mark.parametrize("family", FAMILIES)
def test_the_distance_is_that_of_the_oracle(family: str, n: int) -> None:
    rng = np.random.default_rng([n, len(family)])
    for _ in range(15):
        points = FAMILIES[family](rng, n)
        expected, found = oracles.hull_distance(points), hull_distance(points)
        if expected > 1e-6:
            assert found == pytest.approx(expected, rel=1e-7, abs=1e-9)
        else:
            assert found <= 1e-7


@pytest.mark.parametrize("family", FAMILIES)
def test_the_distance_is_never_above_the_exact_one(family: str) -> None:
    rng, positive = np.random.default_rng(len(family)), 0
    for _ in range(30):
        scale = 10.0 ** rng.integers(-6, 7)
        points = scale * FAMILIES[family](rng, int(rng.integers(1, 8)))
        found = hull_distance(points)
        assert found <= 0.0 or Fraction(found) ** 2 <= oracles.squared_hull_distance_exact(points.tolist())
        positive += found > 0.0
    assert positive > 5


def test_no_direction_proves_more_than_the_exact_distance() -> None:
    rng, positive = np.random.default_rng(1), 0
    for _ in range(30):
        points = cloud(rng, 6)
        squared = oracles.squared_hull_distance_exact(points.tolist())
        for w in (points.mean(axis=0), rng.normal(size=3), np.array(least_norm_point(points))):
            bound = direction_bound(points, tuple(w.tolist()))
            assert bound <= 0.0 or Fraction(bound) ** 2 <= squared
            positive += bound > 0.0
    assert positive > 20


@pytest.mark.parametrize("n", [2, 3, 4, 6, 12])
def test_the_origin_inside_the_hull_has_no_positive_distance(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(50):
        half = rng.normal(size=(n, 3))
        points = np.concatenate([half, -half * rng.uniform(0.1, 3.0, size=(n, 1))])
        assert hull_distance(points) <= 0.0


def test_the_origin_as_a_point_or_on_a_face_has_no_positive_distance() -> None:
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    assert hull_distance(corner) <= 0.0
    assert hull_distance(corner - [0.25, 0.25, 0.0]) <= 0.0
    assert hull_distance(corner + np.array([0.0, 0.0, 1e-3])) == pytest.approx(1e-3, rel=1e-10)  # the near miss


def test_one_point_is_its_own_distance() -> None:
    assert hull_distance(np.array([[3.0, 4.0, 12.0]])) == pytest.approx(13.0, rel=1e-15)


def test_rounding_is_taken_off() -> None:
    assert hull_distance(np.array([[3.0, 4.0, 12.0]])) < 13.0


def test_the_cube_around_its_corner_direction() -> None:
    cube = np.array([[x, y, z] for x in (1, 2) for y in (1, 2) for z in (1, 2)], dtype=float)
    assert hull_distance(cube) == pytest.approx(np.sqrt(3.0), rel=1e-14)


@pytest.mark.parametrize("name", ["T2", "T3", "T4"])
def test_d_star_of_the_hodograph_of_an_exact_case(name: str) -> None:
    case = curve_cases()[name]
    control = np.zeros((len(case.p0), 3))
    control[:, : len(case.p0[0])] = case.floats[0]
    expected = float(case.expect["squared_d_star_t0"]) ** 0.5
    assert hull_distance(np.diff(control, axis=0)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("scale", [1e-12, 1e-3, 1e6, 1e12])
def test_scaling_scales_the_distance(scale: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        points = cloud(rng, 8) + 3.0
        assert hull_distance(scale * points) == pytest.approx(
            scale * hull_distance(points), rel=1e-10, abs=1e-10 * scale
        )
