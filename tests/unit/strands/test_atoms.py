from dataclasses import replace

import numpy as np
import pytest
from atom_tables import residue_table

from mdtopo.errors import StrandError
from mdtopo.strands import AtomTable
from mdtopo.strands.atoms import usable_rows


def test_columns_of_different_length_are_refused():
    with pytest.raises(StrandError, match="'resid' of the atom table has 2 rows, 3"):
        replace(AtomTable.beads(3), resid=np.arange(2))


def test_label_says_chain_residue_and_atom():
    table = residue_table([12, 13], resname="GLY", chain="A", icode=["", "B"])
    assert table.label(0) == "CA of A:GLY12 (atom 0)"
    assert table.label(1) == "CA of A:GLY13B (atom 1)"


def test_label_of_a_bead_without_names():
    assert AtomTable.beads(3, number=1).label(2) == "bead 3 (atom 2)"
    assert AtomTable.beads(3, molecule=np.array([7, 7, 7])).label(0) == "bead 7:0 (atom 0)"


@pytest.mark.parametrize("resname", ["CA", "CAL", "CA2+", "Ca+", "ZN", "NA+", "W", "TIP3"])
def test_calcium_and_other_lone_ions_are_left_out_with_a_note(resname):
    table = residue_table(
        [1, 2, 3, 401],
        resname=["ALA", "GLY", "ALA", resname],
        kind=["protein"] * 3 + [""],
        size=[10, 7, 10, 1],
    )
    rows, notes = usable_rows(table)
    assert rows.tolist() == [0, 1, 2]
    assert notes == [f"Left out 1 ion or water bead: 1 CA of {resname}."]


def test_a_metal_is_known_by_its_element_when_its_residue_has_another_name():
    table = residue_table([1, 2, 3], kind=["protein", "protein", ""], element=["C", "C", "CA"], resname="UNK")
    table = replace(table, residue_size=np.array([10, 10, 1]))
    assert usable_rows(table)[0].tolist() == [0, 1]
    assert usable_rows(replace(table, element=np.array(["C", "C", "C"])))[0].tolist() == [0, 1, 2]


def test_an_alpha_carbon_model_is_no_row_of_ions():
    assert usable_rows(residue_table([1, 2, 3], size=1))[0].tolist() == [0, 1, 2]


def test_a_residue_named_like_an_ion_but_with_more_atoms_is_kept():
    assert len(usable_rows(residue_table([1, 2], resname="CA", kind="", size=2))[0]) == 2


def test_a_selection_of_nothing_but_calcium_is_refused():
    table = residue_table([301, 302], resname="CAL", kind="", size=1)
    with pytest.raises(StrandError, match=r"nothing but ions or water beads, 2 CA of CAL, .* select backbone"):
        usable_rows(table)


@pytest.mark.parametrize(("occupancy", "kept"), [((0.4, 0.6), 2), ((0.6, 0.4), 1), ((0.5, 0.5), 1)])
def test_of_alternate_locations_the_one_with_the_highest_occupancy_is_kept(occupancy, kept):
    table = residue_table(
        [1, 2, 2, 3], altloc=["", "A", "B", ""], occupancy=np.array([1.0, *occupancy, 1.0]), chain="A"
    )
    rows, notes = usable_rows(table)
    assert rows.tolist() == [0, kept, 3]
    assert notes[0].startswith("Left out 1 alternate location:")


def test_three_alternate_locations_leave_one():
    table = residue_table([1, 1, 1, 2], altloc=["A", "B", "C", ""], occupancy=np.array([0.3, 0.5, 0.2, 1.0]))
    assert usable_rows(table)[0].tolist() == [1, 3]


def test_alternate_locations_with_other_residue_names_are_one_residue():
    table = residue_table([1, 2, 2], resname=["ALA", "SER", "THR"], altloc=["", "A", "B"])
    assert usable_rows(table)[0].tolist() == [0, 1]


def test_alternate_locations_of_different_atoms_are_no_doubles():
    table = residue_table([1, 1, 2], name=["N", "CA", "N"], altloc=["A", "A", "A"])
    assert usable_rows(table)[0].tolist() == [0, 1, 2]


def test_insertion_codes_are_no_alternate_locations():
    table = residue_table([27, 27, 27], icode=["", "A", "B"])
    rows, notes = usable_rows(table)
    assert (rows.tolist(), notes) == ([0, 1, 2], [])
