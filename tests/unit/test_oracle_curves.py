"""The judges of curves against hand values, the exact cases, and the judges of polylines."""

from fractions import Fraction
from math import sqrt

import cases
import numpy as np
import oracles
import pytest
from numpy.typing import NDArray
from oracles.beziers import bezier_derivative, bezier_point, restricted, split_at, whole_numbers
from oracles.curves import (
    curve_at,
    following_of,
    is_contact,
    moving_meetings,
    passage_sign,
    static_meetings,
)
from oracles.splines import b_spline_cubics, catmull_rom_cubics, interpolating_cubics
from oracles.zeros import Box, zeros

CURVES = cases.curve_cases()
LONE = [-1]
ITSELF = [0]


def elevated(x: NDArray[np.float64], edges: list[tuple[int, int]]) -> list[list[list[Fraction]]]:
    """Return edges as cubics: the same points at the same parameters."""
    exact = oracles.exact_points(x.tolist())
    share = [Fraction(k, 3) for k in range(4)]
    return [[[(1 - s) * p + s * q for p, q in zip(exact[a], exact[b], strict=True)] for s in share] for a, b in edges]


def test_a_point_of_a_cubic_by_hand() -> None:
    points = [[0, 0], [0, 8], [8, 8], [8, 0]]
    assert bezier_point(points, "1/2") == [4, 6]
    assert bezier_point(bezier_derivative(points), "1/2") == [12, 0]
    assert split_at(points, "1/2") == ([[0, 0], [0, 4], [2, 6], [4, 6]], [[4, 6], [6, 6], [8, 4], [8, 0]])


def test_the_part_of_a_curve_is_its_two_cuts() -> None:
    points = CURVES["T9"].p0
    _, after = split_at(points, "1/4")
    part, _ = split_at(after, "1/3")
    (whole,) = whole_numbers(points)
    found = restricted(whole, 0, Fraction(1, 4), Fraction(1, 2))
    factor = Fraction(found[0, 1]) / part[0][1]
    assert factor > 0
    assert [[Fraction(v) / factor for v in row] for row in found] == part


def test_zeros_of_a_map_by_hand() -> None:
    """(8x - 2, 8y - 6) in Bernstein coefficients, then shifted so that the zero leaves the box or is on its border."""
    f = np.array([[[-2, -6], [-2, 2]], [[6, -6], [6, 2]]], dtype=object)
    (zero,) = zeros(f).simple
    assert zero.box.middle == pytest.approx((0.25, 0.75), abs=1e-20)
    assert zero.turn == 1
    assert [z.turn for z in zeros(f * np.array([1, -1], dtype=object)).simple] == [-1]
    assert zeros(f + np.array([3, 0], dtype=object)).is_free
    border = zeros(f + np.array([2, 0], dtype=object))
    assert (border.simple, len(border.undecided) > 0) == ((), True)


def test_a_double_zero_is_undecided_and_a_near_one_is_not() -> None:
    """(x - 1/2)² + e, over x, with y beside it: no zero for e > 0, two for e < 0, and one that is double for e = 0."""

    def parabola(e: int) -> NDArray[np.object_]:
        x = np.array([2**40 + e, -(2**40) + e, 2**40 + e], dtype=object)
        f = np.zeros((3, 2, 2), dtype=object)
        f[:, :, 0], f[:, 0, 1], f[:, 1, 1] = x[:, np.newaxis], -1, 2
        return f

    assert zeros(parabola(1)).is_free
    assert len(zeros(parabola(-1)).simple) == 2
    double = zeros(parabola(0), most_pieces=200)
    assert (double.simple, len(double.undecided) > 0) == ((), True)


def test_a_box_meets_what_it_touches() -> None:
    one, other = Box((Fraction(0),), (Fraction(1),)), Box((Fraction(1),), (Fraction(2),))
    assert one.meets(other)
    assert not other.is_inside(one)
    assert not one.is_inside(one)


def test_t2_has_a_cusp_and_then_a_loop() -> None:
    case = CURVES["T2"]
    curve = {t: [curve_at([case.p0], [case.p1], t)[0]] for t in ("0", "1/10", "2/5", "1")}
    assert static_meetings(curve["0"], LONE).is_free
    assert static_meetings(curve["1/10"], LONE).is_free
    cusp = static_meetings(curve["2/5"], LONE, most_pieces=400)
    assert not cusp.meetings
    assert all(abs(place.u - 0.5) < 0.1 for m in cusp.undecided for place in (m.first, m.second))
    assert len(cusp.undecided) > 0
    (loop,) = static_meetings(curve["1"], LONE).meetings
    assert (loop.first.u, loop.second.u) == pytest.approx((0.5 - sqrt(15) / 10, 0.5 + sqrt(15) / 10), abs=1e-15)


@pytest.mark.parametrize("name", ["T3", "T4"])
def test_t3_and_t4_meet_themselves_at_the_end(name: str) -> None:
    case = CURVES[name]
    assert static_meetings([case.p0], LONE).is_free
    u, v = case.expect["double_point_t1"]["parameters"]
    assert is_contact([case.p1], (0, u), (0, v))
    assert not is_contact([case.p1], (0, u), (0, v + Fraction(1, 10**9)))
    found = static_meetings([case.p1], LONE, most_pieces=400)
    assert len(found.undecided) > 0
    assert all(max(m.first.u, abs(m.second.u - 0.25)) < 0.1 for m in found.undecided)


def test_t9_passes_once() -> None:
    """The expected time is known to some 3e-9: it comes from a height of 69.4176184 that rises by 22."""
    case = CURVES["T9"]
    found = moving_meetings([case.p0], [case.p1], ITSELF)
    (meeting,) = found.meetings
    expected = case.expect["passage"]
    assert not found.undecided
    assert meeting.t == pytest.approx(expected["t"], abs=3e-9)
    assert (meeting.first.u, meeting.second.u) == pytest.approx((expected["u"], expected["v"]), abs=5e-9)
    places = [(0, meeting.first.u), (0, meeting.second.u)]
    assert meeting.sign == passage_sign([case.p0], [case.p1], meeting.t, *places)
    back = moving_meetings([case.p1], [case.p0], ITSELF).meetings
    assert [m.sign for m in back] == [-meeting.sign]
    assert back[0].t == pytest.approx(1 - meeting.t, abs=1e-14)


def chain(rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x0 = rng.normal(size=(9, 3))
    return x0, x0 + rng.normal(size=(9, 3)) * 0.7


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5, 6])
def test_straight_cubics_pass_as_edges_do(seed: int) -> None:
    """An open chain of five vertices and a ring of four."""
    x0, x1 = chain(np.random.default_rng(seed))
    edges = [(0, 1), (1, 2), (2, 3), (3, 4), (5, 6), (6, 7), (7, 8), (8, 5)]
    after = following_of([4, 4], [False, True])
    found = moving_meetings(elevated(x0, edges), elevated(x1, edges), after)
    expected = oracles.passages(x0.tolist(), x1.tolist(), [0, 5, 9], [False, True])
    assert not found.undecided
    assert len(found.meetings) == len(expected.events)
    for meeting, event in zip(found.meetings, expected.events, strict=True):
        places = sorted([meeting.first, meeting.second])
        ends = {event.first: float(event.s), event.second: float(event.r)}
        assert meeting.t == pytest.approx(event.t, abs=1e-12)
        assert meeting.sign == event.sign
        assert {edges[p.segment] for p in places} == set(ends)
        assert [p.u for p in places] == pytest.approx([ends[edges[p.segment]] for p in places], abs=1e-9)


def dense(cubics: list[list[list[Fraction]]], n: int = 24) -> NDArray[np.float64]:
    u = np.arange(n) / n
    weights = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3], axis=1)
    return np.concatenate([weights @ np.array(segment, dtype=np.float64) for segment in cubics])


@pytest.mark.parametrize("seed", range(3))
def test_the_linking_number_of_two_splines_changes_by_the_sum_of_signs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moves = rng.normal(size=(2, 12, 3))
    curves = [interpolating_cubics(x[:6].tolist(), True) + interpolating_cubics(x[6:].tolist(), True) for x in moves]
    found = moving_meetings(*curves, following_of([6, 6], [True, True]))
    assert not found.undecided
    between = [m.sign for m in found.meetings if (m.first.segment < 6) != (m.second.segment < 6)]
    links = [round(oracles.linking_number(dense(c[:6]), dense(c[6:]))) for c in curves]
    assert links[1] - links[0] == sum(between)
    assert len(between) > 0
    for meeting in found.meetings:
        places = [(p.segment, p.u) for p in (meeting.first, meeting.second)]
        assert meeting.sign == passage_sign(*curves, meeting.t, *places)


def test_an_image_is_passed_like_a_strand() -> None:
    """One bar that moves by a whole cell passes a bar across it in the next cell once, in the middle of both."""
    bars = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, -1], [0, 1, -1]])
    lift = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 4], [0, 0, 4]])
    low, high = (
        elevated(bars, [(0, 1), (2, 3)]),
        elevated(bars + lift, [(0, 1), (2, 3)]),
    )
    (meeting,) = moving_meetings(low, high, [-1, -1]).meetings
    assert (meeting.t, meeting.first, meeting.second) == (0.25, (0, 0.5), (1, 0.5))
    back = [[0, 0, 8.0], [0, 0, 8.0]]
    assert moving_meetings(low, high, [-1, -1], shift=back).is_free
    near = [[0, 0, -1.0], [0, 0, -1.0]]
    (other,) = moving_meetings(low, high, [-1, -1], shift=near).meetings
    assert (other.t, other.first, other.second, other.sign) == (0.5, (0, 0.5), (1, 0.5), meeting.sign)


def test_the_spline_through_three_points_by_hand() -> None:
    """Natural, through heights 0, 1, 0: second derivatives 0, -3, 0."""
    one, other = interpolating_cubics([[0, 0], [1, 1], [2, 0]], closed=False)
    assert one == [[0, 0], [Fraction(1, 3), Fraction(1, 2)], [Fraction(2, 3), 1], [1, 1]]
    assert other == [[1, 1], [Fraction(4, 3), 1], [Fraction(5, 3), Fraction(1, 2)], [2, 0]]


def test_the_periodic_spline_of_a_square_by_hand() -> None:
    """s_(i-1) + 4 s_i + s_(i+1) = x_(i+1) - x_(i-1) for the slopes, of which opposite ones cancel."""
    segments = interpolating_cubics([[1, 0], [0, 1], [-1, 0], [0, -1]], closed=True)
    assert segments[0] == [[1, 0], [1, Fraction(1, 2)], [Fraction(1, 2), 1], [0, 1]]


@pytest.mark.parametrize("closed", [False, True])
def test_b_spline_and_catmull_rom_by_hand(closed: bool) -> None:
    points = [[0, 0], [6, 0], [6, 6], [0, 6]]
    spline, through = b_spline_cubics(points, closed), catmull_rom_cubics(points, closed)
    assert len(spline) == len(through) == (4 if closed else 3)
    assert spline[1] == [[5, 1], [6, 2], [6, 4], [5, 5]]
    assert through[1] == [[6, 0], [7, 1], [7, 5], [6, 6]]
    assert spline[0][0] == ([1, 1] if closed else [0, 0])
    assert through[0][1] == ([1, -1] if closed else [2, 0])
