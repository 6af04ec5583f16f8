"""The smooth curve's columns and crossings in the step table, beside the polyline's."""

from collections import Counter
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.curveblocks import KINDS, SINGLE, CurveColumns, Segments, control_points, measure_curves
from mdtopo.errors import StrandError
from mdtopo.geometry.curvemeeting import place_in_space
from mdtopo.geometry.splines import HIGHEST_DEGREE
from mdtopo.passages import Decided, Meeting, StepData, crossing_table, meeting_of
from mdtopo.planning import BlockPlan, Stretch
from mdtopo.records import Crossings, CurveVerdict, MonitorConfig, Reason, Shape, Strands, Traces
from mdtopo.steprows import StepRows
from mdtopo.typing import BezierPoints, Codes, Flags, Indices


def refuse_long_strands(strands: Strands, curve: str) -> None:
    """Refuse strands that the chosen curve cannot go through, by name.

    Raises
    ------
    StrandError
        If one Bezier curve is asked for on more vertices than such a curve is good for.
    """
    if curve == "none" or KINDS[curve] != SINGLE:
        return
    lengths = np.diff(strands.offsets)
    for s in np.flatnonzero(lengths - ~strands.closed > HIGHEST_DEGREE):
        raise StrandError(
            f"Strand {strands.names[s]!r} has {lengths[s]} vertices; one Bezier curve on its vertices can have the "
            f"degree {HIGHEST_DEGREE} at most. Choose a spline, such as --curve interpolating."
        )


@dataclass(slots=True, eq=False)
class CurveRows:
    """What is known of the curve in the steps of a block, filled part by part.

    Attributes
    ----------
    kind : str
        The curve; 'none' where it is not looked at.
    columns : CurveColumns
    folds : ndarray of bool, shape (n,)
        Whether the first check that stayed open is within a segment, or at a joint.
    segment, pair : ndarray of int, shape (n, 2) and (n, 2, 2)
        The segments of the columns `d_star_segment` and `pair`, by the edges that they go with.
    crossings : list of Crossings
    """

    kind: str
    columns: CurveColumns
    folds: Flags
    segment: Indices
    pair: Indices
    crossings: list[Crossings] = field(default_factory=list)

    @classmethod
    def empty(cls, n: int, kind: str) -> "CurveRows":
        """Return rows for n steps, of which none has been measured."""
        if kind == "none":
            return _blank(n)
        none = np.full((n, 2, 2), -1, dtype=np.int64)
        return cls(kind, CurveColumns.empty(n), np.zeros(n, dtype=np.bool_), none[:, 0].copy(), none)

    def measure(
        self,
        plan: BlockPlan,
        part: Stretch,
        rows: StepRows,
        rotations: NDArray[np.float64],
        strands: Strands,
        config: MonitorConfig,
    ) -> None:
        """Measure the curve in the steps of one part that the polyline could be measured in (`rows`)."""
        if self.kind == "none":
            return
        t, rigid, periodic = part.traces, config.motion == "rigid", plan.block.cells is not None
        segments = Segments.of(t, self.kind)
        columns = CurveColumns._make(array[part.steps] for array in self.columns)
        starts, found = measure_curves(
            part.frames,
            ~np.isnan(rows["displacement_max"]) & rows["cell_ok"],
            periodic,
            rigid,
            rotations,
            t.vertices,
            t.offsets,
            t.closed,
            segments.following,
            segments.kind,
            segments.degree,
            segments.error,
            segments.amplification,
            columns,
        )
        self._name(part, segments, columns)
        for k in np.flatnonzero(starts[1:] > starts[:-1]):
            step = StepData(plan, part, int(k), rotations[k], rigid)
            passages = _passages(found[starts[k] : starts[k + 1]], step, t, segments)
            changed = linked_anew(passages, t) if columns.n_open[k] == 0 and columns.countable[k] else set()
            row = part.steps.start + int(k)
            decided = Decided(passages, np.empty((0, 6), dtype=np.int64), Reason.NONE)
            number, frames = plan.block.first_step + row, plan.block.frames[row : row + 2]
            self.crossings.append(
                crossing_table(
                    decided, step, t, changed, number, frames, strands, config.resolution_length, Shape.CURVE
                )
            )

    def _name(self, part: Stretch, segments: Segments, columns: CurveColumns) -> None:
        """Say segments by the edges that they go with."""
        if not len(segments.ends):
            return
        steps, (i, j) = part.steps, columns.pair.T
        known = columns.d_star_segment >= 0
        self.segment[steps][known] = segments.ends[columns.d_star_segment[known]]
        known = (i >= 0) & (j >= 0)
        self.pair[steps][known] = segments.ends[columns.pair[known]]
        self.folds[steps] = known & ((i == j) | (segments.following[i] == j) | (segments.following[j] == i))

    def values(self, first_step: int, reasons: Codes) -> dict[str, Any]:
        """Return the fields of a `StepTable` that are about the curve.

        Parameters
        ----------
        first_step : int
            Of the block.
        reasons : ndarray of int8, shape (n,)
            Why the polyline is UNRESOLVED; it stands for the curve too where neither could be measured.
        """
        if self.kind == "none":
            return _nothing(len(self.folds))
        c = self.columns
        crossings = Crossings.joined(self.crossings)
        count = np.bincount(crossings.step - first_step, minlength=len(c.n_open)).astype(np.int64)
        verdict, reason = self._verdicts(count, reasons)
        return {
            "curve_crossings": crossings,
            "curve_d_star": _finite(c.d_star),
            "curve_d_star_segment": self.segment,
            "curve_bezier_ratio": c.bezier_ratio,
            "curve_bezier_margin": _finite(c.bezier_margin),
            "curve_printed_ratio": c.printed_ratio,
            "curve_clearance": _finite(c.clearance),
            "curve_clearance_pair": self.pair,
            "curve_verdict": verdict,
            "curve_rung": c.rung.astype(np.int8),
            "curve_depth": c.depth,
            "curve_reason": reason,
            "curve_place": c.place.reshape(-1, 3, 2),
            "curve_n_crossings": count,
        }

    def _verdicts(self, n_crossings: Indices, reasons: Codes) -> tuple[Codes, Codes]:
        """Return verdict and reason of each step; CERTIFIED only where the kernel ran and every check was settled."""
        c = self.columns
        measured = c.n_open >= 0
        certified = (c.n_open == 0) & c.countable & (n_crossings == 0)
        verdict = np.where(certified, CurveVerdict.CERTIFIED, CurveVerdict.UNRESOLVED).astype(np.int8)
        verdict[n_crossings > 0] = CurveVerdict.CROSSING
        reason = np.where(self.folds, Reason.FOLD, Reason.LADDER).astype(np.int8)
        reason[~c.countable] = Reason.CELL
        reason[~measured] = reasons[~measured]
        reason[verdict != CurveVerdict.UNRESOLVED] = Reason.NONE
        return verdict, reason


@lru_cache(maxsize=8)
def _blank(n: int) -> CurveRows:
    """Return rows that are never filled."""
    return replace(CurveRows.empty(n, "interpolating"), kind="none")


@lru_cache(maxsize=8)
def _nothing(n: int) -> dict[str, Any]:
    """Return the fields of a table of n steps in which no curve was looked at; nobody may write to them."""
    rows = CurveRows.empty(n, "interpolating")
    values = rows.values(0, np.zeros(n, dtype=np.int8))
    values["curve_verdict"][:] = CurveVerdict.NONE
    for array in values.values():
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    return values


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values, NaN in the place of the infinity that stands for "there is none"."""
    return np.where(np.isposinf(values), np.nan, values)


def _passages(found: NDArray[np.float64], step: StepData, traces: Traces, segments: Segments) -> NDArray[np.float64]:
    """Return the rows of `mdtopo.contacts.Found` that say the passages of a curve, by the edges that they go with."""
    ends = [_controls(x, traces, segments) for x in (step.motion.x0, step.motion.x1)]
    rows = np.empty((len(found), 14))
    for row, one in zip(rows, found, strict=True):
        i, j, t, u = int(one[0]), int(one[1]), float(one[5]), float(one[6])
        (row[0], row[6]), (row[1], row[7]) = segments.place(i, u), segments.place(j, float(one[7]))
        row[2:6] = one[2:6]
        row[8:11] = place_in_space(ends[0][i], ends[1][i], t, u)
        row[11:14] = one[8:11]
    return rows


def _controls(x: NDArray[np.float64], traces: Traces, segments: Segments) -> BezierPoints:
    t, m = traces, len(segments.following)
    points: BezierPoints = control_points(x, t.vertices, t.offsets, t.closed, segments.kind, m, segments.degree)
    return points


def linked_anew(passages: NDArray[np.float64], traces: Traces) -> set[Meeting]:
    """Return the pairs of closed traces, with the image of the second, whose linking number differs between the frames.

    Guarantee
    ---------
    Proven, where all passages of the curve in the step are known: their signs add up to its change.
    """
    sums = Counter[Meeting]()
    for row in passages:
        meeting = meeting_of(row, traces)
        a, b, image = meeting
        if traces.closed[a] and traces.closed[b] and (a != b or any(image)):
            sums[meeting] += int(row[11])
    return {meeting for meeting, total in sums.items() if total}
