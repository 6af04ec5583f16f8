"""Which of the five counts a step belongs to, on both sides of each limit."""

import numpy as np

from mdtopo.records import MonitorConfig, Rung, StepCounts, StepState, Verdict
from mdtopo.states import counts_of, step_states


def states(verdict: Verdict, rung: Rung, value: float, **knobs: object) -> StepState:
    config = MonitorConfig(**knobs)  # type: ignore[arg-type]
    found = step_states(np.array([verdict], np.int8), np.array([rung], np.int8), np.array([value]), config)
    return StepState(int(found[0]))


def test_each_state_and_its_near_miss() -> None:
    below = np.nextafter(0.8, 0.0)
    assert states(Verdict.CERTIFIED, Rung.TWO_FRAME_BALL, below) is StepState.BALL
    assert states(Verdict.CERTIFIED, Rung.BROAD_PHASE, below) is StepState.PAIRS
    assert states(Verdict.CERTIFIED, Rung.BALL, 0.8) is StepState.NEAR_LIMIT
    assert states(Verdict.CERTIFIED, Rung.BALL, np.nan) is StepState.BALL
    assert states(Verdict.UNRESOLVED, Rung.BALL, 0.9) is StepState.UNRESOLVED
    assert states(Verdict.CROSSING, Rung.BALL, 0.1) is StepState.CROSSED


def test_a_clearance_is_near_from_below() -> None:
    knobs = {"criterion": "clearance", "near_limit": 0.5}
    assert states(Verdict.CERTIFIED, Rung.HULL, 0.5, **knobs) is StepState.NEAR_LIMIT
    assert states(Verdict.CERTIFIED, Rung.HULL, np.nextafter(0.5, 1.0), **knobs) is StepState.PAIRS


def test_the_counts_add_up() -> None:
    every = np.array([0, 1, 1, 2, 4, 3, 4], dtype=np.int8)
    assert counts_of(every) == StepCounts(ball=1, pairs=2, near_limit=1, unresolved=1, crossed=2)
    assert counts_of(every).steps == len(every)
