"""Frames of one XTC file, read below the Universe: of a small system, what it does beside takes half as long again."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.readers.mdanalysis.cells import cell_of
from mdtopo.readers.mdanalysis.opening import Opened
from mdtopo.records import Frame
from mdtopo.typing import Cell, Indices


class XtcFrames:
    """The frames of an XTC file by index: coordinates of some atoms, the time and the cell.

    Guarantee
    ---------
    Bit for bit what the Universe holds at that index: MDAnalysis decodes the frame and converts units here too.
    """

    def __init__(self, trajectory: Any, atoms: slice | Indices) -> None:
        self._file, self._in_angstrom = trajectory._xdr, trajectory.convert_pos_from_native
        self._atoms = atoms
        self._stored = np.empty((trajectory.n_atoms, 3), dtype=np.float32)
        self._box, self._dimensions = b"", np.zeros(6, dtype=np.float32)

    def frame(self, index: int) -> Frame | None:
        """Return a frame; None where it cannot be read as it is: the Universe then says why, or finds a way."""
        try:
            self._file.seek(index)
            step = self._file.read_direct_x(self._stored)
            chosen = self._stored[self._atoms]
            with np.errstate(over="raise", invalid="raise"):
                self._in_angstrom(chosen)
                cell = self._cell(step.box)
        except Exception:
            return None
        return Frame(index, float(step.time), np.array(chosen, dtype=np.float64, order="C"), cell)

    def _cell(self, box: NDArray[np.float32]) -> Cell | None:
        stored = box.tobytes()
        if stored != self._box:  # most boxes keep their size
            from MDAnalysis.lib.mdamath import triclinic_box

            dimensions = triclinic_box(*box)
            self._in_angstrom(dimensions[:3])
            self._box, self._dimensions = stored, dimensions
        return cell_of(self._dimensions)


def xtc_frames(opened: Opened, atoms: slice | Indices) -> XtcFrames | None:
    """Return what reads the frames of a trajectory; None unless it is one XTC file, opened here and taken as it is.

    A Universe that was passed may transform its frames, and an option may give other times or units. Where MDAnalysis'
    reader keeps the open file is its own affair: a version that has it elsewhere is read through the Universe too.
    """
    from MDAnalysis.coordinates.XTC import XTCReader

    trajectory = opened.universe.trajectory
    is_one_file = type(trajectory) is XTCReader and hasattr(trajectory, "_xdr")
    return XtcFrames(trajectory, atoms) if opened.is_plain and is_one_file else None
