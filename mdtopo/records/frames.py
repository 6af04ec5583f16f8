"""Configurations as they come from a reader, one at a time and in blocks."""

from dataclasses import dataclass

import numpy as np

from mdtopo.typing import Cell, Indices, Points, PointSeries, Times


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
    def is_finite(self) -> bool:
        """Whether every coordinate and lattice vector is a number."""
        finite = bool(np.isfinite(self.positions).all())
        return finite and (self.cell is None or bool(np.isfinite(self.cell).all()))


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
