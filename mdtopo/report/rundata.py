"""A results file as the report reads it: the state of every step, and the summary, also of a run that has not ended."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import InputError
from mdtopo.records import (
    AlertKind,
    CurveCounts,
    Grade,
    MonitorConfig,
    RunSummary,
    RunVerdict,
    Severity,
    Verdict,
    run_verdict,
)
from mdtopo.states import CRITERION_COLUMN, counts_of, step_states
from mdtopo.store import Results
from mdtopo.typing import Codes, Times

NEEDED = (
    "frame_t0",
    "frame_t1",
    "time_t0",
    "time_t1",
    "displacement_max",
    "nu",
    "nu_ratio",
    "pair_ratio",
    "pair_ratio_pair",
    "nu_pair",
    "clearance",
    "clearance_pair",
    "clearance_local",
    "clearance_local_pair",
    "clearance_self",
    "clearance_self_pair",
    "clearance_inter",
    "clearance_inter_pair",
    "bond_stretch",
    "bond_stretch_edge",
    "certifiable_interval",
    "verdict",
    "scope",
    "rung",
    "reason",
    "image_jumps",
)
"""Step columns that a report is made of."""

CURVE_COLUMNS = (
    "curve_verdict",
    "curve_depth",
    "curve_clearance",
    "curve_clearance_pair",
    "curve_place",
)
"""Step columns of the smooth curve, which a report shows where the file has them."""


@dataclass(frozen=True, slots=True, eq=False)
class RunData:
    """One run, ready to be shown.

    Attributes
    ----------
    path : Path
        The results file.
    results : Results
        What it holds.
    config : MonitorConfig
        The knobs of the run.
    states : ndarray of int8, shape (n_steps,)
        The `StepState` of each step.
    summary : RunSummary
        Worked out again from the columns, so that it exists for a run without an end too.
    """

    path: Path
    results: Results
    config: MonitorConfig
    states: Codes
    summary: RunSummary

    @classmethod
    def of(cls, path: Path, results: Results) -> "RunData":
        """Return the run of a results file.

        Raises
        ------
        InputError
            If a column is missing that a report needs, as in a file of an older mdtopo.
        """
        missing = [name for name in NEEDED if name not in results.steps]
        if missing:
            raise InputError(
                f"{path} has no step column {missing[0]!r}, so an older mdtopo wrote it; run 'mdtopo monitor' again."
            )
        config = MonitorConfig.from_mapping(results.config)
        steps = results.steps
        states = step_states(steps["verdict"], steps["rung"], steps[CRITERION_COLUMN[config.criterion]], config)
        summary = _summary(path, results, states)
        return cls(path, results, config, states, summary)

    @property
    def in_progress(self) -> bool:
        """Whether these are the finished parts of a run that has not ended."""
        return self.results.in_progress

    @property
    def has_curve(self) -> bool:
        """Whether the run looked at the smooth curve."""
        return self.summary.curve is not None

    @property
    def n_steps(self) -> int:
        """Number of steps in the file."""
        return len(self.states)

    @property
    def columns(self) -> Any:
        """The step columns by name."""
        return self.results.steps

    @property
    def has_times(self) -> bool:
        """Whether every step has a time, and times rise."""
        start, end = self.columns["time_t0"], self.columns["time_t1"]
        return bool(self.n_steps and np.isfinite(start).all() and np.isfinite(end).all() and (end > start).all())

    @property
    def spacing(self) -> float:
        """Median time between the frames of a step, ps; NaN where there is none."""
        gaps: Times = self.columns["time_t1"] - self.columns["time_t0"]
        known = gaps[np.isfinite(gaps) & (gaps > 0.0)]
        return float(np.median(known)) if len(known) else float("nan")

    def row(self, step: int) -> int:
        """Return the row of a step."""
        return step - self.results.first_step


def _summary(path: Path, results: Results, states: Codes) -> RunSummary:
    steps, counts = results.steps, counts_of(states)
    grades = Counter(Grade(grade) for grade in results.crossings.grade.tolist())
    severities = Counter(alert.severity for alert in results.alerts)
    n_warnings = severities[Severity.WARNING] + severities[Severity.CRITICAL]
    verdict = run_verdict(counts, grades, len(results.broken), n_warnings)
    if not results.complete and verdict in (RunVerdict.PASS, RunVerdict.WARN):
        verdict = RunVerdict.UNPROVEN  # nobody saw the rest
    proved = np.where(steps["verdict"] == Verdict.CERTIFIED, steps["clearance"], np.nan)
    return RunSummary(
        verdict=verdict,
        counts=counts,
        crossings={grade: grades[grade] for grade in Grade},
        n_fractures=len(results.broken),
        alerts={severity: severities[severity] for severity in Severity},
        **_extreme("clearance", -proved, results.first_step, -1.0),
        **_extreme("ratio", steps["pair_ratio"], results.first_step, 1.0),
        results=path,
        curve=_curve_counts(results),
        stopped=str(results.summary.get("stopped", "")),
    )


def _curve_counts(results: Results) -> CurveCounts | None:
    """Return what was found of the curve; None where the run did not look at it, or its version could not."""
    steps = results.steps
    if results.config.get("curve", "none") == "none" or "curve_verdict" not in steps:
        return None
    verdict, depth, clearance = (steps[f"curve_{name}"] for name in ("verdict", "depth", "clearance"))
    return CurveCounts.of(verdict, depth, clearance, results.curve_crossings, results.first_step)


def _extreme(name: str, values: NDArray[np.float64], first_step: int, sign: float) -> dict[str, Any]:
    if not len(values) or np.isnan(values).all():
        return {name: float("nan"), f"{name}_step": -1}
    row = int(np.nanargmax(values))
    return {name: sign * float(values[row]), f"{name}_step": first_step + row}


WORST_KINDS = (
    AlertKind.CROSSING,
    AlertKind.FRACTURE,
    AlertKind.BAD_DATA,
    AlertKind.UNRESOLVED,
    AlertKind.NEAR_LIMIT,
    AlertKind.STRETCH,
    AlertKind.IMAGE_JUMP,
    AlertKind.GAP,
)
"""Kinds of alerts in falling order of concern."""
