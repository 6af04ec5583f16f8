"""From vertices to control points: against SciPy, rational arithmetic, and what an error of a vertex becomes."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline

from mdtopo.geometry.bezier import evaluate
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.splines import (
    AMPLIFICATION,
    BSPLINE,
    CATMULL_ROM,
    CONTROL_ERROR,
    INTERPOLATING,
    interpolation_weights,
    spline_controls,
)

Points = NDArray[np.float64]
KINDS = (INTERPOLATING, BSPLINE, CATMULL_ROM)
SHAPES = [(n, closed) for closed in (False, True) for n in (2, 3, 4, 5, 11, 40) if n > 2 or not closed]


def controls(x: Points, closed: bool, kind: int) -> Points:
    n = len(x)
    out = np.empty((n if closed else n - 1, 4, 3))
    spline_controls(x, np.arange(n), np.array([0, n]), np.array([closed]), kind, out)
    return out


def some(n: int) -> Points:
    return np.random.default_rng(n).normal(size=(n, 3))


@pytest.mark.parametrize(("n", "closed"), SHAPES)
def test_the_interpolating_spline_is_that_of_scipy(n: int, closed: bool) -> None:
    x = some(n)
    knots = np.vstack([x, x[:1]]) if closed else x
    spline = CubicSpline(np.arange(len(knots)), knots, bc_type="periodic" if closed else "natural")
    u = np.linspace(0, 1, 7)
    for k, segment in enumerate(controls(x, closed, INTERPOLATING)):
        np.testing.assert_allclose(evaluate(segment, u), spline(k + u), atol=1e-13)


def test_the_b_spline_of_a_ring_is_that_of_scipy() -> None:
    x, n = some(7), 7
    spline = BSpline(np.arange(-3.0, n + 4), np.vstack([x[-1:], x, x[:2]]), 3)
    u = np.linspace(0, 0.999, 7)
    for k, segment in enumerate(controls(x, True, BSPLINE)):
        np.testing.assert_allclose(evaluate(segment, u), spline(k + u), atol=1e-13)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("n", "closed"), SHAPES)
def test_neighbours_share_their_end_and_their_slope(n: int, closed: bool, kind: int) -> None:
    found = controls(some(n), closed, kind)
    before, after = (np.roll(found, 1, axis=0), found) if closed else (found[:-1], found[1:])
    assert (before[:, 3] == after[:, 0]).all()
    np.testing.assert_allclose(before[:, 3] - before[:, 2], after[:, 1] - after[:, 0], atol=1e-14)
    if kind != BSPLINE or not closed:
        np.testing.assert_array_equal(found[0, 0], some(n)[0])


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_of_a_vertex_grows_no_further_than_said(kind: int) -> None:
    worst = 0.0
    for n, closed in SHAPES:
        weights = np.stack(
            [controls(np.repeat(unit[:, None], 3, axis=1), closed, kind)[:, :, 0].ravel() for unit in np.eye(n)]
        )
        worst = max(worst, np.abs(weights).sum(axis=0).max())
    assert worst <= AMPLIFICATION[kind] + 1e-12
    if kind != INTERPOLATING:
        assert worst > 0.99 * AMPLIFICATION[kind]


def test_the_error_of_the_interpolating_spline_reaches_what_is_said_in_alternating_strands() -> None:
    n = 40
    weights = np.stack(
        [controls(np.repeat(unit[:, None], 3, axis=1), True, INTERPOLATING)[:, :, 0].ravel() for unit in np.eye(n)]
    )
    assert np.abs(weights).sum(axis=0).max() == pytest.approx(1 + np.sqrt(3) - 1, abs=1e-9)


@pytest.mark.parametrize("closed", [False, True])
def test_rounding_of_control_points_stays_below_its_bound(closed: bool) -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        n = int(rng.integers(3, 12))
        x = rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-3, 4) + rng.normal(size=3) * 100.0
        found, exact = controls(x, closed, INTERPOLATING), exact_controls(x, closed)
        off = max(
            sum((Fraction(a) - b) ** 2 for a, b in zip(p, q, strict=True))
            for one, two in zip(found.tolist(), exact, strict=True)
            for p, q in zip(one, two, strict=True)
        )
        assert off <= Fraction(CONTROL_ERROR * np.abs(x).max()) ** 2
        assert float(off) ** 0.5 <= 32 * UNIT_ROUNDOFF * np.abs(x).max()  # the bound is far from tight


def exact_controls(x: Points, closed: bool) -> list[list[list[Fraction]]]:
    n = len(x)
    p = [[Fraction(value) for value in row] for row in x.tolist()]
    rows = []
    for i in range(n):
        row = [Fraction(0)] * n
        row[i] = Fraction(4 if closed or 0 < i < n - 1 else 2)
        for j in (i - 1, i + 1):
            if closed or 0 <= j < n:
                row[j % n] += 1
        before, after = (i - 1, (i + 1) % n) if closed else (max(i - 1, 0), min(i + 1, n - 1))
        rows.append(row + [b - a for a, b in zip(p[before], p[after], strict=True)])
    for column in range(n):
        chosen = next(i for i in range(column, n) if rows[i][column])
        rows[column], rows[chosen] = rows[chosen], rows[column]
        rows[column] = [value / rows[column][column] for value in rows[column]]
        for i in range(n):
            if i != column and rows[i][column]:
                factor = rows[i][column]
                rows[i] = [value - factor * base for value, base in zip(rows[i], rows[column], strict=True)]
    slopes = [row[n:] for row in rows]
    found = []
    for k in range(n if closed else n - 1):
        q = (k + 1) % n
        inner = [
            [a + s for a, s in zip(p[k], slopes[k], strict=True)],
            [a - s for a, s in zip(p[q], slopes[q], strict=True)],
        ]
        found.append([p[k], *inner, p[q]])
    return found


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_the_single_curve_through_points_meets_them(n: int) -> None:
    x = some(n + 1)
    u = np.arange(n + 1) / n
    np.testing.assert_allclose(evaluate(interpolation_weights(n) @ x, u), x, atol=1e-10)
