"""How far consecutive atoms are apart, and from which length on there is no edge between them."""

import numpy as np
from numpy.typing import NDArray

from mdtopo.geometry.lattice import basis_of, reduced_basis
from mdtopo.records.frames import has_volume
from mdtopo.strands.atoms import OTHER, AtomTable, counted
from mdtopo.typing import Cell, Flags, Indices, Lengths, Points

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
        i, j = pairs[:, 0], pairs[:, 1]
        lengths = nearest_steps(positions[j] - positions[i], cell)
        kinds, missing = _kinds(table, i, j), _missing_numbers(table, i, j)
        medians = {kind: _median(lengths[kinds == kind]) for kind in set(kinds.tolist())}
        self._cuts = {kind: cut or FIXED_CUTS.get(kind, MEDIAN_FACTOR * m) for kind, m in medians.items()}
        limits = np.empty(len(pairs))
        for kind, median in medians.items():
            whole, skipping = self._cuts[kind], cut or min(self._cuts[kind], SKIP_FACTOR * median)
            chosen = kinds == kind
            limits[chosen] = np.where(missing[chosen] > 0, skipping, whole)
        # a step that is not a number is not beyond its limit
        self._gaps = {
            (int(i[k]), int(j[k])): self._reason(int(i[k]), int(j[k]), lengths[k], limits[k], int(missing[k]))
            for k in np.flatnonzero(lengths > limits)
        }

    def _reason(self, i: int, j: int, length: float, cut: float, missing: int) -> str:
        numbers = f", with {counted(missing, 'residue number')} missing in between" if missing else ""
        return (
            f"{self._table.label(i)} and {self._table.label(j)} are {length:.3g} Å apart, "
            f"beyond the cut of {cut:.3g} Å{numbers}"
        )

    def is_short(self, i: int, j: int) -> bool:
        """Return whether any two rows are as near as an edge allows, the ends of a strand for example."""
        difference = self._positions[j] - self._positions[i]
        kind = str(_kinds(self._table, np.array([i]), np.array([j]))[0])
        return bool(nearest_steps(difference[None, :], self._cell)[0] <= self._cuts.get(kind, 0.0))

    def gap_reason(self, i: int, j: int) -> str:
        """Return why there is no edge between two rows that are one of the pairs; empty if there is one.

        A step that is not a number cannot be judged and is no gap: the strands must not hang on one bad
        frame.
        """
        return self._gaps.get((i, j), "")


def _kinds(table: AtomTable, i: Indices, j: Indices) -> NDArray[np.str_]:
    """Return for each pair of rows what kind of step it is, in words: those of one kind have one cut."""
    both_ca = _are_named(table, i, CA_NAMES) & _are_named(table, j, CA_NAMES)
    both_nucleic = _are_named(table, i, NUCLEIC_NAMES) & _are_named(table, j, NUCLEIC_NAMES)
    others = np.strings.add(table.residue_kind[i], " residue")
    return np.asarray(np.where(both_ca, "CA", np.where(both_nucleic, "C4'", others)), dtype=np.str_)


def _are_named(table: AtomTable, rows: Indices, names: frozenset[str]) -> Flags:
    found = np.zeros(len(rows), dtype=np.bool_)
    for name in names:
        found |= table.name[rows] == name
    return found


def _missing_numbers(table: AtomTable, i: Indices, j: Indices) -> Indices:
    between = np.maximum(table.resid[j] - table.resid[i] - 1, 0)
    # the numbers of beads are those of atoms, of which a selection may take every other one
    beads = (table.residue_kind[i] == OTHER) | (table.residue_kind[j] == OTHER)
    return np.asarray(np.where(beads, 0, between), dtype=np.int64)


def _median(lengths: Lengths) -> float:
    known = lengths[np.isfinite(lengths)]
    return float(np.median(known)) if len(known) else np.inf
