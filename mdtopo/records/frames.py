"""Configurations as they come from a reader, one at a time and in blocks."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdtopo.typing import Cell, Indices, Points, PointSeries, Times

LARGEST_COORDINATE = 1e12
"""Å. A coordinate beyond a hundred metres is garbage; the bounds of the kernels count on squares of squares that do not
overflow."""

SHORTEST_VECTOR = 1e-6
"""Å. A shorter lattice vector is garbage too; reducing a cell divides by its fourth power, which is far from 0."""

LEAST_VOLUME = 1e-12
"""Of the product of the three lengths. Flatter vectors may become dependent, or zero, by rounding when a cell is
reduced; a cell that is skewed by ten thousand others is still some thousand times above."""


def has_volume(cell: Cell) -> bool:
    """Return whether images can be counted in a cell: finite vectors that are not nearly zero, or nearly in one plane.

    Parameters
    ----------
    cell : ndarray, shape (3, 3)
        Lattice vectors as rows, Å.
    """
    rows = cell.tolist()  # nine numbers: NumPy would take ten times as long, once for each frame
    if not all(abs(value) <= LARGEST_COORDINATE for row in rows for value in row):  # also where it is NaN
        return False
    lengths = [math.hypot(*row) for row in rows]
    if min(lengths) < SHORTEST_VECTOR:
        return False
    a, b, c = ([value / length for value in row] for row, length in zip(rows, lengths, strict=True))
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return bool(abs(volume) > LEAST_VOLUME)


@lru_cache(maxsize=4)  # most boxes keep their size
def _has_volume(cell: bytes) -> bool:
    return has_volume(np.frombuffer(cell).reshape(3, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One saved configuration of the selected vertices.

    Attributes
    ----------
    index : int
        0-based index in the trajectory.
    time : float
        Time in ps; NaN where the file holds none.
    positions : ndarray, shape (n, 3)
        As stored, in Å; float64, cast before any arithmetic. The array belongs to the frame: no reader reuses it.
    cell : ndarray, shape (3, 3), or None
        Lattice vectors as rows, Å; None means not periodic.
    """

    index: int
    time: float
    positions: Points
    cell: Cell | None = None

    @property
    def problem(self) -> str:
        """Why the frame cannot be used, in words; empty where it can."""
        return self.coordinate_problem or self.cell_problem

    @property
    def coordinate_problem(self) -> str:
        """Why its coordinates cannot be used, in words; empty where they can."""
        if not np.abs(self.positions).max(initial=0.0) <= LARGEST_COORDINATE:  # also where it is NaN
            bad = np.flatnonzero(~(np.abs(self.positions) <= LARGEST_COORDINATE).all(axis=1))
            count = "1 vertex has" if len(bad) == 1 else f"{len(bad)} vertices have"
            value = self.positions[bad[0]].tolist()
            return f"{count} a coordinate that is not finite or beyond 1e12 Å (the first is vertex {bad[0]}: {value})"
        return ""

    @property
    def cell_problem(self) -> str:
        """Why its cell cannot be used, in words; empty where it can, or there is none."""
        if self.cell is not None and not _has_volume(np.asarray(self.cell, dtype=np.float64).tobytes()):
            return f"its periodic box has no volume, or is not finite: {self.cell.tolist()}"
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class FrameBlock:
    """Consecutive analysed frames; neighbouring blocks share one frame, so that no step is lost between them.

    Attributes
    ----------
    first_step : int
        The step that joins frames 0 and 1 of this block.
    frames : ndarray of int, shape (k + 1,)
        Frame indices in the trajectory.
    times : ndarray, shape (k + 1,)
        Times in ps.
    positions : ndarray, shape (k + 1, n, 3)
        As stored, Å.
    cells : ndarray, shape (k + 1, 3, 3), or None
        Lattice vectors; None for a run that is not periodic. A frame without a usable cell holds NaN.
    problems : tuple of str, length k + 1
        Empty where the frame is usable; else what is wrong with it, in words.
    """

    first_step: int
    frames: Indices
    times: Times
    positions: PointSeries
    cells: PointSeries | None
    problems: tuple[str, ...]

    @property
    def n_steps(self) -> int:
        """Number of steps in the block."""
        return len(self.frames) - 1
