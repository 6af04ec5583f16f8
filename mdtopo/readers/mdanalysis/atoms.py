"""From an MDAnalysis AtomGroup to an `AtomTable`, and the default trace. Nothing here imports MDAnalysis."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.strands import AtomTable
from mdtopo.typing import Flags, Indices

PROTEIN_TRACES = (("CA",), ("BB",))
"""Names of a protein's trace atoms: alpha carbons, else the backbone beads of Martini."""

NUCLEIC_TRACES = (("C4'", "C4*"),)
"""Names of a nucleic acid's trace atoms. Not P, which the first residue of a strand mostly lacks."""


def residue_kinds(universe: Any) -> NDArray[np.str_]:
    """Return ``"protein"``, ``"nucleic"`` or ``""`` for each residue.

    Its name tells, or the atoms of its backbone: those of modified residues and terminal variants do.
    """
    kinds = np.full(len(universe.residues), "", dtype="<U7")
    if not (hasattr(universe.atoms, "names") and hasattr(universe.atoms, "resnames")):
        return kinds
    names, residues = universe.atoms.names, universe.atoms.resindices
    has = {name: _residues_with(names, residues, name, len(kinds)) for name in ("N", "CA", "C")}
    sugar = [_residues_with(names, residues, n, len(kinds)) for n in ("C4'", "C4*", "C3'", "C3*")]
    kinds[has["N"] & has["CA"] & has["C"]] = "protein"
    kinds[(sugar[0] | sugar[1]) & (sugar[2] | sugar[3])] = "nucleic"
    for kind in ("protein", "nucleic"):
        kinds[universe.select_atoms(kind).residues.resindices] = kind
    return kinds


def _residues_with(names: Any, residues: Indices, name: str, n_residues: int) -> Flags:
    return np.bincount(residues[names == name], minlength=n_residues) > 0


def default_trace(universe: Any) -> tuple[Any, str]:
    """Return the atoms to take when nothing was selected, and in words which ones they are.

    Of proteins the CA (in Martini the BB), of nucleic acids the C4' atoms, of both if there are both; of a
    model that has neither every atom, in order. The group is empty if there are such residues but no such
    atoms.
    """
    kinds = residue_kinds(universe)[universe.atoms.resindices]
    if not (kinds != "").any():
        return universe.atoms, "all atoms, because no protein or nucleic acid is recognised"
    taken = np.zeros(len(universe.atoms), dtype=np.bool_)
    words = []
    for kind, traces in (("protein", PROTEIN_TRACES), ("nucleic", NUCLEIC_TRACES)):
        for trace in traces:
            found = (kinds == kind) & np.isin(universe.atoms.names.astype(np.str_), trace)
            if found.any():
                taken |= found
                words.append(f"{kind} and name {' '.join(trace)}")
                break
    return universe.atoms[taken], " or ".join(words) or "protein and name CA, nucleic and name C4'"


def atom_table(group: Any) -> AtomTable:
    """Return what MDAnalysis knows of the atoms of a group, one row for each, in the group's order.

    A model without residue names (LAMMPS, XYZ) is one of beads: each is its own residue, numbered by its id,
    and where there are several residues they are the molecules.
    """
    universe = group.universe
    bonds = universe.bonds.indices.astype(np.int64) if hasattr(universe, "bonds") else None
    if not hasattr(group, "resnames"):
        return _bead_table(group, bonds)
    kinds, sizes = residue_kinds(universe), np.bincount(universe.atoms.resindices)
    return AtomTable(
        name=_words(group, "names"),
        resname=_words(group, "resnames"),
        resid=_numbers(group, "resids"),
        icode=_words(group, "icodes"),
        altloc=_words(group, "altLocs"),
        occupancy=_column(group, "occupancies", 1.0).astype(np.float64),
        chain=_words(group, "chainIDs"),
        segid=_words(group, "segids"),
        element=_words(group, "elements"),
        molecule=_numbers(group, "molnums") if hasattr(group, "molnums") else None,
        residue=group.resindices.astype(np.int64),
        residue_size=sizes[group.resindices].astype(np.int64),
        residue_kind=kinds[group.resindices],
        atom_index=group.ix.astype(np.int64),
        bonds=bonds,
    )


def _bead_table(group: Any, bonds: Indices | None) -> AtomTable:
    index = group.ix.astype(np.int64)
    empty, ones = np.full(len(group), "", dtype=np.str_), np.ones(len(group), dtype=np.int64)
    return AtomTable(
        name=_words(group, "names"),
        resname=empty,
        resid=_numbers(group, "ids") if hasattr(group, "ids") else index,
        icode=empty,
        altloc=empty,
        occupancy=ones.astype(np.float64),
        chain=_words(group, "chainIDs"),
        segid=_words(group, "segids"),
        element=_words(group, "elements"),
        molecule=_bead_molecules(group),
        residue=index,
        residue_size=ones,
        residue_kind=empty,
        atom_index=index,
        bonds=bonds,
    )


def _bead_molecules(group: Any) -> Indices | None:
    """Return the molecule of each bead; None where all are in one residue, or each in its own."""
    if hasattr(group, "molnums"):
        return _numbers(group, "molnums")
    is_split = 1 < len(group.universe.residues) < len(group.universe.atoms)
    return _numbers(group, "resids" if hasattr(group, "resids") else "resindices") if is_split else None


def _column(group: Any, attribute: str, default: object) -> NDArray[Any]:
    if hasattr(group, attribute):
        return np.asarray(getattr(group, attribute))
    return np.full(len(group), default)


def _words(group: Any, attribute: str) -> NDArray[np.str_]:
    words = np.char.strip(_column(group, attribute, "").astype(np.str_))
    # MDAnalysis calls the segment of a file without segments SYSTEM
    return np.where(words == "SYSTEM", "", words) if attribute == "segids" else words


def _numbers(group: Any, attribute: str) -> Indices:
    return np.asarray(getattr(group, attribute)).astype(np.int64)
