"""A passage of two moving segments is proved, or not: hand values, near misses, and that it is the only one around."""

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.curves import moving_meetings

from mdtopo.geometry.curvemeeting import difference_and_slopes, locate, place_in_space

Points = NDArray[np.float64]
MIDDLE = (0.5, 0.5, 0.5)
BAR = np.array([[-1.0, 0, 0], [1, 0, 0]])
ACROSS = np.array([[0.0, -1, 0], [0, 1, 0]])
UP = np.array([0.0, 0, 1])
ARCH = np.array([[-1.0, 0, 0], [0, 2, 0], [1, 0, 0]])
"""The parabola y = 1 - x², x = 2u - 1."""


def found(
    a0: Points, a1: Points, b0: Points, b1: Points, start: tuple[float, float, float] = MIDDLE, slack: float = 0.0
) -> tuple[bool, tuple[float, float, float], float, int]:
    greatest = max(float(np.abs(x).max()) for x in (a0, a1, b0, b1))
    return locate(a0, a1, b0, b1, start, slack, greatest)  # type: ignore[no-any-return]


def test_two_bars_that_pass_half_way() -> None:
    proved, place, radius, sign = found(BAR, BAR, ACROSS + UP, ACROSS - UP)
    assert (proved, sign) == (True, 1)
    assert place == pytest.approx(MIDDLE, abs=1e-15)
    assert radius == 0.25
    assert place_in_space(ACROSS + UP, ACROSS - UP, place[0], place[2]) == pytest.approx((0, 0, 0), abs=1e-15)


@pytest.mark.parametrize("t", [0.01, 0.3, 0.97])
@pytest.mark.parametrize(("u", "v"), [(0.2, 0.9), (0.75, 0.5)])
def test_bars_that_pass_elsewhere(t: float, u: float, v: float) -> None:
    b0 = ACROSS + UP * t + [2 * u - 1, 1 - 2 * v, 0]
    proved, place, radius, sign = found(BAR, BAR, b0, b0 - UP)
    assert (proved, sign) == (True, 1)
    assert place == pytest.approx((t, u, v), abs=1e-14)
    room = min(t, 1 - t, u, 1 - u, v, 1 - v)
    assert 0 < radius <= room


@pytest.mark.parametrize(("inside", "proved"), [(1e-6, True), (0.0, False), (-1e-6, False)])
def test_only_what_lies_within_the_segments_and_the_step_is_a_passage(inside: float, proved: bool) -> None:
    assert found(BAR, BAR, ACROSS + UP * inside, ACROSS + UP * (inside - 1))[0] is proved  # in time
    end = np.array([1.0 - inside, 0, 0])
    assert found(BAR, BAR, ACROSS + UP + end, ACROSS - UP + end)[0] is proved  # along the first
    side = np.array([0, 1.0 - inside, 0])
    assert found(BAR, BAR, ACROSS + UP + side, ACROSS - UP + side)[0] is proved  # along the second


def test_what_does_not_pass_is_none() -> None:
    assert not found(BAR, BAR, ACROSS + UP, ACROSS + UP)[0]  # never there
    assert not found(BAR, BAR, BAR + UP, BAR - UP)[0]  # parallel: meets all along
    assert not found(BAR, BAR, ACROSS, ACROSS)[0]  # always there
    flat = np.array([0.0, 1, 0])
    assert not found(BAR, BAR, ACROSS + 2 * flat, ACROSS - 2 * flat)[0]  # in one plane


@pytest.mark.parametrize(("slack", "proved"), [(0.0, True), (1e-3, True), (0.1, False)])
def test_nothing_is_proved_where_control_points_are_off_by_too_much(slack: float, proved: bool) -> None:
    assert found(BAR, BAR, ACROSS + UP, ACROSS - UP, slack=slack)[0] is proved


@pytest.mark.parametrize("start", [(0.5, 0.3, 0.3), (0.5, 0.7, 0.7)])
def test_of_two_passages_each_has_a_cube_without_the_other(start: tuple[float, float, float]) -> None:
    """The parabola comes down upon a line that cuts it at x = ±1/2 at half time."""
    line = np.array([[-1.0, 0.75, 0], [0, 0.75, 0], [1, 0.75, 0]])
    proved, (t, u, v), radius, sign = found(ARCH + UP, ARCH - UP, line, line, start)
    assert proved
    assert (t, abs(u - 0.5), abs(v - 0.5)) == pytest.approx((0.5, 0.25, 0.25), abs=1e-14)
    assert radius < 0.5
    assert sign == (1 if u < 0.5 else -1)


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9])
def test_two_passages_close_to_each_other_are_told_apart(gap: float) -> None:
    """The line lies just below the top of the parabola."""
    line = np.array([[-1.0, 1 - gap, 0], [0, 1 - gap, 0], [1, 1 - gap, 0]])
    apart = np.sqrt(gap)
    for side in (-1, 1):
        u = 0.5 + 0.5 * side * apart
        proved, place, radius, _ = found(ARCH + UP, ARCH - UP, line, line, (0.5, u, u))
        if proved:
            assert place[1] == pytest.approx(u, rel=1e-6)
            assert radius < apart
    above = line + np.array([0, 2 * gap, 0])
    assert not found(ARCH + UP, ARCH - UP, above, above)[0]


def random_passage(seed: int) -> tuple[list[Points], tuple[float, float, float]]:
    """Return two cubics that pass at known places, and where."""
    random = np.random.default_rng(seed)
    points = [random.normal(size=(4, 3)) for _ in range(4)]
    t, u, v = random.uniform(0.2, 0.8, size=3)
    apart, *_ = difference_and_slopes(*points, t, u, v)
    return [points[0], points[1], points[2] + apart, points[3] + apart], (t, u, v)


SEEDS = range(12)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_passage_of_cubics_is_found_with_the_sign_that_exact_arithmetic_gives(seed: int) -> None:
    points, place = random_passage(seed)
    proved, near, radius, sign = found(*points, start=place)
    assert proved
    assert near == pytest.approx(place, abs=1e-9)
    starts, ends = np.stack([points[0], points[2]]), np.stack([points[1], points[3]])
    exact = [m for m in moving_meetings(starts, ends, [-1, -1]).meetings if m.first.segment != m.second.segment]
    inside = [m for m in exact if np.abs(np.subtract((m.t, m.first.u, m.second.u), near)).max() < radius]
    assert [m.sign for m in inside] == [sign]


@pytest.mark.parametrize("seed", SEEDS)
def test_signs_under_what_turns_them(seed: int) -> None:
    (a0, a1, b0, b1), (t, u, v) = random_passage(seed)
    sign = found(a0, a1, b0, b1, (t, u, v))[3]
    assert found(b0, b1, a0, a1, (t, v, u))[3] == sign  # which of the two is first says nothing
    assert found(a1, a0, b1, b0, (1 - t, u, v))[3] == -sign  # backwards in time
    assert found(a0[::-1].copy(), a1[::-1].copy(), b0, b1, (t, 1 - u, v))[3] == -sign
    mirrored = [x * [1.0, 1.0, -1.0] for x in (a0, a1, b0, b1)]
    assert found(*mirrored, start=(t, u, v))[3] == -sign
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    proved, place, _, same = found(*(x @ turn + [3.0, -5.0, 7.0] for x in (a0, a1, b0, b1)), start=(t, u, v))
    assert (proved, same) == (True, sign)
    assert place == pytest.approx((t, u, v), abs=1e-9)
