"""The judge itself: it accepts what is right, finds each kind of fault, and its fast part says nothing wrong."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import Passages, pair_passages
from oracles.separation import apart
from soundness.families import FAMILIES, Points
from soundness.judge import complaint, exact_pair, judged_pairs, measured

from mdtopo.records import Crossings, Grade, Shape, StepReport, Strands, Verdict

BARS = Strands.from_lengths([2, 2])
START = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, -1], [0, 1, -1]], dtype=float)
LIFT = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 4], [0, 0, 4]], dtype=float)
"""The second bar rises by 4 from 1 below the first one: it passes at t = 1/4, in the middle of both."""


def crossings(times: list[float], signs: list[int]) -> Crossings:
    n = len(times)
    return replace(
        Crossings.none(),
        step=np.zeros(n, dtype=np.int64),
        frame_t0=np.zeros(n, dtype=np.int64),
        frame_t1=np.ones(n, dtype=np.int64),
        t=np.array(times),
        edges=np.tile(np.array([[0, 1], [2, 3]]), (n, 1, 1)),
        parameters=np.full((n, 2), 0.5),
        point=np.zeros((n, 3)),
        sign=np.array(signs, dtype=np.int64),
        image=np.zeros((n, 3), dtype=np.int64),
        grade=np.full(n, Grade.RESOLVED, dtype=np.int8),
        object=np.full(n, Shape.POLYLINE, dtype=np.int8),
        motion=np.full(n, 4.0),
        resolution=np.full(n, 2.0),
    )


def report(verdict: Verdict, listed: Crossings) -> StepReport:
    table, rows = measured(START[np.newaxis], START[np.newaxis], BARS)
    return replace(table.report(rows[0]), verdict=verdict, crossings=listed, n_crossings=len(listed))


PASSING = exact_pair(START, START + LIFT)
SIGN = PASSING.events[0].sign


@pytest.mark.parametrize(
    ("verdict", "listed", "expected"),
    [
        (Verdict.CROSSING, crossings([0.25], [SIGN]), ""),
        (Verdict.CROSSING, crossings([0.25 + 9e-10], [SIGN]), ""),
        (Verdict.CROSSING, crossings([0.25 + 2e-9], [SIGN]), "false crossing"),
        (Verdict.CROSSING, crossings([0.25], [-SIGN]), "false crossing"),
        (Verdict.CROSSING, crossings([0.25, 0.25], [SIGN, SIGN]), "false crossing"),
        (Verdict.CROSSING, replace(crossings([0.25], [SIGN]), image=np.array([[0, 1, 0]])), "false crossing"),
        (Verdict.CROSSING, replace(crossings([0.25], [SIGN]), edges=np.array([[[1, 0], [2, 3]]])), "false crossing"),
        (Verdict.CROSSING, crossings([], []), "verdict and crossings disagree"),
        (Verdict.CERTIFIED, crossings([], []), "false certificate"),
        (Verdict.UNRESOLVED, crossings([], []), ""),
        (Verdict.UNRESOLVED, crossings([0.3], [SIGN]), "false crossing"),
    ],
)
def test_the_judge_names_what_is_false(verdict: Verdict, listed: Crossings, expected: str) -> None:
    assert complaint(report(verdict, listed), PASSING) == expected


def test_the_judge_misses_a_crossing_that_is_not_listed() -> None:
    later = replace(PASSING.events[0], t_low=PASSING.events[0].t_low * 2, t_high=PASSING.events[0].t_high * 2)
    two = Passages((*PASSING.events, later), ())
    assert complaint(report(Verdict.CROSSING, crossings([0.25], [SIGN])), two) == "missed crossing"
    assert complaint(report(Verdict.UNRESOLVED, crossings([0.25], [SIGN])), two) == ""


def test_the_judge_finds_a_certificate_of_edges_that_touch() -> None:
    touching = exact_pair(START, START + LIFT / 4)
    assert not touching.events
    assert complaint(report(Verdict.CERTIFIED, crossings([], [])), touching) == "false certificate"


def test_a_campaign_counts_a_false_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    def certified(x0: Points, x1: Points, strands: Strands) -> tuple[object, object]:
        table, rows = measured(x0, x0, strands)
        return table, rows

    monkeypatch.setattr("soundness.judge.measured", certified)
    count = judged_pairs(np.stack([START, START]), np.stack([START + LIFT, START - LIFT]), BARS)
    assert (count.steps, count.certified, len(count.false)) == (2, 2, 1)
    assert count.false[0].startswith("false certificate: [['-0x1.0")


@pytest.mark.parametrize("name", FAMILIES)
def test_edges_shown_apart_never_meet(name: str) -> None:
    x0, x1 = FAMILIES[name](np.random.default_rng(3), 400)
    found = [pair_passages(a.reshape(2, 2, 3), b.reshape(2, 2, 3)) for a, b in zip(x0, x1, strict=True)]
    free = np.array([not (p.events or p.contacts) for p in found])
    shown = apart(x0, x1, halvings=4)
    assert not (shown & ~free).any()
    assert shown.sum() >= 0.7 * free.sum()


@pytest.mark.parametrize("gap", [1, 2**-40, 2**-52, 5e-324])
def test_the_least_gap_is_shown_and_a_touch_is_not(gap: float) -> None:
    low = START * np.array([1.0, 1.0, 0.0])
    high = low.copy()
    high[2:, 2] = gap
    shown = apart(np.stack([high, low, high]), np.stack([high, high, -high + 2 * low]))
    np.testing.assert_array_equal(shown, [True, False, False])


def test_cutting_a_step_shows_edges_apart_that_no_one_direction_does() -> None:
    """One bar flies past the end of the other: each short piece has a direction."""
    x0 = np.array([[-1.0, 0, 0], [1, 0, 0], [-0.2, 3, -1], [0.2, 3, 1]])
    x1 = np.array([[-1.0, 0, 0], [1, 0, 0], [4, -3, -1], [4.4, -3, 1]])
    motion = x0[np.newaxis], x1[np.newaxis]
    assert [bool(apart(*motion, halvings=k)[0]) for k in (0, 4)] == [False, True]
