"""What was measured in each step: columns for a block of steps, and one row as an object."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cache
from html import escape
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.records.crossings import Crossings
from mdtopo.records.profile import Profile
from mdtopo.typing import Codes, Indices, Lengths, Points, Ratios, Times


class Verdict(IntEnum):
    """The answer for one step. Zero is UNRESOLVED, so that memory nobody filled certifies nothing."""

    UNRESOLVED = 0
    CERTIFIED = 1
    CROSSING = 2


class CurveVerdict(IntEnum):
    """The answer for one step of the smooth curve; NONE where no curve was looked at (``curve = "none"``)."""

    NONE = -1
    UNRESOLVED = 0
    CERTIFIED = 1
    CROSSING = 2


class Rung(IntEnum):
    """The rule of the ladder that settled a pair or a step ; OPEN where none did."""

    BALL = 0
    TWO_FRAME_BALL = 1
    BROAD_PHASE = 2
    RELATIVE_MOTION = 3
    DIRECTION = 4
    HULL = 5
    BISECTION = 6
    EXACT = 7
    OPEN = 8


class PairClass(IntEnum):
    """How the two members of a pair lie on their strands; NONE where there is no pair."""

    NONE = -1
    LOCAL = 0
    SELF = 1
    INTER = 2


class Reason(IntEnum):
    """Why a step is UNRESOLVED.

    LADDER: rounding hides the answer. BAD_DATA: a frame is unusable. CELL: images cannot be counted. TOUCH: two edges
    touch without passing. VERTEX: the contact is at a vertex. SLIDING: two edges touch while they are parallel or in
    one plane all the time. FRAME: two edges touch in a frame itself. IMAGE_JUMP: part of a strand jumps by a lattice
    vector. Of the smooth curve alone, FOLD: halving does not end within one segment or at a joint, as at a cusp or a
    fold; LADDER is said where it does not end for two segments that share no point.
    """

    NONE = 0
    LADDER = 1
    BAD_DATA = 2
    CELL = 3
    TOUCH = 4
    VERTEX = 5
    SLIDING = 6
    FRAME = 7
    IMAGE_JUMP = 8
    FOLD = 9


class Scope(IntEnum):
    """What a certificate is about: nothing (there is none), the stored data only, or the motion before rounding too."""

    NONE = 0
    STORED = 1
    MOTION = 2


@dataclass(frozen=True, slots=True)
class Column:
    """Name, unit, meaning and layout of one column of the step table; `enum` where its values are codes."""

    name: str
    unit: str
    description: str
    enum: type[IntEnum] | None
    shape: tuple[int, ...]
    dtype: type[np.generic]


def _column(
    unit: str,
    description: str,
    enum: type[IntEnum] | None = None,
    *,
    shape: tuple[int, ...] = (),
    dtype: type[np.generic] = np.float64,
) -> Any:
    """Return a field whose metadata describe the column: unit, meaning, and the shape and type of one row."""
    kind = np.int8 if enum is not None else dtype
    layout = {"unit": unit, "description": description, "enum": enum, "shape": shape, "dtype": kind}
    return field(metadata=layout)


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Edges that were longer than their stretch limit, one row for each edge and step (at the step's end frame).

    Attributes
    ----------
    step : ndarray of int, shape (m,)
    edge : ndarray of int, shape (m, 2)
        Vertex indices in strand order.
    ratio, limit : ndarray, shape (m,)
        Length over reference length, and the ratio from which on the edge counts as stretched.
    """

    step: Indices
    edge: Indices
    ratio: Ratios
    limit: Ratios

    @classmethod
    @cache
    def none(cls) -> "Stretches":
        """Return a table without rows, the same one every time."""
        empty = np.empty(0, dtype=np.int64)
        return cls(empty, np.empty((0, 2), dtype=np.int64), np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True)
class BrokenEdge:
    """An edge that was beyond its fracture limit for several frames, and is no edge from this step on.

    Attributes
    ----------
    step, frame : int
        The step whose end frame settled it, and that frame. Steps after this one are measured without the edge.
    edge : tuple of int
        Its two vertices, in strand order.
    ratio, limit : float
        Length over reference length in that frame, and the fracture limit as such a ratio.
    """

    step: int
    frame: int
    edge: tuple[int, int]
    ratio: float
    limit: float


@dataclass(frozen=True, slots=True, eq=False)
class StepTable:
    """The columns of consecutive steps, one array each; row i is step ``first_step + i``.

    `crossings` are those of the polyline, which `verdict` and `n_crossings` are about; `curve_crossings` and the
    columns ``curve_…`` are about the smooth curve.

    Field metadata hold the unit and the meaning of each column, as the results file does. Values of steps that could
    not be measured are NaN, and their indices -1. `profile` is what is kept of every vertex, by windows of steps.
    """

    first_step: int
    stretches: Stretches
    broken: tuple[BrokenEdge, ...]
    problems: tuple[str, ...]
    crossings: Crossings
    curve_crossings: Crossings

    frame_t0: Indices = _column("", "frame index at the step's start", dtype=np.int64)
    frame_t1: Indices = _column("", "frame index at the step's end", dtype=np.int64)
    time_t0: Times = _column("ps", "time at the step's start")
    time_t1: Times = _column("ps", "time at the step's end")
    displacement_max: Lengths = _column(
        "Å", "greatest displacement of a vertex, the step's common rigid motion removed"
    )
    displacement_vertex: Indices = _column("", "the vertex that moved most", dtype=np.int64)
    rotation_angle: NDArray[np.float64] = _column("degree", "angle of the rigid motion that was removed")
    translation: Points = _column("Å", "shift of the centroid that was removed, shape (n, 3)", shape=(3,))
    nu: Lengths = _column(
        "Å", "the paper's PL separation ν at the step's start: least distance of disjoint vertices and edges"
    )
    nu_pair: Indices = _column(
        "",
        "the pair that is closest at the start, as [[a, b], [c, d]]; a = b for a vertex, shape (n, 2, 2)",
        shape=(2, 2),
        dtype=np.int64,
    )
    nu_class: Codes = _column("", "class of the pair that is closest at the start", PairClass)
    nu_ratio: Ratios = _column("", "2 x displacement_max over nu: the paper's comparison, limit 1")
    nu_margin: Lengths = _column("Å", "nu/2 - displacement_max")
    pair_ratio: Ratios = _column(
        "", "greatest relative displacement over summed distances of a pair, limit 1 (pairs within reach)"
    )
    pair_ratio_pair: Indices = _column(
        "", "the pair with the greatest pair_ratio, shape (n, 2, 2)", shape=(2, 2), dtype=np.int64
    )
    clearance: Lengths = _column("Å", "proven lower bound on the distance of any tested pair during the step")
    clearance_pair: Indices = _column(
        "", "the pair with the least clearance, shape (n, 2, 2)", shape=(2, 2), dtype=np.int64
    )
    clearance_local: Lengths = _column("Å", "clearance of pairs with one edge between them on their strand")
    clearance_local_pair: Indices = _column("", "the pair that holds it, shape (n, 2, 2)", shape=(2, 2), dtype=np.int64)
    clearance_self: Lengths = _column("Å", "clearance of pairs of one strand that are further apart on it")
    clearance_self_pair: Indices = _column("", "the pair that holds it, shape (n, 2, 2)", shape=(2, 2), dtype=np.int64)
    clearance_inter: Lengths = _column("Å", "clearance of pairs of different strands")
    clearance_inter_pair: Indices = _column("", "the pair that holds it, shape (n, 2, 2)", shape=(2, 2), dtype=np.int64)
    bond_stretch: Ratios = _column("", "greatest edge length over its reference length, at the step's end")
    bond_stretch_edge: Indices = _column(
        "", "the edge that is stretched most, shape (n, 2)", shape=(2,), dtype=np.int64
    )
    certifiable_interval: Times = _column(
        "ps",
        "frame spacing at which pair_ratio would reach 1 if displacements grew in proportion to it (heuristic)",
    )
    verdict: Codes = _column("", "CERTIFIED, CROSSING or UNRESOLVED", Verdict)
    scope: Codes = _column("", "whether a certificate holds for the stored data only, or before rounding too", Scope)
    n_crossings: Indices = _column("", "crossings of the step", dtype=np.int64)
    image_jumps: Indices = _column(
        "", "edges whose stored vector jumps by a lattice vector; strands are made whole all the same", dtype=np.int64
    )
    rung: Codes = _column("", "the costliest rung that a pair of this step needed", Rung)
    reason: Codes = _column("", "why the step is UNRESOLVED", Reason)
    rung_pairs: Indices = _column(
        "",
        "pairs that the broad phase left, by the rung that settles them; the last is open, shape (n, 9)",
        shape=(len(Rung),),
        dtype=np.int64,
    )
    curve_d_star: Lengths = _column(
        "Å", "the paper's d* at the step's start: least distance of zero to the hull of a segment's differences"
    )
    curve_d_star_segment: Indices = _column(
        "", "the segment of the curve that holds it, by its edge, shape (n, 2)", shape=(2,), dtype=np.int64
    )
    curve_bezier_ratio: Ratios = _column(
        "",
        "greatest motion of a difference of control points over d*: the paper's comparison in its sound form, limit 1",
    )
    curve_bezier_margin: Lengths = _column("Å", "least d* less that motion")
    curve_printed_ratio: Ratios = _column(
        "", "greatest motion of a control point over d*: the paper's Prop. 3.2 as printed, which proves below 1/2 only"
    )
    curve_clearance: Lengths = _column("Å", "proven lower bound on the distance of segments that share no point")
    curve_clearance_pair: Indices = _column(
        "",
        "the segments that hold it, or of the first check that stayed open, by their edges, shape (n, 2, 2)",
        shape=(2, 2),
        dtype=np.int64,
    )
    curve_verdict: Codes = _column("", "the curve: CERTIFIED, CROSSING, UNRESOLVED or NONE", CurveVerdict)
    curve_rung: Codes = _column("", "the costliest rung that a check of the curve needed", Rung)
    curve_depth: Indices = _column(
        "", "the most halvings that a check of the curve needed, 0 where hulls alone settle it", dtype=np.int64
    )
    curve_reason: Codes = _column("", "why the curve is UNRESOLVED", Reason)
    curve_place: NDArray[np.float64] = _column(
        "", "where halving gave up first: time, and parameters of the two segments, from and to, shape (n, 3, 2)",
        shape=(3, 2),
    )  # fmt: skip
    curve_n_crossings: Indices = _column("", "crossings of the curve in the step", dtype=np.int64)
    profile: Profile = field(default_factory=Profile.none)

    def __len__(self) -> int:
        return len(self.frame_t0)

    @classmethod
    def empty(cls) -> "StepTable":
        """Return a table without rows."""
        numbers: dict[str, Any] = {c.name: np.empty((0, *c.shape), dtype=c.dtype) for c in cls.columns()}
        return cls(
            first_step=0,
            stretches=Stretches.none(),
            broken=(),
            problems=(),
            crossings=Crossings.none(),
            curve_crossings=Crossings.none(),
            **numbers,
        )

    @classmethod
    def joined(cls, tables: Sequence["StepTable"]) -> "StepTable":
        """Return tables that follow each other as one; a table without rows where there is none."""
        if not tables:
            return cls.empty()
        return cls(
            first_step=tables[0].first_step,
            stretches=Stretches(
                *(np.concatenate([getattr(t.stretches, f.name) for t in tables]) for f in fields(Stretches))
            ),
            broken=tuple(edge for table in tables for edge in table.broken),
            problems=tuple(problem for table in tables for problem in table.problems),
            crossings=Crossings.joined([table.crossings for table in tables]),
            profile=Profile.joined([table.profile for table in tables]),
            curve_crossings=Crossings.joined([table.curve_crossings for table in tables]),
            **{c.name: np.concatenate([getattr(t, c.name) for t in tables]) for c in cls.columns()},
        )

    def moved_to(self, first_step: int) -> "StepTable":
        """Return the same rows under other step numbers."""
        shift = first_step - self.first_step
        return replace(
            self,
            first_step=first_step,
            stretches=replace(self.stretches, step=self.stretches.step + shift),
            broken=tuple(replace(edge, step=edge.step + shift) for edge in self.broken),
            crossings=replace(self.crossings, step=self.crossings.step + shift),
            profile=self.profile.moved_by(shift),
            curve_crossings=replace(self.curve_crossings, step=self.curve_crossings.step + shift),
        )

    @classmethod
    @cache
    def columns(cls) -> tuple[Column, ...]:
        """Return name, unit, meaning and enum of every column, in the order of the results file."""
        return tuple(Column(entry.name, **entry.metadata) for entry in fields(cls) if "unit" in entry.metadata)

    def report(self, row: int) -> "StepReport":
        """Return one row as an object."""
        step, columns = self.first_step + row, self._all_columns()(self)
        values: list[Any] = [column[row].copy() if column.ndim > 1 else column.item(row) for column in columns]
        crossings, curve_crossings = self.crossings.of_step(step), self.curve_crossings.of_step(step)
        return self.report_of(step, self.problems[row], crossings, curve_crossings, values)

    @classmethod
    def report_of(
        cls, step: int, problem: str, crossings: Crossings, curve_crossings: Crossings, values: list[Any]
    ) -> "StepReport":
        """Return a row as an object, given the values of all columns in their order; codes become enum members."""
        for position, members in cls._coded():
            values[position] = members[values[position]]
        return StepReport(step, problem, crossings, curve_crossings, *values)

    @classmethod
    @cache
    def _all_columns(cls) -> Callable[["StepTable"], tuple[NDArray[Any], ...]]:
        """Return what gets all columns of a table at once."""
        return attrgetter(*(column.name for column in cls.columns()))

    @classmethod
    @cache
    def _coded(cls) -> tuple[tuple[int, dict[int, IntEnum]], ...]:
        """Return which columns hold codes, by position, and what the codes stand for."""
        coded = ((position, column.enum) for position, column in enumerate(cls.columns()))
        return tuple((position, {int(member): member for member in enum}) for position, enum in coded if enum)

    def reports(self) -> Iterator["StepReport"]:
        """Yield every row as an object, in step order."""
        return (self.report(row) for row in range(len(self)))


@dataclass(frozen=True, slots=True, eq=False)
class StepReport:
    """What was measured in one step: a row of a `StepTable`, whose field metadata give unit and meaning.

    Attributes
    ----------
    step : int
        0-based; step k is the motion from analysed frame k to the next one.
    problem : str
        What is wrong with one of the step's frames, in words; empty where nothing is.
    crossings : Crossings
        The step's crossings of the polyline, a sequence of `Crossing` in order of time.
    curve_crossings : Crossings
        Those of the smooth curve.
    """

    step: int
    problem: str
    crossings: Crossings
    curve_crossings: Crossings
    frame_t0: int
    frame_t1: int
    time_t0: float
    time_t1: float
    displacement_max: float
    displacement_vertex: int
    rotation_angle: float
    translation: NDArray[np.float64]
    nu: float
    nu_pair: Indices
    nu_class: PairClass
    nu_ratio: float
    nu_margin: float
    pair_ratio: float
    pair_ratio_pair: Indices
    clearance: float
    clearance_pair: Indices
    clearance_local: float
    clearance_local_pair: Indices
    clearance_self: float
    clearance_self_pair: Indices
    clearance_inter: float
    clearance_inter_pair: Indices
    bond_stretch: float
    bond_stretch_edge: Indices
    certifiable_interval: float
    verdict: Verdict
    scope: Scope
    n_crossings: int
    image_jumps: int
    rung: Rung
    reason: Reason
    rung_pairs: Indices
    curve_d_star: float
    curve_d_star_segment: Indices
    curve_bezier_ratio: float
    curve_bezier_margin: float
    curve_printed_ratio: float
    curve_clearance: float
    curve_clearance_pair: Indices
    curve_verdict: CurveVerdict
    curve_rung: Rung
    curve_depth: int
    curve_reason: Reason
    curve_place: NDArray[np.float64]
    curve_n_crossings: int

    def _repr_html_(self) -> str:
        """Return a table for a notebook; the texts in it come from files and are escaped."""
        values = {name: getattr(self, name) for name in self.__slots__}
        plain = {name: v.name if isinstance(v, IntEnum) else v for name, v in values.items()}
        shown = {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in plain.items()}
        rows = "".join(f"<tr><th>{name}</th><td>{escape(str(value))}</td></tr>" for name, value in shown.items())
        return f"<table><caption>mdtopo step</caption>{rows}</table>"

    @property
    def frames(self) -> tuple[int, int]:
        """The two frames that the step joins."""
        return self.frame_t0, self.frame_t1

    @property
    def times(self) -> tuple[float, float]:
        """Their times in ps."""
        return self.time_t0, self.time_t1
