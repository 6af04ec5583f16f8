"""What a run comes to, while it runs and in the end."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdtopo.alerts import count_steps
from mdtopo.records import (
    CurveCounts,
    Grade,
    MonitorConfig,
    RunSummary,
    RunVerdict,
    Severity,
    StepCounts,
    StepTable,
    Strands,
    Verdict,
    run_verdict,
)
from mdtopo.typing import Indices, Ratios


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run has come: steps done, steps in all (None for a stream), alerts so far, what these are called."""

    steps: int
    total: int | None
    alerts: int
    noun: str = "alert"


@dataclass(slots=True)
class Tally:
    """What a run has come to so far; with its strands it can name the closest pair."""

    config: MonitorConfig
    strands: Strands | None = None
    counts: StepCounts = field(default_factory=StepCounts)
    crossings: Counter[Grade] = field(default_factory=Counter)
    n_fractures: int = 0
    alerts: Counter[Severity] = field(default_factory=Counter)
    clearance: tuple[float, int] = (np.nan, -1)
    closest: str = ""
    ratio: tuple[float, int] = (np.nan, -1)
    curve: CurveCounts = field(default_factory=CurveCounts)

    def add(self, table: StepTable) -> None:
        """Count the steps of a table."""
        self.counts += count_steps(table, self.config)
        self.crossings.update(Grade(grade) for grade in table.crossings.grade.tolist())
        self.n_fractures += len(table.broken)
        proved = np.where(table.verdict == Verdict.CERTIFIED, table.clearance, np.nan)
        before, self.clearance = self.clearance, _extreme(self.clearance, -proved, table.first_step, sign=-1.0)
        if self.clearance[1] != before[1]:
            self.closest = self._in_words(table.clearance_pair[self.clearance[1] - table.first_step])
        if self.config.curve != "none":
            self.curve += CurveCounts.of(
                table.curve_verdict, table.curve_depth, table.curve_clearance, table.curve_crossings, table.first_step
            )
        self.ratio = _extreme(self.ratio, table.pair_ratio, table.first_step, sign=1.0)

    def _in_words(self, pair: Indices) -> str:
        if self.strands is None or (pair < 0).any():
            return ""
        return self.strands.describe_pair(pair, "and")

    def summary(self, results: Path | None, stopped: str) -> RunSummary:
        """Return the summary of the run."""
        warnings = self.alerts[Severity.WARNING] + self.alerts[Severity.CRITICAL]
        verdict = run_verdict(self.counts, self.crossings, self.n_fractures, warnings)
        if stopped and verdict in (RunVerdict.PASS, RunVerdict.WARN):
            verdict = RunVerdict.UNPROVEN  # nobody saw the rest
        alerts = {severity: self.alerts[severity] for severity in Severity}
        crossings = {grade: self.crossings[grade] for grade in Grade}
        return RunSummary(
            verdict,
            self.counts,
            crossings,
            self.n_fractures,
            alerts,
            *self.clearance,
            *self.ratio,
            results,
            stopped,
            curve=None if self.config.curve == "none" else self.curve,
            closest=self.closest,
        )


def _extreme(best: tuple[float, int], values: Ratios, first_step: int, *, sign: float) -> tuple[float, int]:
    """Return the better of the best so far and the greatest of `values`, as (sign x value, step)."""
    if not len(values) or np.isnan(values).all():
        return best
    row = int(np.nanargmax(values))
    if best[1] >= 0 and sign * best[0] >= values[row]:
        return best
    return sign * float(values[row]), first_step + row
