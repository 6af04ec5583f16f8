"""What a file says of the selected atoms, and which of them cannot be vertices of a strand."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import StrandError
from mdtopo.typing import Flags, Indices

PROTEIN = "protein"
NUCLEIC = "nucleic"
OTHER = ""

METALS = frozenset(
    {"LI", "NA", "K", "RB", "CS", "MG", "CA", "SR", "BA", "ZN", "MN", "FE", "CU", "NI", "CO", "CD", "HG"}
)
"""Elements that are an ion when they are alone in their residue."""

CHARMM_IONS = frozenset({"LIT", "SOD", "POT", "RUB", "CES", "CAL", "BAR", "ZN2", "CLA", "CD2", "MGA"})
OTHER_IONS = frozenset({"F", "CL", "BR", "I", "IOD", "ION", "CA2", "FE2", "CU1", "ZNM"})
WATERS = frozenset({"W", "WF", "PW", "WN", "HOH", "H2O", "SOL", "WAT", "TIP3", "TIP4", "SPC"})

LONE_RESIDUES = METALS | CHARMM_IONS | OTHER_IONS | WATERS
"""Residue names of ions and of one-bead water, charge signs stripped: no part of any polymer."""


@dataclass(frozen=True, slots=True, eq=False)
class AtomTable:
    """What a file says of the selected atoms, in file order; one row for each.

    Attributes
    ----------
    name, resname, icode, altloc, chain, segid, element : ndarray of str, shape (n,)
        As in the file; empty strings where it says nothing.
    resid : ndarray of int, shape (n,)
        Residue number; for a model without residues the number of the bead.
    occupancy : ndarray, shape (n,)
        1 where unknown.
    molecule : ndarray of int, shape (n,), or None
        Number of the molecule; None where the file has none.
    residue : ndarray of int, shape (n,)
        0-based index of the atom's residue in the file.
    residue_size : ndarray of int, shape (n,)
        How many atoms of the file are in that residue, selected or not.
    residue_kind : ndarray of str, shape (n,)
        ``"protein"``, ``"nucleic"`` or ``""``.
    atom_index : ndarray of int, shape (n,)
        0-based index of the atom in the file.
    bonds : ndarray of int, shape (m, 2), or None
        All bonds of the file between atoms, selected or not, as file indices; None where the file has none.
    """

    name: NDArray[np.str_]
    resname: NDArray[np.str_]
    resid: Indices
    icode: NDArray[np.str_]
    altloc: NDArray[np.str_]
    occupancy: NDArray[np.float64]
    chain: NDArray[np.str_]
    segid: NDArray[np.str_]
    element: NDArray[np.str_]
    molecule: Indices | None
    residue: Indices
    residue_size: Indices
    residue_kind: NDArray[np.str_]
    atom_index: Indices
    bonds: Indices | None = None

    def __post_init__(self) -> None:
        for column in self.__slots__:
            values = getattr(self, column)
            if column != "bonds" and values is not None and len(values) != len(self.atom_index):
                raise StrandError(
                    f"The column {column!r} of the atom table has {len(values)} rows, "
                    f"{len(self.atom_index)} were expected."
                )

    @classmethod
    def beads(
        cls, n_beads: int, *, molecule: Indices | None = None, bonds: Indices | None = None, number: int = 0
    ) -> "AtomTable":
        """Return the table of beads without names or residues, numbered from `number` on."""
        index = np.arange(n_beads, dtype=np.int64)
        empty = np.full(n_beads, "", dtype=np.str_)
        ones = np.ones(n_beads, dtype=np.int64)
        return cls(
            name=empty,
            resname=empty,
            resid=index + number,
            icode=empty,
            altloc=empty,
            occupancy=np.ones(n_beads),
            chain=empty,
            segid=empty,
            element=empty,
            molecule=molecule,
            residue=index,
            residue_size=ones,
            residue_kind=empty,
            atom_index=index,
            bonds=bonds,
        )

    def __len__(self) -> int:
        return len(self.atom_index)

    def label(self, row: int) -> str:
        """Return one atom in words, such as ``CA of A:GLY12 (atom 87)``; atoms are counted from 0."""
        residue = f"{self.resname[row]}{self.resid[row]}{self.icode[row]}"
        chain = f"{self.group_label(row)}:" if self.group_label(row) else ""
        subject = f"{self.name[row]} of {chain}{residue}" if self.name[row] else f"bead {chain}{residue}"
        return f"{subject} (atom {self.atom_index[row]})"

    def group_label(self, row: int) -> str:
        """Return what to call the chain of an atom: chain, else segid, else molecule number, else nothing."""
        if self.chain[row] or self.segid[row]:
            return str(self.chain[row] or self.segid[row])
        return "" if self.molecule is None else str(self.molecule[row])

    def census(self, rows: Indices) -> str:
        """Return what kinds of atoms the rows are, most frequent first, as ``276 P of POPE, 3 CA of CAL``."""
        counts = Counter(_kind(self.name[r], self.resname[r]) for r in rows)
        shown = [f"{count} {kind}" for kind, count in counts.most_common(3)]
        return ", ".join(shown) + (", …" if len(counts) > 3 else "")


def usable_rows(table: AtomTable) -> tuple[Indices, list[str]]:
    """Return the rows that can be vertices, in file order, and notes on those that cannot.

    Left out are alternate locations but one of each atom, and ions: `name CA` takes calcium too.

    Raises
    ------
    StrandError
        If nothing but ions is selected.
    """
    ions = _is_ion(table)
    if ions.all():
        raise StrandError(
            f"The selection holds nothing but ions or water beads, {table.census(np.arange(len(table)))}, "
            "which form no strand; select backbone atoms, such as 'protein and name CA'."
        )
    doubles = _is_spare_location(table)
    notes = []
    if ions.any():
        notes.append(f"Left out {counted(int(ions.sum()), 'ion or water bead')}: {table.census(np.flatnonzero(ions))}.")
    if doubles.any():
        notes.append(
            f"Left out {counted(int(doubles.sum()), 'alternate location')}: "
            "of each atom the one with the highest occupancy is kept, the first of equals."
        )
    return np.flatnonzero(~ions & ~doubles).astype(np.int64), notes


def _is_ion(table: AtomTable) -> Flags:
    alone = (table.residue_size == 1) & (table.residue_kind == OTHER)
    ions = np.zeros(len(table), dtype=np.bool_)
    for row in np.flatnonzero(alone).tolist():
        named = str(table.resname[row]).upper().strip("+-") in LONE_RESIDUES
        ions[row] = named or (bool(table.name[row]) and str(table.element[row]).upper() in METALS)
    return ions


def _is_spare_location(table: AtomTable) -> Flags:
    # Alternate locations may differ in residue name, and then in residue index: the key holds numbers and
    # names only.
    best: dict[tuple[str, ...], int] = {}
    spare = np.zeros(len(table), dtype=np.bool_)
    for row in np.flatnonzero(table.altloc != ""):
        columns: Sequence[NDArray[np.str_] | Indices] = (
            table.chain,
            table.segid,
            table.resid,
            table.icode,
            table.name,
        )
        key = tuple(str(column[row]) for column in columns)
        kept = best.setdefault(key, int(row))
        if kept != row:
            loser = kept if table.occupancy[row] > table.occupancy[kept] else int(row)
            best[key] = int(row) if loser == kept else kept
            spare[loser] = True
    return spare


def _kind(name: str, resname: str) -> str:
    return f"{name or 'beads'} of {resname}" if resname else str(name or "beads")


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, in the plural where it is not one."""
    return f"1 {noun}" if count == 1 else f"{count} {noun}s".replace("ion or", "ions or")
