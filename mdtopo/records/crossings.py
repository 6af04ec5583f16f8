"""Crossings: where and when one strand passes through another on the straight path between two frames."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from functools import cache
from html import escape
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from mdtopo.records.strands import Strands
from mdtopo.typing import Codes, Indices, Points


class Grade(IntEnum):
    """What a crossing of the straight path says about the physics.

    PROVEN: an invariant that no path can change without a passage differs between the two frames. RESOLVED: the two
    edges move less, relative to each other, than the resolution length. UNDERSAMPLED: they move further, so the frames
    are too far apart to tell a passage from a detour.
    """

    UNDERSAMPLED = 0
    RESOLVED = 1
    PROVEN = 2


class Shape(IntEnum):
    """What crossed: the polyline or the smooth curve."""

    POLYLINE = 0
    CURVE = 1


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """One passage of one edge through another, or of one segment of the smooth curve through another.

    A segment of the curve is named by the edge that it goes with, and its parameter is the curve's.

    Attributes
    ----------
    step, frame_t0, frame_t1 : int
        The step, and the frames that it joins.
    t : float
        Time within the step, in (0, 1).
    edges : ndarray of int, shape (2, 2)
        Vertices of the two edges, in strand order; the edge with the lower first vertex comes first.
    parameters : ndarray, shape (2,)
        Where on the edges, from 0 (first vertex) to 1.
    point : ndarray, shape (3,)
        Where in space, Å: on the first edge, in the coordinates of the step's first frame.
    sign : int
        Change of the linking number, or half the change of the writhe, that the passage brings: +1 where
        det(a - c, b - a, d - c) rises through zero, -1 where it falls.
    image : ndarray of int, shape (3,)
        Lattice counts that bring the second edge, as the first frame stores its first vertex, to the first edge.
    grade : Grade
    object : Shape
    strands, residues : tuple of str
        Names of the two strands; the two edges in words.
    motion : float
        Greatest relative motion ρ of the two edges in the step, Å.
    resolution : float
        Resolution length of the pair, Å; `motion` below it makes the crossing `resolved`.
    """

    step: int
    frame_t0: int
    frame_t1: int
    t: float
    edges: Indices
    parameters: NDArray[np.float64]
    point: NDArray[np.float64]
    sign: int
    image: Indices
    grade: Grade
    object: Shape
    strands: tuple[str, str]
    residues: tuple[str, str]
    motion: float
    resolution: float


SHOWN = 20
"""Rows of a table in a notebook."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Crossings(Sequence[Crossing]):
    """The crossings of consecutive steps, one row each, by step and time; a row as an object is a `Crossing`.

    Those of the polyline and those of the curve are kept in two tables; a results file lists both in one.

    Attributes are columns, named like the fields of `Crossing`; `strands` names what the rows are about.
    """

    strands: Strands | None
    step: Indices
    frame_t0: Indices
    frame_t1: Indices
    t: NDArray[np.float64]
    edges: Indices
    parameters: NDArray[np.float64]
    point: Points
    sign: Indices
    image: Indices
    grade: Codes
    object: Codes
    motion: NDArray[np.float64]
    resolution: NDArray[np.float64]

    def __repr__(self) -> str:
        """Return how many there are, and where."""
        where = f", steps {self.step[0]} to {self.step[-1]}" if len(self) else ""
        return f"<Crossings: {len(self)}{where}>"

    def _repr_html_(self) -> str:
        """Return a table for a notebook, of the first rows."""
        heads = ("step", "frames", "t", "strands", "edges", "sign", "grade")
        rows = [
            (
                crossing.step,
                f"{crossing.frame_t0}-{crossing.frame_t1}",
                f"{crossing.t:.6g}",
                ", ".join(dict.fromkeys(crossing.strands)),
                " × ".join(crossing.residues),
                f"{crossing.sign:+d}",
                crossing.grade.name.lower(),
            )
            for crossing in self.rows(slice(SHOWN))
        ]
        cells = ["".join(f"<td>{escape(str(value))}</td>" for value in row) for row in rows]
        shown = f", the first {SHOWN}" if len(self) > SHOWN else ""
        head = "".join(f"<th>{name}</th>" for name in heads)
        body = "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<table><caption>{len(self)} crossings{shown}</caption><tr>{head}</tr>{body}</table>"

    @classmethod
    @cache
    def none(cls) -> "Crossings":
        """Return a table without rows, the same one every time."""
        count, number, code = np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=np.int8)
        pair, triple = np.empty((0, 2, 2), dtype=np.int64), np.empty((0, 3), dtype=np.int64)
        return cls(
            strands=None,
            step=count,
            frame_t0=count,
            frame_t1=count,
            t=number,
            edges=pair,
            parameters=np.empty((0, 2)),
            point=np.empty((0, 3)),
            sign=count,
            image=triple,
            grade=code,
            object=code,
            motion=number,
            resolution=number,
        )

    @classmethod
    def joined(cls, tables: Sequence["Crossings"]) -> "Crossings":
        """Return the rows of all tables, one after the other."""
        filled = [table for table in tables if len(table)]
        if len(filled) < 2:
            return filled[0] if filled else cls.none()
        columns = {name: np.concatenate([getattr(table, name) for table in filled]) for name in cls.column_names()}
        return cls(strands=filled[0].strands, **columns)

    @classmethod
    def column_names(cls) -> tuple[str, ...]:
        """Return the names of the columns."""
        return tuple(entry.name for entry in fields(cls) if entry.name != "strands")

    def rows(self, chosen: slice | NDArray[Any]) -> "Crossings":
        """Return some rows: a slice, a mask or indices."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in self.column_names()})

    def of(self, shape: Shape) -> "Crossings":
        """Return the rows of the polyline alone, or of the curve alone."""
        chosen = self.object == shape
        return self if chosen.all() else self.rows(chosen)

    def and_then(self, later: "Crossings") -> "Crossings":
        """Return the rows of two tables, sorted by step; within a step these come first."""
        both = Crossings.joined([self, later])
        return both.rows(np.argsort(both.step, kind="stable")) if len(self) and len(later) else both

    def of_step(self, step: int) -> "Crossings":
        """Return the rows of one step; rows are sorted by step."""
        if not len(self) or self.step[0] == step == self.step[-1]:
            return self
        low, high = np.searchsorted(self.step, [step, step + 1])
        return self.rows(slice(low, high))

    def __len__(self) -> int:
        return len(self.step)

    @overload
    def __getitem__(self, index: int) -> Crossing: ...

    @overload
    def __getitem__(self, index: slice) -> "Crossings": ...

    def __getitem__(self, index: int | slice) -> "Crossing | Crossings":
        if isinstance(index, slice):
            return self.rows(index)
        edges = self.edges[index]
        return Crossing(
            step=int(self.step[index]),
            frame_t0=int(self.frame_t0[index]),
            frame_t1=int(self.frame_t1[index]),
            t=float(self.t[index]),
            edges=edges.copy(),
            parameters=self.parameters[index].copy(),
            point=self.point[index].copy(),
            sign=int(self.sign[index]),
            image=self.image[index].copy(),
            grade=Grade(int(self.grade[index])),
            object=Shape(int(self.object[index])),
            strands=self._names(edges),
            residues=self._residues(edges),
            motion=float(self.motion[index]),
            resolution=float(self.resolution[index]),
        )

    def __iter__(self) -> Iterator[Crossing]:
        return (self[row] for row in range(len(self)))

    def _names(self, edges: Indices) -> tuple[str, str]:
        if self.strands is None:
            return "", ""
        of = self.strands.strand_of_vertex
        return self.strands.names[of[edges[0, 0]]], self.strands.names[of[edges[1, 0]]]

    def _residues(self, edges: Indices) -> tuple[str, str]:
        if self.strands is None:
            return "", ""
        return self.strands.describe_edge(edges[0]), self.strands.describe_edge(edges[1])
