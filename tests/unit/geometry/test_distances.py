"""The distance of two edges against the oracle, and the bound that is proved."""

from fractions import Fraction

import numpy as np
import oracles
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.distances import closest_points, dual_bound, edge_distance

Points = NDArray[np.float64]
Generator = np.random.Generator


def random(rng: Generator) -> Points:
    return rng.normal(size=(4, 3))


def parallel(rng: Generator) -> Points:
    x = rng.normal(size=(4, 3))
    x[3] = x[2] + rng.choice([-2.0, -0.5, 0.25, 1.0, 4.0]) * (x[1] - x[0])
    return x


def nearly_parallel(rng: Generator) -> Points:
    x = parallel(rng)
    x[3] += rng.normal(size=3) * 10.0 ** rng.uniform(-12, -3)
    return x


def without_length(rng: Generator) -> Points:
    x = rng.normal(size=(4, 3))
    which = rng.integers(3)
    if which != 1:
        x[1] = x[0]
    if which != 0:
        x[3] = x[2]
    return x


def on_a_lattice(rng: Generator) -> Points:
    return rng.integers(-2, 3, size=(4, 3)).astype(float)


def long_and_short(rng: Generator) -> Points:
    x = rng.normal(size=(4, 3))
    x[1] = x[0] + 1e5 * (x[1] - x[0])
    return x


FAMILIES = {
    family.__name__: family
    for family in (random, parallel, nearly_parallel, without_length, on_a_lattice, long_and_short)
}

SHARPNESS = {family: 1e-6 if family == "nearly_parallel" else 1e-9 for family in FAMILIES}
"""Where lines are parallel but for an angle of 1e-7, any point of them counts as closest."""


def corners(x: Points) -> tuple[tuple[float, float, float], ...]:
    return tuple(tuple(p) for p in x.tolist())


@pytest.mark.parametrize("scale", [1e-60, 1e-9, 1.0, 1e9])
@pytest.mark.parametrize("family", FAMILIES)
def test_the_distance_is_that_of_the_oracle(family: str, scale: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(150):
        x = FAMILIES[family](rng)
        expected = oracles.edge_distance(*x)
        size = np.abs(x).max()
        found = edge_distance(*corners(scale * x)) / scale
        assert found >= expected - 1e-9 * size
        assert found == pytest.approx(expected, rel=1e-9, abs=SHARPNESS[family] * size)


def test_squares_that_underflow_leave_an_upper_bound() -> None:
    rng = np.random.default_rng(9)
    for _ in range(50):
        x = random(rng)
        assert edge_distance(*corners(1e-100 * x)) >= 1e-100 * oracles.edge_distance(*x) * (1 - 1e-9)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_closest_points_lie_on_the_edges_and_their_difference_is_the_vector(family: str) -> None:
    rng = np.random.default_rng(2)
    for _ in range(150):
        x = FAMILIES[family](rng)
        s, t, w = closest_points(*corners(x))
        assert 0.0 <= s <= 1.0
        assert 0.0 <= t <= 1.0
        difference = x[0] + s * (x[1] - x[0]) - x[2] - t * (x[3] - x[2])
        np.testing.assert_allclose(w, difference, atol=1e-14 * np.abs(x).max())


@pytest.mark.parametrize("family", FAMILIES)
def test_swapping_edges_or_ends_does_not_change_the_distance(family: str) -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        x = FAMILIES[family](rng)
        first = edge_distance(*corners(x))
        for order in ([1, 0, 2, 3], [0, 1, 3, 2], [2, 3, 0, 1]):
            assert edge_distance(*corners(x[order])) == pytest.approx(
                first, rel=1e-9, abs=SHARPNESS[family] * np.abs(x).max()
            )


def squared_exactly(x: Points) -> Fraction:
    return oracles.squared_edge_distance_exact(*x.tolist())


def is_at_most(bound: float, squared: Fraction) -> bool:
    return bound <= 0.0 or Fraction(bound) ** 2 <= squared


@pytest.mark.parametrize("family", FAMILIES)
def test_the_bound_of_any_direction_is_never_above_the_exact_distance(family: str) -> None:
    rng, positive = np.random.default_rng(4), 0
    for _ in range(60):
        x = FAMILIES[family](rng) + rng.choice([0.0, 1e3, 1e8]) * rng.normal(size=3)
        squared = squared_exactly(x)
        found = np.array(closest_points(*corners(x))[2])
        for w in (found, found + 1e-8 * rng.normal(size=3), x[0] - x[2], rng.normal(size=3), 1e9 * rng.normal(size=3)):
            bound = dual_bound(tuple(w.tolist()), *corners(x))
            assert is_at_most(bound, squared)
            positive += bound > 0.0
    assert positive > 60


@pytest.mark.parametrize("family", ["random", "parallel", "without_length", "on_a_lattice"])
def test_the_bound_of_the_direction_that_is_found_is_tight(family: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(150):
        x = FAMILIES[family](rng)
        expected = oracles.edge_distance(*x)
        if expected > 0.01:
            bound = dual_bound(closest_points(*corners(x))[2], *corners(x))
            assert expected * (1 - 1e-9) <= bound <= expected * (1 + 1e-15)


def test_edges_that_cross_have_no_positive_bound() -> None:
    x = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0.0]])
    assert edge_distance(*corners(x)) == 0.0
    for w in np.random.default_rng(6).normal(size=(50, 3)):
        assert dual_bound(tuple(w.tolist()), *corners(x)) <= 0.0


@pytest.mark.parametrize("w", [(0.0, 0.0, 0.0), (1e-150, 0.0, 0.0), (np.nan, 0.0, 0.0)])
def test_a_direction_without_a_length_proves_nothing(w: tuple[float, float, float]) -> None:
    x = np.array([[0, 0, 1], [1, 0, 1], [0, 0, 0], [0, 1, 0.0]])
    assert not dual_bound(w, *corners(x)) > 0.0
