"""One check, halved until it is settled: hand values, near misses on both sides, and what leaves it open."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.segmenthulls import BY_MOTION, JOINT, NOT_AT_ALL, PAIR, SELF
from mdtopo.geometry.subdivision import (
    BY_HALVING,
    BY_MEETING,
    DEEPEST,
    MOST_BOXES,
    Answer,
    is_inside,
    keep_meeting,
    settle,
)
from mdtopo.records import Rung

Points = NDArray[np.float64]
BAR = np.array([[-1.0, 0, 0], [1, 0, 0]])
ACROSS = np.array([[0.0, -1, 0], [0, 1, 0]])
UP = np.array([0.0, 0, 1])
LOOP = np.array([[0.0, 0, 0], [2, 1, 0], [-1, 1, 0], [1, 0, 0]])
"""The end of the paper's Fig. 2: x = u(6 - 15u + 10u²) and y = 3u(1 - u), so it meets itself where u + v = 1."""


def answer(
    kind: int, a0: Points, a1: Points, b0: Points, b1: Points, slack: float = 0.0, boxes: int = MOST_BOXES
) -> Answer:
    greatest = max(float(np.abs(x).max()) for x in (a0, a1, b0, b1))
    return settle(kind, a0, a1, b0, b1, slack, greatest, boxes)  # type: ignore[no-any-return]


def pair(a0: Points, a1: Points, b0: Points, b1: Points, slack: float = 0.0) -> Answer:
    return answer(PAIR, a0, a1, b0, b1, slack)


def test_the_rungs_have_the_numbers_of_the_records() -> None:
    assert [BY_HALVING, BY_MEETING] == [Rung.BISECTION, Rung.EXACT]


def test_bars_that_stay_apart_are_settled_at_once() -> None:
    found = pair(BAR, BAR, ACROSS + UP, ACROSS + UP)
    assert (found.rung, found.depth, len(found.meetings)) == (BY_MOTION, 0, 0)
    assert found.clearance == pytest.approx(1.0, abs=1e-12)
    assert found.motion == pytest.approx(0.0, abs=1e-14)


def test_bars_that_pass_have_one_meeting() -> None:
    found = pair(BAR, BAR, ACROSS + UP, ACROSS - UP)
    assert (found.rung, found.clearance) == (BY_MEETING, 0.0)
    assert found.motion == pytest.approx(2.0, rel=1e-12)
    (meeting,) = found.meetings.tolist()
    assert meeting[:3] == pytest.approx([0.5, 0.5, 0.5], abs=1e-14)
    assert meeting[4] == 1


@pytest.mark.parametrize("gap", [0.3, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_bar_that_comes_near_is_told_from_one_that_passes(gap: float, side: int) -> None:
    """It comes down to a gap above the other, or below it, while it slides along."""
    slide = np.array([0.7, 0, 0])
    found = pair(BAR, BAR, ACROSS + UP - slide, ACROSS + UP * gap * side + slide)
    assert len(found.meetings) == (side < 0)
    if side > 0:
        assert found.rung in range(BY_MOTION, BY_MEETING)
        assert 0.2 * gap < found.clearance <= gap * (1 + 1e-12)
    else:  # a passage so near the end of the step stands, but what is beside it is left open
        assert found.rung == (BY_MEETING if gap > 1e-4 else NOT_AT_ALL)
        assert found.meetings[0, 0] == pytest.approx(1 / (1 + gap), rel=1e-12)


@pytest.mark.parametrize("gap", [0.1, 1e-3, 1e-8])
def test_a_bar_around_another_is_certified_by_halving(gap: float) -> None:
    """An arch that turns from one side of a bar to the other, past its end."""
    bar = np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 2]])
    arch0 = np.array([[-3.0, 0, -gap], [0, 4, -gap], [3, 0, -gap]])
    arch1 = arch0 * [1.0, -1.0, 1.0]
    found = pair(bar, bar, arch0, arch1)
    assert found.rung in range(BY_MOTION, BY_MEETING)
    assert 0 < found.clearance <= gap
    assert len(pair(bar, bar, arch0 + 2 * gap * UP, arch1 + 2 * gap * UP).meetings) == 1


def test_a_touch_that_does_not_pass_is_left_open_with_its_place() -> None:
    found = pair(BAR, BAR, ACROSS + UP, ACROSS)  # they meet in the frame itself, at the end
    assert (found.rung, found.clearance, found.depth) == (NOT_AT_ALL, 0.0, DEEPEST)
    t0, t1, u0, u1, v0, v1 = found.box
    assert (t0 <= 1 <= t1, u0 <= 0.5 <= u1, v0 <= 0.5 <= v1) == (True, True, True)
    assert t1 - t0 < 1e-3


def test_one_look_is_all_that_is_taken_where_no_more_is_allowed() -> None:
    found = answer(PAIR, BAR, BAR, ACROSS + UP, ACROSS - UP, boxes=1)
    assert (found.rung, found.depth) == (NOT_AT_ALL, 0)
    assert found.box[0] == 0.0


def test_a_loop_meets_itself_once_as_it_comes_from_below_the_plane() -> None:
    """One end of the loop moves through the other: pushed out of its plane by ± z along the curve."""
    twist = np.array([[0.0, 0, -1], [0, 0, -1], [0, 0, 1], [0, 0, 1]])
    found = answer(SELF, LOOP + 0.2 * twist, LOOP - 0.2 * twist, LOOP, LOOP)
    assert found.rung == BY_MEETING
    (t, u, v, _, sign) = found.meetings[0].tolist()
    assert len(found.meetings) == 1
    assert t == pytest.approx(0.5, abs=1e-14)
    # x(u) = x(1 - u) where 10u² - 10u + 1 = 0
    assert (u, v) == pytest.approx(((5 - np.sqrt(15)) / 10, (5 + np.sqrt(15)) / 10), abs=1e-13)
    back = answer(SELF, LOOP - 0.2 * twist, LOOP + 0.2 * twist, LOOP, LOOP)
    assert back.meetings[0, 4] == -sign


@pytest.mark.parametrize(("width", "is_open"), [(0.99, False), (1.01, True)])
def test_a_cusp_is_left_open_and_what_nearly_has_one_is_certified(width: float, is_open: bool) -> None:
    """The cubic (0,0) (w,1) (1-w,1) (1,0) has a cusp at w = 1, beyond which it is a loop; it stops short, or not."""

    def cubic(w: float) -> Points:
        return np.array([[0.0, 0, 0], [w, 1, 0], [1 - w, 1, 0], [1, 0, 0]])

    found = answer(SELF, cubic(1 / 3), cubic(width), LOOP, LOOP)
    assert (found.rung == NOT_AT_ALL) is is_open
    if is_open:
        assert found.box[2] - 1e-3 <= 0.5 <= found.box[5] + 1e-3


@pytest.mark.parametrize(("turn", "is_open"), [(0.0, True), (1e-6, False), (0.1, False)])
def test_a_joint_that_folds_back_is_left_open(turn: float, is_open: bool) -> None:
    a, b = np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[1.0, 0, 0], [0, turn, 0]])
    assert (answer(JOINT, a, a, b, b).rung == NOT_AT_ALL) is is_open


def test_a_joint_s_segments_can_pass_elsewhere() -> None:
    """Two quarter turns that join, the far end of one swept through the other."""
    a = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0]])
    b0 = np.array([[2.0, 2, 0], [2, 4, 0.5], [1, -1, 1]])
    b1 = np.array([[2.0, 2, 0], [2, 4, 0.5], [1, -1, -2]])
    found = answer(JOINT, a, a, b0, b1)
    assert found.rung == BY_MEETING
    assert len(found.meetings) == 1
    assert 0 < found.meetings[0, 0] < 1


def random_pair(seed: int) -> list[Points]:
    random = np.random.default_rng(seed)
    a0, b0 = random.normal(size=(2, 4, 3))
    return [a0, a0 + 0.4 * random.normal(size=(4, 3)), b0, b0 + 0.4 * random.normal(size=(4, 3))]


@pytest.mark.parametrize("seed", range(12))
def test_an_answer_does_not_depend_on_who_looks(seed: int) -> None:
    points = random_pair(seed)
    found = pair(*points)
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    moved = pair(*(x @ turn + [20.0, -3.0, 5.0] for x in points))
    larger = pair(*(64.0 * x for x in points))
    swapped = pair(points[2], points[3], points[0], points[1])
    for other, columns in ((moved, [0, 1, 2, 4]), (larger, [0, 1, 2, 4]), (swapped, [0, 2, 1, 4])):
        assert (other.rung == NOT_AT_ALL) == (found.rung == NOT_AT_ALL)
        here = sorted(found.meetings[:, [0, 1, 2, 4]].tolist())
        assert np.array(sorted(other.meetings[:, columns].tolist())) == pytest.approx(np.array(here), abs=1e-9)
    assert larger.clearance == pytest.approx(64.0 * found.clearance, rel=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_no_clearance_is_above_the_sampled_distance(seed: int) -> None:
    points = random_pair(seed)
    found = pair(*points)
    u = np.linspace(0, 1, 33)
    basis = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3], axis=1)
    least = np.inf
    for t in np.linspace(0, 1, 17):
        a, b = ((1 - t) * points[k] + t * points[k + 1] for k in (0, 2))
        least = min(least, float(np.linalg.norm((basis @ a)[:, None] - (basis @ b)[None], axis=2).min()))
    assert found.clearance <= least + 1e-12
    assert found.clearance >= 0.0


def test_slack_turns_a_certificate_into_doubt_and_no_crossing_into_none() -> None:
    near = pair(BAR, BAR, ACROSS + UP * 0.1, ACROSS + UP * 0.1)
    assert near.rung == BY_MOTION
    assert pair(BAR, BAR, ACROSS + UP * 0.1, ACROSS + UP * 0.1, slack=0.049).clearance == pytest.approx(0.002, abs=1e-9)
    assert pair(BAR, BAR, ACROSS + UP * 0.1, ACROSS + UP * 0.1, slack=0.051).rung == NOT_AT_ALL


# --- the list of meetings ---------------------------------------------------------------------------------------------

BOX = np.array([0.4, 0.6, 0.4, 0.6, 0.4, 0.6])


@pytest.mark.parametrize(("radius", "inside"), [(0.1001, True), (0.0999, False)])
def test_a_box_is_inside_the_cube_of_a_meeting_or_not(radius: float, inside: bool) -> None:
    meetings = np.array([[0.9, 0.9, 0.9, 0.05, 1], [0.5, 0.5, 0.5, radius, 1]])
    assert is_inside(BOX, meetings, 2) is inside
    assert is_inside(BOX, meetings, 1) is False


def test_a_meeting_is_kept_once_and_in_order_of_its_parameters() -> None:
    meetings = np.empty((4, 5))
    assert keep_meeting(meetings, 0, (0.5, 0.8, 0.2), 0.1, -1, SELF) == 1
    assert meetings[0].tolist() == [0.5, 0.2, 0.8, 0.1, -1]
    assert keep_meeting(meetings, 1, (0.5, 0.21, 0.8), 0.01, -1, SELF) == 1  # within the cube of the first
    assert keep_meeting(meetings, 1, (0.5, 0.4, 0.8), 0.01, -1, SELF) == 2
    assert keep_meeting(meetings, 2, (0.5, 0.8, 0.2), 0.01, 1, PAIR) == 3  # of two segments it is another
    assert keep_meeting(meetings, 3, (0.5, 0.8, 0.2), 0.05, 1, PAIR) == 3
    assert meetings[2, 3] == 0.05, "the same place, and a larger cube"
