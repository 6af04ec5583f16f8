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


Stops: TypeAlias = dict[int, int]
"""The row of each selected atom, by its file index: where paths of bonds end."""


class BondGraph:
    """The bonds of a file, ready to be walked from atom to atom.

    Parameters
    ----------
    bonds : ndarray of int, shape (m, 2)
        Pairs of file indices.
    """

    def __init__(self, bonds: Indices) -> None:
        n_atoms = int(bonds.max()) + 1 if len(bonds) else 0
        ends = np.concatenate([bonds, bonds[:, ::-1]])
        order = np.argsort(ends[:, 0], kind="stable")
        self._partners = ends[order, 1]
        self._starts = np.searchsorted(ends[order, 0], np.arange(n_atoms + 1))

    def partners(self, atom: int) -> list[int]:
        """Return the atoms bonded to one atom."""
        if atom + 1 >= len(self._starts):
            return []
        found: list[int] = self._partners[self._starts[atom] : self._starts[atom + 1]].tolist()
        return found

    def distances(self, atom: int, stops: Stops) -> dict[int, int]:
        """Return how many bonds away each stop is that a path reaches without passing another stop.

        Parameters
        ----------
        atom : int
            Where the paths start.
        stops : dict of int to int
            File indices (keys) at which a path ends.
        """
        found: dict[int, int] = {}
        seen, front = {atom}, [atom]
        for length in range(1, REACH + 1):
            reached = {partner for here in front for partner in self.partners(here)} - seen
            found.update((partner, length) for partner in reached if partner in stops)
            seen |= reached
            front = [partner for partner in reached if partner not in stops]
            if not front:
                break
        return found


def backbone_links(table: AtomTable, rows: Indices, graph: BondGraph, stops: Stops) -> Indices:
    """Return the pairs of rows that are neighbours along a backbone, each once, shape (m, 2).

    Two atoms are neighbours if a path of bonds joins them through atoms that are not selected (CA-C-N-CA),
    and the path is as short as any between atoms of these names and not of a rare kind. So a disulfide is no
    link of a CA trace (5 bonds, not 3), nor of an N-CA-C trace (a CA-CA link among N-CA, CA-C and C-N ones).

    Notes
    -----
    Heuristic where bonds between vertices are indirect; every direct bond between two rows is returned.
    """
    lengths: dict[tuple[int, int], int] = {}
    members = set(rows.tolist())
    for row in members:
        for other, length in graph.distances(int(table.atom_index[row]), stops).items():
            if row < stops[other] and stops[other] in members:
                lengths[row, stops[other]] = length
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
