"""What a check is cut into: the parts of each kind, which together hold all that the whole one asks."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.beziers import split_at

from mdtopo.geometry.halving import Pieces, extent, halve_piece, take_top, whole_check
from mdtopo.geometry.segmenthulls import JOINT, PAIR, SELF

Points = NDArray[np.float64]
DEEPEST = 3

SMALL = np.array([[0.0, 0, 0], [1, 2, 0], [2, 2, 1], [3, 0, 0]])
LARGE = 4.0 * SMALL + SMALL[-1]
Part = tuple[int, tuple[float, ...]]


def cut(kind: int, a: Points, b: Points, motion: float = 0.0) -> Pieces:
    """Return the parts of a check of segments that move by `motion` along z."""
    move = np.array([0, 0, motion])
    pieces = whole_check(kind, a, a, b, b + move, DEEPEST)
    take_top(pieces, 1)
    n = halve_piece(pieces, 0, True, motion)
    return Pieces(*(array[:n] for array in pieces))


def parts(pieces: Pieces) -> set[Part]:
    return {(int(k), tuple(box.tolist())) for k, box in zip(pieces.kinds, pieces.boxes, strict=True)}


def box(u: str, v: str, t: str = "01") -> tuple[float, ...]:
    ends = {"0": 0.0, "h": 0.5, "1": 1.0}
    return tuple(ends[end] for end in t + u + v)


@pytest.mark.parametrize(
    ("kind", "a", "b", "expected"),
    [
        (SELF, SMALL, SMALL, {(SELF, box("0h", "0h")), (SELF, box("h1", "h1")), (JOINT, box("0h", "h1"))}),
        (
            JOINT,
            SMALL,
            LARGE,
            {
                (JOINT, box("h1", "0h")),
                (PAIR, box("0h", "0h")),
                (PAIR, box("0h", "h1")),
                (PAIR, box("h1", "h1")),
            },
        ),
        (PAIR, LARGE, SMALL, {(PAIR, box("0h", "01")), (PAIR, box("h1", "01"))}),
        (PAIR, SMALL, LARGE, {(PAIR, box("01", "0h")), (PAIR, box("01", "h1"))}),
    ],
)
def test_the_parts_of_each_kind(kind: int, a: Points, b: Points, expected: set[Part]) -> None:
    assert parts(cut(kind, a, b)) == expected


@pytest.mark.parametrize("kind", [SELF, JOINT, PAIR])
def test_a_motion_larger_than_the_segments_is_halved_in_time(kind: int) -> None:
    pieces = cut(kind, SMALL, SMALL if kind == SELF else LARGE, motion=1000.0)
    assert parts(pieces) == {(kind, box("01", "01", "0h")), (kind, box("01", "01", "h1"))}
    assert pieces.boxes[-1, 0] == 0.0, "the earlier half is looked at first"
    np.testing.assert_array_equal(pieces.points[1, 3], pieces.points[0, 2])


@pytest.mark.parametrize(("share", "in_time"), [(0.99, False), (1.01, True)])
def test_a_pair_is_halved_in_time_where_it_moves_further_than_it_is_long(share: float, in_time: bool) -> None:
    longest = float(np.linalg.norm(LARGE - LARGE[0], axis=1).max())
    pieces = whole_check(PAIR, LARGE, LARGE, SMALL, SMALL, DEEPEST)
    take_top(pieces, 1)
    assert extent(pieces.points, len(pieces.kinds) - 1, 0) == pytest.approx(longest, rel=1e-15)
    halve_piece(pieces, 0, True, share * longest)
    assert bool(pieces.boxes[0, 1] - pieces.boxes[0, 0] == 0.5) is in_time


@pytest.mark.parametrize("kind", [SELF, JOINT])
def test_what_does_not_stay_clear_at_the_ends_is_not_halved_in_time(kind: int) -> None:
    pieces = whole_check(kind, SMALL, SMALL, SMALL if kind == SELF else LARGE, LARGE, DEEPEST)
    take_top(pieces, 1)
    halve_piece(pieces, 0, False, 1000.0)
    assert pieces.boxes[0, 0] == 0.0
    assert pieces.boxes[0, 1] == 1.0


@pytest.mark.parametrize("kind", [SELF, JOINT, PAIR])
def test_parts_have_the_control_points_of_exact_halves(kind: int) -> None:
    random = np.random.default_rng(kind)
    a = random.integers(-64, 64, size=(4, 3)).astype(float)  # three averages of whole numbers are floats
    b = a if kind == SELF else a[-1] + random.integers(-64, 64, size=(4, 3)).astype(float)
    for part, of in zip(cut(kind, a, b).points, cut(kind, a, b).boxes, strict=True):
        for k, whole, low, high in ((0, a, of[2], of[3]), (2, b, of[4], of[5])):
            halves = split_at(whole.tolist(), Fraction(1, 2))
            expected = whole if high - low == 1.0 else np.array(halves[int(low == 0.5)], dtype=float)
            np.testing.assert_array_equal(part[k], expected)


def covered(found: set[Part], u: float, v: float) -> bool:
    return any(o[2] <= u <= o[3] and o[4] <= v <= o[5] for _, o in found)


@pytest.mark.parametrize("kind", [SELF, JOINT, PAIR])
def test_the_parts_leave_no_two_places_out(kind: int) -> None:
    """Of a segment with itself (u, v) and (v, u) are the same question, so that one of the two is enough."""
    found = parts(cut(kind, SMALL, SMALL if kind == SELF else LARGE))
    for u, v in product(np.linspace(0, 1, 9), repeat=2):
        assert covered(found, u, v) or (kind == SELF and covered(found, v, u))


def test_neighbouring_parts_share_their_joint_bit_for_bit() -> None:
    random = np.random.default_rng(1)
    a = random.normal(size=(4, 3))
    for part, kind in zip(cut(SELF, a, a).points, cut(SELF, a, a).kinds, strict=True):
        if kind == JOINT:
            np.testing.assert_array_equal(part[0, -1], part[2, 0])


def test_the_stack_holds_what_the_deepest_check_needs() -> None:
    pieces = whole_check(JOINT, SMALL, SMALL, LARGE, LARGE, DEEPEST)
    waiting, most = 1, 0
    while waiting:
        top = take_top(pieces, waiting)
        waiting -= 1
        if pieces.depths[top] < DEEPEST:
            waiting = halve_piece(pieces, waiting, False, 0.0)
        most = max(most, waiting)
    assert most <= len(pieces.kinds) - 1
    assert most > DEEPEST
