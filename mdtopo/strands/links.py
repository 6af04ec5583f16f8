"""Which selected atoms the bonds of a file join, directly or through atoms that are not selected."""

from collections import Counter
from typing import TypeAlias

import numpy as np

from mdtopo.strands.atoms import AtomTable
from mdtopo.typing import Indices

REACH = 10
"""Bonds between two neighbouring vertices, at most: CA-CA has 3, C4'-C4' 6; polyesters reach 10."""

BACKBONE_SHARE = 0.25
"""A kind of link that is this much rarer than the chain's most frequent kind is a cross-link, not
backbone."""


def has_bonds(table: AtomTable, rows: Indices) -> bool:
    """Return whether the file's bonds describe these atoms: more than half of them have one.

    A PDB file lists bonds of disulfides and ligands alone; they say nothing of where the chain ends.
    """
    if table.bonds is None or not len(table.bonds):
        return False
    bonded = np.isin(table.atom_index[rows], table.bonds)
    return 2 * int(bonded.sum()) > len(rows)


class BondGraph:
    """The bonds of a file, ready to be walked from atom to atom.

    Parameters
    ----------
    table : AtomTable
        The selected atoms, with the bonds of all.
    rows : ndarray of int
        The rows that can be vertices; a walk ends at them.
    """

    def __init__(self, table: AtomTable, rows: Indices) -> None:
        self._bonds = np.empty((0, 2), dtype=np.int64) if table.bonds is None else table.bonds
        self._atoms = table.atom_index
        self._row_of = {int(table.atom_index[row]): int(row) for row in rows}
        ends = np.concatenate([self._bonds, self._bonds[:, ::-1]])
        order = np.argsort(ends[:, 0], kind="stable")
        n_atoms = int(ends.max()) + 1 if len(ends) else 0
        self._partners = ends[order, 1]
        self._starts = np.searchsorted(ends[order, 0], np.arange(n_atoms + 1))

    def direct_bonds(self) -> list[tuple[int, int]]:
        """Return the bonds between two rows, as rows."""
        row_of = self._row_of
        return [(row_of[i], row_of[j]) for i, j in self._bonds.tolist() if i in row_of and j in row_of]

    def distances(self, row: int) -> dict[int, int]:
        """Return how many bonds away each other row is that a path reaches without passing a third one."""
        found: dict[int, int] = {}
        start = int(self._atoms[row])
        seen, front = {start}, [start]
        for length in range(1, REACH + 1):
            reached = {partner for atom in front for partner in self._partners_of(atom)} - seen
            found.update((self._row_of[atom], length) for atom in reached if atom in self._row_of)
            seen |= reached
            front = [atom for atom in reached if atom not in self._row_of]
            if not front:
                break
        return found

    def _partners_of(self, atom: int) -> list[int]:
        if atom + 1 >= len(self._starts):
            return []
        found: list[int] = self._partners[self._starts[atom] : self._starts[atom + 1]].tolist()
        return found


def backbone_links(table: AtomTable, rows: Indices, graph: BondGraph) -> Indices:
    """Return the pairs of rows that are neighbours along a backbone, each once, shape (m, 2).

    Two atoms are neighbours if a path of bonds joins them through atoms that are not selected (CA-C-N-CA),
    and the path is as short as any between atoms of these names and not of a rare kind. So a disulfide is no
    link of a CA trace (5 bonds, not 3), nor of an N-CA-C trace (a CA-CA link among N-CA, CA-C and C-N ones).

    Notes
    -----
    Heuristic where bonds between vertices are indirect; every direct bond between two rows is returned.
    """
    members = set(rows.tolist())
    lengths = {
        (row, other): length
        for row in members
        for other, length in graph.distances(row).items()
        if row < other and other in members
    }
    kinds = {pair: _link_kind(table, pair, length) for pair, length in lengths.items()}
    backbone = _backbone_kinds(Counter(kinds.values()))
    kept = [pair for pair, kind in kinds.items() if kind in backbone]
    return np.array(sorted(kept), dtype=np.int64).reshape(-1, 2)


LinkKind: TypeAlias = tuple[str, str, int]
"""The two atom names, sorted, and the number of bonds between the atoms."""


def _link_kind(table: AtomTable, pair: tuple[int, int], length: int) -> LinkKind:
    first, second = sorted(str(table.name[row]) for row in pair)
    return first, second, length


def _backbone_kinds(counts: Counter[LinkKind]) -> set[LinkKind]:
    shortest: dict[tuple[str, str], int] = {}
    for first, second, length in counts:
        shortest[first, second] = min(length, shortest.get((first, second), length))
    most = max(counts.values(), default=0)
    return {
        (first, second, length)
        for (first, second, length), count in counts.items()
        if length == 1 or (length == shortest[first, second] and count >= BACKBONE_SHARE * most)
    }
