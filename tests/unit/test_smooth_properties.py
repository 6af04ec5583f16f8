"""What holds of every spline and of every d*: against slow definitions, and under maps that must not matter."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import oracles
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.splines import b_spline_cubics, catmull_rom_cubics, interpolating_cubics

from mdtopo import Strands, d_star, spline_curve
from mdtopo.records import CompositeBezier

Array = NDArray[np.float64]

SLOW = {"interpolating": interpolating_cubics, "bspline": b_spline_cubics, "catmull-rom": catmull_rom_cubics}
KINDS = pytest.mark.parametrize("kind", SLOW)

ROUND = 1e-13
"""Of coordinates of at most 100: some hundred roundings, as a share of them."""


@st.composite
def strand(draw: st.DrawFn) -> tuple[Array, bool]:
    """One strand of 3 to 9 vertices on a grid of eighths, no two neighbours the same."""
    closed = draw(st.booleans())
    n = draw(st.integers(3, 9))
    numbers = draw(st.lists(st.integers(-400, 400), min_size=3 * n, max_size=3 * n))
    x = np.array(numbers, dtype=float).reshape(n, 3) / 8.0
    assume((x != np.roll(x, 1, axis=0)).any(axis=1).all())
    return x, closed


def curve(x: Array, closed: bool, kind: str) -> CompositeBezier:
    return spline_curve(x, Strands.from_lengths([len(x)], closed=closed), kind=kind)  # type: ignore[arg-type]


def controls(x: Array, closed: bool, kind: str) -> Array:
    return np.asarray(curve(x, closed, kind).control_points)


def near(found: Array, expected: Array, size: float = 100.0) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUND * size)


@KINDS
@given(strand())
@settings(max_examples=15)
def test_control_points_are_those_of_the_definition(kind: str, one: tuple[Array, bool]) -> None:
    x, closed = one
    made = curve(x, closed, kind)
    exact = SLOW[kind](x.tolist(), closed)
    furthest = max(
        sum((Fraction(float(v)) - w) ** 2 for v, w in zip(p, q, strict=True))
        for segment, truth in zip(made.control_points, exact, strict=True)
        for p, q in zip(segment, truth, strict=True)
    )
    assert furthest <= Fraction(made.error) ** 2


@KINDS
@given(strand(), st.lists(st.integers(-8, 8), min_size=12, max_size=12))
@settings(max_examples=40)
def test_an_affine_map_of_the_vertices_is_one_of_the_curve(
    kind: str, one: tuple[Array, bool], numbers: list[int]
) -> None:
    x, closed = one
    matrix, shift = np.array(numbers[:9], dtype=float).reshape(3, 3) / 8.0, np.array(numbers[9:], dtype=float)
    y = x @ matrix + shift
    assume((y != np.roll(y, 1, axis=0)).any(axis=1).all())
    near(controls(y, closed, kind), controls(x, closed, kind) @ matrix + shift, 400.0)


@KINDS
@given(strand())
@settings(max_examples=40)
def test_the_reversed_strand_has_the_reversed_curve(kind: str, one: tuple[Array, bool]) -> None:
    x, closed = one
    back = controls(x[::-1], closed, kind)[::-1, ::-1]
    near(np.roll(back, -1, axis=0) if closed else back, controls(x, closed, kind))


@KINDS
@given(strand(), st.integers(1, 8))
@settings(max_examples=40)
def test_it_does_not_matter_where_a_ring_begins(kind: str, one: tuple[Array, bool], start: int) -> None:
    x, _ = one
    near(controls(np.roll(x, -start, axis=0), True, kind), np.roll(controls(x, True, kind), -start, axis=0))


@pytest.mark.parametrize(("kind", "reach"), [("bspline", 2), ("catmull-rom", 2)])
@given(strand(), st.integers(0, 8), st.integers(1, 80))
@settings(max_examples=40)
def test_a_vertex_moves_its_neighbourhood_and_nothing_else(
    kind: str, reach: int, one: tuple[Array, bool], which: int, move: int
) -> None:
    x, closed = one
    k = which % len(x)
    y = x.copy()
    y[k] += [0.0, 0.0, move / 3.0]
    assume((y != np.roll(y, 1, axis=0)).any(axis=1).all())
    moved = (controls(x, closed, kind) != controls(y, closed, kind)).any(axis=(1, 2))
    for segment in np.flatnonzero(moved):
        ends = [segment, (segment + 1) % len(x)]
        apart = [min(abs(k - e), len(x) - abs(k - e)) if closed else abs(k - e) for e in ends]
        assert min(apart) <= reach - 1


def test_a_vertex_moves_all_of_an_interpolating_spline() -> None:
    """The check of locality can fail: this kind has none."""
    x = np.random.default_rng(0).normal(size=(9, 3))
    y = x.copy()
    y[0] += 1.0
    assert (controls(x, False, "interpolating") != controls(y, False, "interpolating")).any(axis=(1, 2)).all()


def joints(points: Array, closed: bool) -> list[tuple[Array, Array]]:
    found = list(pairwise(points))
    return [*found, (points[-1], points[0])] if closed else found


@KINDS
@given(strand())
@settings(max_examples=40)
def test_the_curve_is_smooth_at_its_joints(kind: str, one: tuple[Array, bool]) -> None:
    x, closed = one
    for before, after in joints(controls(x, closed, kind), closed):
        np.testing.assert_array_equal(before[3], after[0])
        near(before[3] - before[2], after[1] - after[0])
        if kind != "catmull-rom":
            near(before[1] - 2 * before[2] + before[3], after[0] - 2 * after[1] + after[2], 400.0)


@pytest.mark.parametrize("kind", ["interpolating", "catmull-rom"])
@given(strand())
@settings(max_examples=40)
def test_the_curve_goes_through_its_vertices(kind: str, one: tuple[Array, bool]) -> None:
    x, closed = one
    points = controls(x, closed, kind)
    np.testing.assert_array_equal(points[:, 0], x[: len(points)])
    np.testing.assert_array_equal(points[:, 3], np.roll(x, -1, axis=0)[: len(points)])


@KINDS
@given(strand(), strand(), st.integers(0, 16))
@settings(max_examples=40)
def test_vertices_that_move_linearly_move_the_control_points_linearly(
    kind: str, one: tuple[Array, bool], other: tuple[Array, bool], sixteenths: int
) -> None:
    (x, closed), (y, _), t = one, other, sixteenths / 16.0
    n = min(len(x), len(y))
    middle = (1 - t) * x[:n] + t * y[:n]
    for z in (x[:n], y[:n], middle):
        assume((z != np.roll(z, 1, axis=0)).any(axis=1).all())
    expected = (1 - t) * controls(x[:n], closed, kind) + t * controls(y[:n], closed, kind)
    near(controls(middle, closed, kind), expected)


HULLS = st.lists(st.lists(st.integers(-40, 40), min_size=3, max_size=3), min_size=1, max_size=8)
SIZES = st.integers(-20, 20)


@given(HULLS, SIZES, st.integers(0, 60), st.booleans())
@example([[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1]], 0, 0, False)
@example([[0, 0, 1], [0, 0, 1], [0, 0, 1]], 0, 0, False)
@settings(max_examples=200)
def test_d_star_is_a_sharp_lower_bound(points: list[list[int]], power: int, lift: int, flat: bool) -> None:
    """Small integers make degenerate hulls; a lift of 2^-k above the origin's plane makes nearly touching ones."""
    v = np.array(points, dtype=float)
    if flat:
        v[:, 2] = 2.0**-lift
    v *= 2.0**power
    squared = oracles.squared_hull_distance_exact(v.tolist())
    found = Fraction(d_star(v))
    assert found >= 0
    assert found**2 <= squared
    size = float(np.abs(v).max())
    assert float(squared) ** 0.5 - float(found) <= 1e-7 * size


@given(st.lists(st.lists(st.integers(-40, 40), min_size=2, max_size=2), min_size=1, max_size=7))
@settings(max_examples=150)
def test_d_star_in_the_plane_is_that_of_space(points: list[list[int]]) -> None:
    v = np.array(points, dtype=float)
    assert d_star(v) == d_star(np.column_stack([v, np.zeros(len(v))]))
    assert Fraction(d_star(v)) ** 2 <= oracles.squared_hull_distance_exact(v.tolist())


@given(HULLS, st.permutations(range(8)))
@settings(max_examples=100)
def test_d_star_of_repeated_and_reordered_points_is_the_same(points: list[list[int]], order: list[int]) -> None:
    v = np.array(points, dtype=float)
    again = v[[k % len(v) for k in [*order, *range(len(v))]]]
    assert abs(d_star(v) - d_star(again)) <= 1e-7 * max(np.abs(v).max(), 1.0)
