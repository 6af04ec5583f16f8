"""Bezier curves of any degree against Bernstein polynomials and hand values."""

from math import comb

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.bezier import curvature, derivative, elevate, evaluate, halve, hodograph, part, split

U = np.linspace(0.0, 1.0, 11)


def bernstein(points: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    n = len(points) - 1
    return np.stack([comb(n, i) * u**i * (1 - u) ** (n - i) for i in range(n + 1)], axis=1) @ points


def some(n: int, dimension: int = 3) -> NDArray[np.float64]:
    return np.random.default_rng(n).normal(size=(n + 1, dimension))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("n", [1, 2, 3, 6, 12])
def test_points_are_those_of_the_bernstein_form(n: int, dimension: int) -> None:
    np.testing.assert_allclose(evaluate(some(n, dimension), U), bernstein(some(n, dimension), U), atol=1e-14)


@pytest.mark.parametrize("n", [1, 3, 6])
@pytest.mark.parametrize("cut", [0.0, 0.3, 0.5, 1.0])
def test_parts_are_the_same_curve(n: int, cut: float) -> None:
    left, right = split(some(n), cut)
    np.testing.assert_allclose(evaluate(left, U), evaluate(some(n), cut * U), atol=1e-14)
    np.testing.assert_allclose(evaluate(right, U), evaluate(some(n), cut + (1 - cut) * U), atol=1e-14)
    assert (left[-1] == right[0]).all()
    np.testing.assert_allclose(evaluate(part(some(n), 0.2, 0.7), U), evaluate(some(n), 0.2 + 0.5 * U), atol=1e-14)


def test_halves_are_the_parts_at_one_half() -> None:
    left, right = np.empty((4, 3)), np.empty((4, 3))
    halve(some(3), left, right)
    for found, expected in zip((left, right), split(some(3), 0.5), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize("n", [1, 3, 6])
def test_elevation_keeps_the_curve(n: int) -> None:
    higher = elevate(some(n), n + 4)
    assert higher.shape == (n + 5, 3)
    np.testing.assert_allclose(evaluate(higher, U), evaluate(some(n), U), atol=1e-14)


def test_derivative_is_n_times_the_hodograph() -> None:
    h = 1e-6
    slope = (evaluate(some(5), U + h) - evaluate(some(5), U - h)) / (2 * h)
    np.testing.assert_allclose(evaluate(derivative(some(5)), U), slope, atol=1e-7)
    np.testing.assert_array_equal(hodograph(some(5)), np.diff(some(5), axis=0))


def test_curvature_of_a_parabola_and_of_a_cusp() -> None:
    parabola = np.array([[-1, 1, 0], [0, -1, 0], [1, 1, 0.0]])  # y = x²
    assert curvature(parabola, np.array([0.5]))[0] == pytest.approx(2.0, rel=1e-14)
    assert curvature(np.array([[0, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0.0]]), np.array([0.5]))[0] == np.inf
