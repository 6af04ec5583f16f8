"""How far consecutive atoms are apart, and from which length on there is no edge between them."""

import numpy as np

from mdtopo.geometry.lattice import basis_of, reduced_basis
from mdtopo.records.frames import has_volume
from mdtopo.strands.atoms import OTHER, AtomTable, counted
from mdtopo.typing import Cell, Indices, Lengths, Points

CA_CUT = 5.0
"""Å. CA to CA is 3.8 (2.9 in a cis peptide), seldom beyond 4.2; over a missing residue 5.0 and more."""

NUCLEIC_CUT = 9.0
"""Å. C4' to C4' (P to P) is 5 … 7, 7.7 when its six bonds are stretched; over a missing residue more."""

MEDIAN_FACTOR = 3.0
"""Times the median step. Broadest is the Gaussian bond, which exceeds it once in 10 000 (4.6 standard
deviations of a component); the ends of neighbouring chains in a melt lie many bonds apart."""

SKIP_FACTOR = 1.3
"""Times the median step, where residue numbers are missing. A neighbour is still within (CA 4.9 Å), the one
after it is not; chains that are numbered with skips stay whole."""

FIXED_CUTS = {"CA": CA_CUT, "C4'": NUCLEIC_CUT}

CA_NAMES = frozenset({"CA"})
NUCLEIC_NAMES = frozenset({"C4'", "C4*", "P"})


def nearest_steps(differences: Points, cell: Cell | None) -> Lengths:
    """Return the length of each difference's nearest periodic image, Å; exact for cells of any shape.

    Parameters
    ----------
    differences : ndarray, shape (n, 3)
        Differences of positions, Å.
    cell : ndarray, shape (3, 3), or None
        None, or a cell that is singular or not finite, means not periodic.
    """
    if cell is None or not has_volume(cell) or not len(differences):
        return np.asarray(np.linalg.norm(differences, axis=1), dtype=np.float64)
    basis = np.array(reduced_basis(basis_of(np.ascontiguousarray(cell, dtype=np.float64))))
    near = differences - np.round(differences @ np.linalg.inv(basis)) @ basis
    # In a reduced basis the nearest image is among the neighbours of the rounded one.
    squared = [((near + shift @ basis) ** 2).sum(axis=1) for shift in np.indices((3, 3, 3)).reshape(3, -1).T - 1]
    return np.asarray(np.sqrt(np.min(squared, axis=0)), dtype=np.float64)


class StepCheck:
    """Says of consecutive rows whether their step is short enough for an edge.

    Parameters
    ----------
    table : AtomTable
        The selected atoms.
    pairs : ndarray of int, shape (m, 2)
        Consecutive rows that labels and numbers allow to be joined; medians are taken over these steps.
    positions : ndarray, shape (n, 3)
        One frame, one position for each row of the table, Å.
    cell : ndarray, shape (3, 3), or None
        Its cell.
    cut : float, optional
        There is no edge between atoms that are further apart, Å. By default `CA_CUT` between CA atoms,
        `NUCLEIC_CUT` between C4' or P atoms, and elsewhere `MEDIAN_FACTOR` times the median step between
        residues of that kind.
    """

    def __init__(
        self, table: AtomTable, pairs: Indices, positions: Points, cell: Cell | None, cut: float | None
    ) -> None:
        self._table, self._positions, self._cell = table, positions, cell
        lengths = nearest_steps(positions[pairs[:, 1]] - positions[pairs[:, 0]], cell)
        kinds = np.array([self._kind(int(i), int(j)) for i, j in pairs], dtype=np.str_)
        medians = {str(kind): _median(lengths[kinds == kind]) for kind in np.unique(kinds)}
        self._cuts = {kind: cut or FIXED_CUTS.get(kind, MEDIAN_FACTOR * m) for kind, m in medians.items()}
        self._skip_cuts = {kind: cut or min(self._cuts[kind], SKIP_FACTOR * m) for kind, m in medians.items()}
        self._lengths = {(int(i), int(j)): float(d) for (i, j), d in zip(pairs, lengths, strict=True)}

    def _kind(self, i: int, j: int) -> str:
        names = {str(self._table.name[i]), str(self._table.name[j])}
        if names <= CA_NAMES:
            return "CA"
        return "C4'" if names <= NUCLEIC_NAMES else f"{self._table.residue_kind[i]} residue"

    def is_short(self, i: int, j: int) -> bool:
        """Return whether any two rows are as near as an edge allows, the ends of a strand for example."""
        difference = self._positions[j] - self._positions[i]
        return bool(nearest_steps(difference[None, :], self._cell)[0] <= self._cuts.get(self._kind(i, j), 0.0))

    def gap_reason(self, i: int, j: int) -> str:
        """Return why there is no edge between two consecutive rows; empty if there is one.

        A step that is not a number cannot be judged and is no gap: the strands must not hang on one bad
        frame.
        """
        kind, missing = self._kind(i, j), self._missing_numbers(i, j)
        length, cut = self._lengths[i, j], (self._skip_cuts if missing else self._cuts)[kind]
        if not length > cut:
            return ""
        numbers = f", with {counted(missing, 'residue number')} missing in between" if missing else ""
        return (
            f"{self._table.label(i)} and {self._table.label(j)} are {length:.3g} Å apart, "
            f"beyond the cut of {cut:.3g} Å{numbers}"
        )

    def _missing_numbers(self, i: int, j: int) -> int:
        if self._table.residue_kind[i] == OTHER or self._table.residue_kind[j] == OTHER:
            return 0  # the numbers of beads are those of atoms, of which a selection may take every other one
        return max(int(self._table.resid[j]) - int(self._table.resid[i]) - 1, 0)


def _median(lengths: Lengths) -> float:
    known = lengths[np.isfinite(lengths)]
    return float(np.median(known)) if len(known) else np.inf
