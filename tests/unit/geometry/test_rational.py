"""Passages in exact arithmetic: hand values, near misses at every border, and the oracle on small integers."""

from collections import Counter
from fractions import Fraction
from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.exact import cross, dot, minus

from mdtopo.geometry.rational import exact_passages, sign_at, unit_roots

HALF = Fraction(1, 2)
LITTLE = Fraction(1, 2**90)
BAR = [[-1, 0, 0], [1, 0, 0]]

REASONS = {"frame": "frame", "touch": "touch", "vertex": "vertex", "parallel": "sliding", "coplanar": "sliding"}
"""The oracle's words for a contact, and the state that stands for it."""


def exact(points: Any) -> Any:
    return tuple(tuple(Fraction(x) for x in p) for p in points)


def judged(start: Any, end: Any) -> tuple[set[str], list[Any]]:
    """Return the reasons of all contacts, as states, and the passages: from the oracle."""
    truth = oracles.pair_passages([start[:2], start[2:]], [end[:2], end[2:]])
    return {REASONS[c.reason] for c in truth.contacts}, list(truth.events)


def edges_at(start: Any, end: Any, t: Fraction) -> tuple[Any, Any, Any]:
    """Return u = b - a, v = d - c and w = c - a."""
    a, b, c, d = ([p + t * (q - p) for p, q in zip(x, y, strict=True)] for x, y in zip(start, end, strict=True))
    return minus(b, a), minus(d, c), minus(c, a)


def in_one_plane(start: Any, end: Any) -> bool:
    """Return whether f is zero all the time: a cubic that is zero at four times."""
    times = (Fraction(0), HALF, Fraction(1), Fraction(2))
    return all(dot(w, cross(u, v)) == 0 for u, v, w in (edges_at(start, end, t) for t in times))


def on_one_line(start: Any, end: Any) -> bool:
    """Return whether both edges lie on one line at a time with a small denominator."""
    times = {Fraction(p, q) for q in range(1, 13) for p in range(q + 1)}
    return any(
        not any((*cross(u, v), *cross(w, u), *cross(w, v))) for u, v, w in (edges_at(start, end, t) for t in times)
    )


def assert_agrees(start: Any, end: Any) -> str:
    state, meetings = exact_passages(exact(start), exact(end))
    reasons, events = judged(start, end)
    assert [m.sign for m in meetings] == [e.sign for e in events]
    for m, e in zip(meetings, events, strict=True):
        assert (m.t, m.s, m.r) == pytest.approx((e.t, float(e.s), float(e.r)), abs=1e-12)
    if in_one_plane(start, end):
        assert state == "sliding"
        assert reasons <= {"sliding"}
    elif state == "sliding" and "sliding" not in reasons:
        # on one line, where they are apart or touch in a frame: whether they meet is not looked at
        assert on_one_line(start, end)
    elif reasons:
        assert state in reasons
    else:
        assert state == ("passage" if events else "free")
    return state


# --- by hand ----------------------------------------------------------------------------------------------------------


def lowered(z0: Any, z1: Any, x: Any = 0, y: Any = 0) -> tuple[Any, Any]:
    """A bar along y, above a bar along x that rests, lowered from z0 to z1."""
    second = [[[x, y - 1, z], [x, y + 1, z]] for z in (z0, z1)]
    return BAR + second[0], BAR + second[1]


def state_of(motion: tuple[Any, Any]) -> str:
    assert_agrees(*motion)
    return exact_passages(*map(exact, motion))[0]


def test_a_passage_by_hand() -> None:
    start, end = lowered(1, -3, x=HALF, y=Fraction(1, 4))
    state, (meeting,) = exact_passages(exact(start), exact(end))
    assert state == "passage"
    assert meeting == (0.25, 0.75, 0.375, 1)
    state, (back,) = exact_passages(exact(end), exact(start))
    assert back == (0.75, 0.75, 0.375, -1)


@pytest.mark.parametrize(("edge", "sign"), [("x", -1), ("y", -1), ("both", 1)])
def test_the_sign_flips_with_the_direction_of_one_edge(edge: str, sign: int) -> None:
    motion = [list(x) for x in lowered(1, -3)]
    for x in motion:
        if edge in ("x", "both"):
            x[0], x[1] = x[1], x[0]
        if edge in ("y", "both"):
            x[2], x[3] = x[3], x[2]
    _, (meeting,) = exact_passages(exact(motion[0]), exact(motion[1]))
    assert meeting.sign == sign


@pytest.mark.parametrize(
    ("z0", "z1", "state"),
    [
        (1, 0, "frame"),
        (0, 1, "frame"),
        (0, -1, "frame"),
        (1, LITTLE, "free"),
        (LITTLE, 1, "free"),
        (1, -LITTLE, "passage"),
        (LITTLE, -1, "passage"),
    ],
)
def test_a_root_at_an_end_of_the_step_and_just_beside_it(z0: Any, z1: Any, state: str) -> None:
    assert state_of(lowered(z0, z1)) == state


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize(
    ("place", "state"),
    [
        (1, "vertex"),
        (-1, "vertex"),
        (1 - LITTLE, "passage"),
        (-1 + LITTLE, "passage"),
        (1 + LITTLE, "free"),
        (-1 - LITTLE, "free"),
    ],
)
def test_the_ends_of_both_edges_and_just_beside_them(axis: str, place: Any, state: str) -> None:
    assert state_of(lowered(1, -2, **{axis: place})) == state


def test_a_double_root_is_a_touch_and_beside_it_are_two_passages_or_none() -> None:
    # the line of the first edge has the height ±x/2·(2t - 1) at x = 2t - 1: f ~ c - (2t - 1)²/2
    def state(height: Any) -> tuple[str, list[int]]:
        start = [[-4, 0, 2], [4, 0, -2], [-1, -1, height], [-1, 1, height]]
        end = [[-4, 0, -2], [4, 0, 2], [1, -1, height], [1, 1, height]]
        assert_agrees(start, end)
        found, meetings = exact_passages(exact(start), exact(end))
        return found, [m.sign for m in meetings]

    assert state(0) == ("touch", [])
    assert state(-LITTLE) == ("free", [])
    found, signs = state(LITTLE)
    assert (found, sorted(signs)) == ("passage", [-1, 1])


def tripled(shift: Any) -> tuple[Any, Any]:
    """Two edges with f = -4·(g - shift)·g², g = 2t - 1: u = (g, 1, 0)·2, v = (0, g, 1)·2, centres (g - shift) apart."""
    corners = []
    for g in (-1, 1):
        z = g - shift
        corners.append([[-g, -1, 0], [g, 1, 0], [0, -g, z - 1], [0, g, z + 1]])
    return corners[0], corners[1]


def test_a_triple_root_is_one_passage_and_beside_it_is_a_touch_and_a_passage() -> None:
    state, meetings = exact_passages(*map(exact, tripled(0)))
    assert (state, meetings) == ("passage", [(0.5, 0.5, 0.5, -1)])
    state, (meeting,) = exact_passages(*map(exact, tripled(LITTLE)))
    assert (state, meeting.sign) == ("touch", -1)
    for shift in (0, LITTLE, Fraction(1, 4)):
        assert_agrees(*tripled(shift))


@pytest.mark.parametrize(
    ("start", "end"),
    [
        # two bars in one plane, one of which sweeps over the other
        ([*BAR, [0, 1, 0], [0, 2, 0]], [*BAR, [0, -2, 0], [0, -1, 0]]),
        # an edge without length
        ([[0, 0, 0], [0, 0, 0], [-1, 0, 1], [1, 0, 1]], [[0, 0, 0], [0, 0, 0], [-1, 0, -1], [1, 0, -1]]),
        # parallel all the time
        ([*BAR, [-1, 0, 1], [1, 0, 1]], [*BAR, [-1, 0, -1], [1, 0, -1]]),
        # at rest, crossed in one plane
        ([*BAR, [0, -1, 0], [0, 1, 0]], [*BAR, [0, -1, 0], [0, 1, 0]]),
    ],
)
def test_f_that_is_zero_all_the_time_is_sliding(start: Any, end: Any) -> None:
    assert exact_passages(exact(start), exact(end)) == ("sliding", [])
    assert judged(start, end)[0] == {"sliding"}


@pytest.mark.parametrize(("start", "end"), [([*BAR, [0, 5, 0], [1, 5, 0]], [*BAR, [0, 6, 0], [1, 7, 0]])])
def test_edges_in_one_plane_that_never_meet_are_not_looked_at_either(start: Any, end: Any) -> None:
    assert judged(start, end) == (set(), [])
    assert exact_passages(exact(start), exact(end)) == ("sliding", [])


@pytest.mark.parametrize(
    ("along", "across", "state"),
    [
        (0, 0, "sliding"),  # on each other at t = 1/2
        (2, 0, "sliding"),  # end to end
        (2 + LITTLE, 0, "sliding"),  # on one line, apart: not looked at
        (2 + LITTLE, LITTLE, "free"),
        (0, LITTLE, "passage"),  # crossed in the middle just before
    ],
)
def test_edges_that_are_parallel_for_an_instant(along: Any, across: Any, state: str) -> None:
    # the second one swings through the direction of the first about an axis that is not at right angles to its path
    start = [*BAR, [along - 1, across - 1, -1], [along + 1, across - 1, 1]]
    end = [*BAR, [along - 1, across + 1, 1], [along + 1, across + 1, -1]]
    assert assert_agrees(start, end) == state


def test_a_cubic_with_three_passages() -> None:
    start = [[-1, 0, -2], [-4, -3, 1], [0, -3, 4], [-1, 0, 3]]
    end = [[-2, 1, 1], [2, 3, 3], [-1, 3, -2], [0, 1, 4]]
    state, meetings = exact_passages(exact(start), exact(end))
    assert state == "passage"
    assert [m.t for m in meetings] == pytest.approx([3 / 5, 4 / 5, 5 / 6], abs=1e-15)
    assert [m.s for m in meetings] == pytest.approx([11 / 12, 1 / 2, 10 / 21], abs=1e-15)
    assert [m.sign for m in meetings] in ([1, -1, 1], [-1, 1, -1])
    assert_agrees(start, end)


# --- against the oracle -----------------------------------------------------------------------------------------------

small = st.integers(-2, 2)
points = st.lists(st.lists(small, min_size=3, max_size=3), min_size=4, max_size=4)


@given(start=points, end=points)
@settings(max_examples=40)
def test_small_integer_motions_are_what_the_oracle_says(start: Any, end: Any) -> None:
    assert_agrees(start, end)


def test_among_small_integer_motions_every_state_occurs_and_agrees() -> None:
    rng = np.random.default_rng(11)
    seen = Counter(
        assert_agrees(*rng.integers(-span, span + 1, (2, 4, 3)).tolist()) for span in (1, 3) for _ in range(250)
    )
    for state in ("free", "passage", "vertex", "frame", "sliding"):
        assert seen[state] >= 5, seen


# --- roots ------------------------------------------------------------------------------------------------------------


def product_of(*roots: Fraction) -> list[int]:
    """Return the integer polynomial with these roots, the constant first."""
    p = [1]
    for root in roots:
        n, d = root.numerator, root.denominator
        p = [-n * a + d * b for a, b in zip([*p, 0], [0, *p], strict=True)]
    return p


@given(st.lists(st.fractions(-1, 2, max_denominator=12), min_size=1, max_size=4))
@settings(max_examples=60)
def test_unit_roots_are_each_isolated_once_in_order(roots: list[Fraction]) -> None:
    p = product_of(*roots)
    found = list(unit_roots(p))
    expected = sorted({root for root in roots if 0 <= root <= 1})
    assert len(found) == len(expected)
    for bracket, root in zip(found, expected, strict=True):
        assert bracket.low == root == bracket.high or bracket.low < root < bracket.high
        assert sign_at(product_of(root), bracket, p) == 0
        for other in (Fraction(1, 3), Fraction(-1, 7), Fraction(12, 11)):
            assert sign_at(product_of(other), bracket, p) == (root > other) - (root < other)
