"""Which of the five counts a step belongs to: proved by ball or by pairs, near the limit, unresolved, or crossed."""

import numpy as np

from mdtopo.records import MonitorConfig, Rung, StepCounts, StepState, Verdict
from mdtopo.typing import Codes, Flags, Ratios

CRITERION_COLUMN = {"pair": "pair_ratio", "nu": "nu_ratio", "clearance": "clearance"}
"""The step column that each near-limit criterion looks at."""


def meets_limit(values: Ratios, config: MonitorConfig) -> Flags:
    """Return where the values of the criterion's column (`CRITERION_COLUMN`) meet the near-limit threshold."""
    near: Flags = values <= config.near_limit if config.criterion == "clearance" else values >= config.near_limit
    return near


def step_states(verdict: Codes, rung: Codes, values: Ratios, config: MonitorConfig) -> Codes:
    """Return the `StepState` of each step, shape (n,).

    Parameters
    ----------
    verdict, rung : ndarray of int8, shape (n,)
        The step columns of these names.
    values : ndarray, shape (n,)
        The column of the near-limit criterion.
    config : MonitorConfig
        Says which criterion, and its limit.
    """
    certified = verdict == Verdict.CERTIFIED
    near = certified & meets_limit(values, config)
    return np.select(
        [verdict == Verdict.CROSSING, ~certified, near, rung <= Rung.TWO_FRAME_BALL],
        [StepState.CROSSED, StepState.UNRESOLVED, StepState.NEAR_LIMIT, StepState.BALL],
        default=StepState.PAIRS,
    ).astype(np.int8)


def counts_of(states: Codes) -> StepCounts:
    """Return how many steps are in each state."""
    numbers = np.bincount(states, minlength=len(StepState))
    return StepCounts(**{state.name.lower(): int(numbers[state]) for state in StepState})
