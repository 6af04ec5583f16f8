import warnings

import MDAnalysis
import numpy as np
import pytest

from mdtopo.readers.mdanalysis.atoms import atom_table, default_trace, residue_kinds


def universe(*residues, **attributes):
    """Return a Universe of residues, each (name, names of its atoms)."""
    names = [name for _, atoms in residues for name in atoms]
    index = np.repeat(np.arange(len(residues)), [len(atoms) for _, atoms in residues])
    made = MDAnalysis.Universe.empty(len(names), n_residues=len(residues), atom_resindex=index, trajectory=True)
    made.add_TopologyAttr("names", names)
    made.add_TopologyAttr("resnames", [resname for resname, _ in residues])
    made.add_TopologyAttr("resids", np.arange(1, len(residues) + 1))
    for attribute, values in attributes.items():
        made.add_TopologyAttr(attribute, values)
    return made


BACKBONE = ("N", "CA", "C", "O")
SUGAR = ("P", "O5'", "C5'", "C4'", "C3'", "O3'")
OLD_SUGAR = ("P", "O5*", "C5*", "C4*", "C3*", "O3*")


@pytest.mark.parametrize(
    ("resname", "atoms", "kind"),
    [
        ("ALA", BACKBONE, "protein"),
        ("ALA", ("BB",), "protein"),
        ("SEP", BACKBONE, "protein"),
        ("XYZ", BACKBONE, "protein"),
        ("DA5", SUGAR, "nucleic"),
        ("5MC", SUGAR, "nucleic"),
        ("PSU", OLD_SUGAR, "nucleic"),
        ("G", ("P",), "nucleic"),
        ("CA", ("CA",), ""),
        ("POPC", ("N", "P", "C1", "C2"), ""),
        ("SOL", ("OW", "HW1", "HW2"), ""),
        ("LIG", ("N", "C", "O"), ""),
    ],
)
def test_a_residue_is_known_by_its_name_or_its_atoms(resname, atoms, kind):
    assert residue_kinds(universe((resname, atoms))).tolist() == [kind]


@pytest.mark.parametrize(
    ("residues", "names", "words"),
    [
        ([("ALA", BACKBONE)] * 2, ["CA", "CA"], "protein and name CA"),
        ([("DA", SUGAR)] * 2, ["C4'", "C4'"], "nucleic and name C4' C4*"),
        ([("DA", OLD_SUGAR)] * 2, ["C4*", "C4*"], "nucleic and name C4' C4*"),
        ([("ALA", ("BB", "SC1"))] * 2, ["BB", "BB"], "protein and name BB"),
        (
            [("ALA", BACKBONE), ("DA", SUGAR), ("CA", ("CA",)), ("POPC", ("P", "C1"))],
            ["CA", "C4'"],
            "protein and name CA or nucleic and name C4' C4*",
        ),
    ],
)
def test_default_trace(residues, names, words):
    group, said = default_trace(universe(*residues))
    assert group.names.tolist() == names
    assert said == words


def test_default_trace_of_beads_is_every_atom():
    group, said = default_trace(universe(("PEO", ("EO",)), ("PEO", ("EO",))))
    assert len(group) == 2
    assert said.startswith("all atoms")


def test_default_trace_is_empty_where_residues_lack_their_trace_atom():
    assert len(default_trace(universe(("ALA", ("N", "C"))))[0]) == 0


def test_a_table_holds_what_the_file_says():
    made = universe(
        *[("ALA", BACKBONE)] * 2, chainIDs=["A"] * 8, icodes=["", "B"], segids=["SYSTEM"], elements=["C"] * 8
    )
    made.add_TopologyAttr("bonds", [(0, 1), (1, 2), (2, 4), (4, 5)])
    table = atom_table(made.select_atoms("name CA"))
    assert table.name.tolist() == ["CA", "CA"]
    assert (table.chain.tolist(), table.segid.tolist()) == (["A", "A"], ["", ""])
    assert (table.resid.tolist(), table.icode.tolist()) == ([1, 2], ["", "B"])
    assert (table.residue_size.tolist(), table.residue_kind.tolist()) == ([4, 4], ["protein"] * 2)
    assert table.atom_index.tolist() == [1, 5]
    assert table.bonds.tolist() == [[0, 1], [1, 2], [2, 4], [4, 5]]
    assert table.molecule is None
    assert table.occupancy.tolist() == [1.0, 1.0]


def test_a_table_holds_molecules():
    made = universe(*[("ALA", BACKBONE)] * 2, molnums=[3, 4])
    assert atom_table(made.select_atoms("name CA")).molecule.tolist() == [3, 4]


def beads(n_residues, **attributes):
    made = MDAnalysis.Universe.empty(
        4, n_residues=n_residues, atom_resindex=np.arange(4) * n_residues // 4, trajectory=True
    )
    for attribute, values in attributes.items():
        made.add_TopologyAttr(attribute, values)
    return made


def test_residues_of_beads_are_molecules_and_ids_their_numbers():
    table = atom_table(beads(2, resids=[7, 9], ids=[11, 12, 13, 14]).atoms)
    assert table.molecule.tolist() == [7, 7, 9, 9]
    assert table.resid.tolist() == [11, 12, 13, 14]
    assert table.residue.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("n_residues", [1, 4])
def test_one_residue_for_all_or_one_for_each_bead_says_nothing_of_molecules(n_residues):
    assert atom_table(beads(n_residues, resids=np.arange(n_residues)).atoms).molecule is None


def test_no_warning_is_raised():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        atom_table(universe(("ALA", BACKBONE)).atoms)
