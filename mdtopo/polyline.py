"""One step of arrays in memory: the door for those who have their own frames."""

from dataclasses import replace
from functools import cache

import numpy as np

from mdtopo.curves import greatest_magnitude
from mdtopo.errors import InputError
from mdtopo.measure import measure_one
from mdtopo.planning import plan_step
from mdtopo.records import Frame, FrameBlock, MonitorConfig, StepReport, Strands
from mdtopo.records.frames import LARGEST_COORDINATE, has_volume
from mdtopo.typing import Cell, Points

FRAMES, UNKNOWN_TIMES = np.arange(2), np.full(2, np.nan)
"""Of arrays in memory; a report has copies."""


def polyline_step(
    x_t0: Points,
    x_t1: Points,
    strands: Strands,
    *,
    cell_t0: Cell | None = None,
    cell_t1: Cell | None = None,
    config: MonitorConfig | None = None,
) -> StepReport:
    """Return what one step of the strands' polylines measures and proves.

    Parameters
    ----------
    x_t0, x_t1 : ndarray, shape (n, 3)
        Positions at the step's start and end, Å.
    strands : Strands
        Which vertices form which strand.
    cell_t0, cell_t1 : ndarray, shape (3, 3), optional
        Lattice vectors as rows, Å; both or neither.
    config : MonitorConfig, optional
        Defaults where left out. The smooth curve and the profile are left out whatever it says: see `curve_step`.

    Raises
    ------
    InputError
        If shapes do not fit, a value is not finite, or only one cell is given.

    Guarantee
    ---------
    Proven: see `measure_block`. The reference of `bond_stretch` is the step's start.

    Examples
    --------
    Two crossed bars, 0.1 Å apart, move 1.1 Å away from each other (the paper's one-frame bound cannot prove it):

    >>> import numpy as np
    >>> bars = Strands.from_lengths([2, 2])
    >>> x0 = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0.1], [0, 1, 0.1]])
    >>> x1 = x0 + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1.1], [0, 0, 1.1]])
    >>> report = polyline_step(x0, x1, bars, config=MonitorConfig(motion="lab"))
    >>> report.verdict.name, round(report.clearance, 6)
    ('CERTIFIED', 0.1)
    """
    if (cell_t0 is None) != (cell_t1 is None):
        raise InputError("Only one of cell_t0 and cell_t1 is given; a periodic step needs both.")
    x0, x1 = checked_positions(x_t0, strands, "x_t0"), checked_positions(x_t1, strands, "x_t1")
    cells = None
    if cell_t0 is not None and cell_t1 is not None:
        cells = np.stack([checked_cell(cell_t0, "cell_t0"), checked_cell(cell_t1, "cell_t1")])
    positions = np.empty((2, *x0.shape))
    positions[0], positions[1] = x0, x1
    block = FrameBlock(0, FRAMES, UNKNOWN_TIMES, positions, cells, problems=("", ""))
    return measure_one(plan_step(block, strands), strands, _of_one_step(config))


@cache
def _of_one_step(config: MonitorConfig | None) -> MonitorConfig:
    """Return the configuration that looks at the polyline of one step alone; the curve's step is `curve_step`."""
    return replace(config or MonitorConfig(), curve="none", profile_steps=0)


def nu(x: Points, strands: Strands, *, cell: Cell | None = None) -> float:
    """Return ν, the paper's PL separation: the least distance of disjoint vertices and edges, Å.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions, Å.
    strands : Strands
        Which vertices form which strand.
    cell : ndarray, shape (3, 3), optional
        Lattice vectors as rows, Å.

    Notes
    -----
    Jordan et al. (2008), section 5. In space the least distance needs pairs of edges: vertex against edge alone misses
    a plain X. The value is that of closest points, right to rounding.

    Examples
    --------
    >>> import numpy as np
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    >>> nu(square, Strands.from_lengths([4], closed=True))
    1.0
    """
    return polyline_step(x, x, strands, cell_t0=cell, cell_t1=cell, config=MonitorConfig(motion="lab")).nu


def checked_positions(x: Points, strands: Strands, name: str) -> Points:
    """Return positions as C-contiguous float64.

    Raises
    ------
    InputError
        If the shape does not fit the strands, or a coordinate is no number or not finite.
    """
    try:
        if np.iscomplexobj(x):
            raise TypeError("complex numbers")
        array = np.ascontiguousarray(x, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} does not hold numbers ({error}); positions are real numbers, in Å.") from error
    if array.shape != (strands.n_vertices, 3):
        raise InputError(f"{name} has shape {array.shape}; the strands need ({strands.n_vertices}, 3).")
    if not greatest_magnitude(array) <= LARGEST_COORDINATE:  # also where it is NaN
        raise InputError(f"{name} cannot be used: {Frame(0, np.nan, array).problem}.")
    return array


def checked_cell(cell: Cell, name: str) -> Cell:
    """Return a cell as C-contiguous float64.

    Raises
    ------
    InputError
        If it is not a finite (3, 3) array with a volume.
    """
    array = np.ascontiguousarray(cell, dtype=np.float64)
    if array.shape != (3, 3) or not has_volume(array):
        raise InputError(f"{name} must be a (3, 3) array of lattice vectors as rows, with a volume; got {cell!r}.")
    return array
