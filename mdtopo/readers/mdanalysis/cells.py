"""Lattice vectors of the boxes that MDAnalysis speaks of as three lengths and three angles."""

from functools import lru_cache
from typing import Any

import numpy as np

from mdtopo.typing import Cell


def cell_of(dimensions: Any) -> Cell | None:
    """Return the lattice vectors of a box; None where there is none, NaN where it is no box."""
    if dimensions is None:
        return None
    lattice = _lattice(np.asarray(dimensions, dtype=np.float64).tobytes())
    return None if lattice is None else lattice.copy()


@lru_cache(maxsize=4)  # most boxes keep their size
def _lattice(dimensions: bytes) -> Cell | None:
    from MDAnalysis.lib.mdamath import triclinic_vectors

    six = np.frombuffer(dimensions)
    if not np.any(six[:3]):
        return None
    with np.errstate(invalid="ignore"):  # angles that form no box end in the root of a negative number
        cell: Cell = triclinic_vectors(six, dtype=np.float64)
    if np.isfinite(cell).all() and cell[2, 2] > 0.0:  # lengths that are none end in zeros
        return cell
    return np.full((3, 3), np.nan)
