"""What a whole run comes to: the counts, and the verdict in one word."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import IntEnum, StrEnum
from html import escape
from pathlib import Path
from typing import Any

from mdtopo.records.alerts import Severity
from mdtopo.records.crossings import Grade
from mdtopo.records.curvecounts import CurveCounts


class RunVerdict(StrEnum):
    """The headline of a run."""

    PASS = "PASS"
    WARN = "WARN"
    UNPROVEN = "UNPROVEN"
    FAIL = "FAIL"


class StepState(IntEnum):
    """How a step ended, in rising order of concern; `StepCounts` says what each means."""

    BALL = 0
    PAIRS = 1
    NEAR_LIMIT = 2
    UNRESOLVED = 3
    CROSSED = 4


@dataclass(frozen=True, slots=True)
class StepCounts:
    """How the steps of a run ended; the five counts add up to the number of steps.

    Attributes
    ----------
    ball : int
        Proved by a ball rung: 0, the paper's comparison of displacement and separation, or 1, its two-frame form; not
        near the limit.
    pairs : int
        Proved pair by pair, not near the limit.
    near_limit : int
        Proved, but near the limit.
    unresolved : int
        Not decided.
    crossed : int
        With a crossing of the straight paths.
    """

    ball: int = 0
    pairs: int = 0
    near_limit: int = 0
    unresolved: int = 0
    crossed: int = 0

    @property
    def steps(self) -> int:
        """Number of steps."""
        return self.ball + self.pairs + self.near_limit + self.unresolved + self.crossed

    def __add__(self, other: "StepCounts") -> "StepCounts":
        return StepCounts(
            self.ball + other.ball,
            self.pairs + other.pairs,
            self.near_limit + other.near_limit,
            self.unresolved + other.unresolved,
            self.crossed + other.crossed,
        )


@dataclass(frozen=True, slots=True)
class RunSummary:
    """What a run found, in a few numbers.

    Attributes
    ----------
    verdict : RunVerdict
        PASS (every step proved), WARN (proved, with near-limit steps or stretched edges), UNPROVEN (some steps are
        undecided, or sampled too coarsely to tell a passage from a detour, or there was none), FAIL (a proven or
        resolved crossing, or a fracture).
    counts : StepCounts
        The five counts.
    crossings : mapping of Grade to int
        How many crossings of the polyline were found.
    n_fractures : int
        Edges that broke.
    alerts : mapping of Severity to int
        How many alerts were raised.
    clearance, clearance_step : float, int
        Least proven clearance, Å, and the step that holds it; NaN and -1 where no step was proved.
    ratio, ratio_step : float, int
        Greatest pair ratio, and its step; NaN and -1 where no step was measured.
    results : Path or None
        The results file.
    stopped : str
        Why the run ended before its last frame, in words; empty where it did not.
    checkpoint : str
        Why the run was put down, so that the same command goes on with it; empty where it was not.
    curve : CurveCounts or None
        What was found of the smooth curve, which the verdict and the five counts are not about; None where it was not
        looked at.
    closest : str
        The two edges or vertices that hold the least clearance, in words; empty where that is not known. It is not
        stored, because the step's columns hold it.
    """

    verdict: RunVerdict
    counts: StepCounts
    crossings: Mapping[Grade, int]
    n_fractures: int
    alerts: Mapping[Severity, int]
    clearance: float
    clearance_step: int
    ratio: float
    ratio_step: int
    results: Path | None = None
    stopped: str = ""
    checkpoint: str = ""
    curve: CurveCounts | None = None
    closest: str = field(default="", compare=False)

    @property
    def n_steps(self) -> int:
        """Number of steps."""
        return self.counts.steps

    def _repr_html_(self) -> str:
        """Return the summary as a table for a notebook; texts are escaped."""
        rows: dict[str, object] = {"verdict": self.verdict.value, "steps": self.n_steps, **asdict(self.counts)}
        rows |= {f"{grade.name.lower()} crossings": count for grade, count in self.crossings.items() if count}
        rows |= {"broken edges": self.n_fractures, "least clearance (Å)": f"{self.clearance:.4g}"}
        if self.curve is not None:
            numbers = asdict(self.curve)
            rows |= {f"curve {name}": numbers[name] for name in ("certified", "unresolved", "crossed")}
        rows |= {"results": self.results or "not stored", **({"stopped": self.stopped} if self.stopped else {})}
        cells = (f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in rows.items())
        return f"<table><caption>mdtopo run</caption>{''.join(cells)}</table>"

    def to_mapping(self) -> dict[str, Any]:
        """Return the numbers as plain values, ready for JSON; NaN and infinity become None."""

        def finite(value: float) -> float | None:
            """Return the number, None where JSON has none."""
            return value if math.isfinite(value) else None

        return {
            "verdict": self.verdict.value,
            "counts": asdict(self.counts),
            "n_steps": self.n_steps,
            "crossings": {grade.name.lower(): count for grade, count in self.crossings.items()},
            "n_fractures": self.n_fractures,
            "alerts": {severity.name.lower(): count for severity, count in self.alerts.items()},
            "clearance": finite(self.clearance),
            "clearance_step": self.clearance_step,
            "ratio": finite(self.ratio),
            "ratio_step": self.ratio_step,
            "stopped": self.stopped,
            "curve": None if self.curve is None else self.curve.to_mapping(),
        }

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], *, results: Path | None = None) -> "RunSummary":
        """Return the summary that `to_mapping` has made plain."""

        def number(value: float | None) -> float:
            """Return the number, NaN for None."""
            return math.nan if value is None else float(value)

        return cls(
            verdict=RunVerdict(values["verdict"]),
            counts=StepCounts(**values["counts"]),
            crossings={grade: int(values["crossings"].get(grade.name.lower(), 0)) for grade in Grade},
            n_fractures=int(values["n_fractures"]),
            alerts={severity: int(values["alerts"].get(severity.name.lower(), 0)) for severity in Severity},
            clearance=number(values["clearance"]),
            clearance_step=int(values["clearance_step"]),
            ratio=number(values["ratio"]),
            ratio_step=int(values["ratio_step"]),
            results=results,
            stopped=str(values.get("stopped", "")),
            curve=None if values.get("curve") is None else CurveCounts.from_mapping(values["curve"]),
        )


def run_verdict(counts: StepCounts, crossings: Mapping[Grade, int], n_fractures: int, n_warnings: int) -> RunVerdict:
    """Return the headline of a run from its counts; a run without a single step proves nothing.

    A crossing between frames that are too far apart may be a detour: it leaves the run unproven, and fails nothing.
    """
    if crossings.get(Grade.PROVEN, 0) or crossings.get(Grade.RESOLVED, 0) or n_fractures:
        return RunVerdict.FAIL
    if counts.crossed or counts.unresolved or not counts.steps:
        return RunVerdict.UNPROVEN
    if counts.near_limit or n_warnings:
        return RunVerdict.WARN
    return RunVerdict.PASS
