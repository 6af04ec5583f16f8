"""What a run finds of the smooth curve, in a few numbers; the run's verdict and its five counts are the polyline's."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mdtopo.records.crossings import Crossings, Grade
from mdtopo.records.steps import CurveVerdict
from mdtopo.typing import Codes, Indices, Lengths


@dataclass(frozen=True, slots=True)
class CurveCounts:
    """How the steps of a run ended for the smooth curve; the first, third and fourth add up to the number of steps.

    Attributes
    ----------
    certified : int
        Proved: the curve never meets itself.
    flat : int
        Those of them that hulls alone prove, without halving.
    unresolved : int
        Not decided.
    crossed : int
        With a crossing of the curve.
    crossings : mapping of Grade to int
        How many crossings of the curve were found.
    clearance, clearance_step : float, int
        Least proven clearance of the curve, Å, and the step that holds it; NaN and -1 where no step was proved.
    """

    certified: int = 0
    flat: int = 0
    unresolved: int = 0
    crossed: int = 0
    crossings: Mapping[Grade, int] = field(default_factory=lambda: dict.fromkeys(Grade, 0))
    clearance: float = math.nan
    clearance_step: int = -1

    @property
    def steps(self) -> int:
        """Number of steps."""
        return self.certified + self.unresolved + self.crossed

    @classmethod
    def of(
        cls, verdict: Codes, depth: Indices, clearance: Lengths, crossings: Crossings, first_step: int
    ) -> "CurveCounts":
        """Return the counts of consecutive steps.

        Parameters
        ----------
        verdict, depth, clearance : ndarray, shape (n,)
            The step columns ``curve_verdict``, ``curve_depth`` and ``curve_clearance``.
        crossings : Crossings
            Of the curve.
        first_step : int
            The step of row 0.
        """
        certified = verdict == CurveVerdict.CERTIFIED
        grades = Counter(crossings.grade.tolist())
        proved = np.where(certified & ~np.isnan(clearance), clearance, np.inf)
        row = int(proved.argmin()) if np.isfinite(proved).any() else -1
        return cls(
            certified=int(certified.sum()),
            flat=int((certified & (depth == 0)).sum()),
            unresolved=int((verdict == CurveVerdict.UNRESOLVED).sum()),
            crossed=int((verdict == CurveVerdict.CROSSING).sum()),
            crossings={grade: grades[grade] for grade in Grade},
            clearance=float(proved[row]) if row >= 0 else math.nan,
            clearance_step=first_step + row if row >= 0 else -1,
        )

    def __add__(self, later: "CurveCounts") -> "CurveCounts":
        nearer = self if not later.clearance < self.clearance and self.clearance_step >= 0 else later
        return CurveCounts(
            certified=self.certified + later.certified,
            flat=self.flat + later.flat,
            unresolved=self.unresolved + later.unresolved,
            crossed=self.crossed + later.crossed,
            crossings={grade: self.crossings[grade] + later.crossings[grade] for grade in Grade},
            clearance=nearer.clearance,
            clearance_step=nearer.clearance_step,
        )

    def to_mapping(self) -> dict[str, Any]:
        """Return the numbers as plain values, ready for JSON; NaN becomes None."""
        return {
            "certified": self.certified,
            "flat": self.flat,
            "unresolved": self.unresolved,
            "crossed": self.crossed,
            "crossings": {grade.name.lower(): count for grade, count in self.crossings.items()},
            "clearance": self.clearance if math.isfinite(self.clearance) else None,
            "clearance_step": self.clearance_step,
        }

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> "CurveCounts":
        """Return the counts that `to_mapping` has made plain."""
        clearance = values["clearance"]
        return cls(
            **{name: int(values[name]) for name in ("certified", "flat", "unresolved", "crossed", "clearance_step")},
            crossings={grade: int(values["crossings"].get(grade.name.lower(), 0)) for grade in Grade},
            clearance=math.nan if clearance is None else float(clearance),
        )
