from dataclasses import replace

import numpy as np
import pytest
from atom_tables import chain_bonds, line, residue_table

from mdtopo.errors import StrandError
from mdtopo.strands import AtomTable
from mdtopo.strands.chains import bonded_chains, candidate_pairs, molecules, ordered_chains
from mdtopo.strands.links import BondGraph
from mdtopo.strands.steps import StepCheck


def runs_without_bonds(table, positions=None, cut=None):
    """Return rows and reasons of the chains of a table, its bonds not used."""
    groups = molecules(table, np.arange(len(table)))
    positions = line(len(table)) if positions is None else positions
    check = StepCheck(table, candidate_pairs(table, groups), positions, None, cut)
    return [
        ([run.rows for run in chain.runs], chain.reasons)
        for group in groups
        for chain in ordered_chains(table, group, check)
    ]


def runs_by_bonds(table):
    """Return rows and closing of each run, and the notes."""
    rows = np.arange(len(table))
    chains, notes = bonded_chains(table, rows, BondGraph(table, rows))
    return [[(run.rows, run.closed) for run in chain.runs] for chain in chains], notes


def beads(n, *bonds):
    return AtomTable.beads(n, bonds=np.array(bonds))


def test_molecules_come_before_chains():
    table = residue_table([1, 2, 3, 4], chain=["A", "A", "B", "B"], molecule=np.array([0, 1, 1, 0]))
    rows = np.arange(4)
    assert [group.tolist() for group in molecules(table, rows)] == [[0, 3], [1, 2]]
    without = replace(table, molecule=None)
    assert [group.tolist() for group in molecules(without, rows)] == [[0, 1], [2, 3]]


def test_a_chain_whose_atoms_are_stored_in_two_places_is_one_group():
    table = residue_table([1, 2, 1, 2, 3], chain=["A", "A", "B", "B", "A"])
    assert [group.tolist() for group in molecules(table, np.arange(5))] == [[0, 1, 4], [2, 3]]


class TestWithoutBonds:
    def test_consecutive_residues_are_one_run(self):
        assert runs_without_bonds(residue_table([1, 2, 3])) == [([[0, 1, 2]], [])]

    def test_residue_numbers_that_restart_end_a_chain(self):
        assert runs_without_bonds(residue_table([7, 8, 9, 7, 8])) == [([[0, 1, 2]], []), ([[3, 4]], [])]

    def test_a_repeated_number_ends_a_chain(self):
        # one residue ends chain one, the same number starts chain two
        assert runs_without_bonds(residue_table([4, 5, 5, 6])) == [([[0, 1]], []), ([[2, 3]], [])]

    def test_insertion_codes_repeat_a_number_within_a_chain(self):
        table = residue_table([27, 27, 27, 28], icode=["", "A", "B", ""])
        assert runs_without_bonds(table) == [([[0, 1, 2, 3]], [])]

    @pytest.mark.parametrize(("last", "first", "n_chains"), [(99999, 0, 1), (9999, 1, 1), (99998, 0, 2), (99999, 2, 2)])
    def test_numbers_of_five_digits_start_again_within_a_chain(self, last, first, n_chains):
        table = residue_table([last - 1, last, first, first + 1])
        assert len(runs_without_bonds(table)) == n_chains

    def test_a_chain_that_goes_on_counting_ends_at_a_long_step(self):
        positions = line(6)
        positions[3:, 0] += 20.0
        ((runs, reasons),) = runs_without_bonds(residue_table([1, 2, 3, 4, 5, 6]), positions)
        assert runs == [[0, 1, 2], [3, 4, 5]]
        assert "CA of ALA3 (atom 2) and CA of ALA4 (atom 3) are 23.8 Å apart" in reasons[0]

    def test_protein_and_nucleic_acid_are_never_joined(self):
        table = residue_table([1, 2, 3, 4], kind=["protein", "protein", "nucleic", "nucleic"])
        assert runs_without_bonds(table) == [([[0, 1]], []), ([[2, 3]], [])]

    def test_another_segment_ends_a_chain_within_a_molecule(self):
        table = residue_table([1, 2, 3, 4], segid=["P", "P", "Q", "Q"], molecule=np.zeros(4, dtype=np.int64))
        assert runs_without_bonds(table) == [([[0, 1]], []), ([[2, 3]], [])]

    def test_phosphates_of_lipids_are_never_joined(self):
        table = residue_table([297, 298, 299], name="P", resname="POPE", kind="", size=134)
        assert runs_without_bonds(table, line(3, 8.0)) == [([[0]], []), ([[1]], []), ([[2]], [])]

    def test_phosphates_of_dna_are(self):
        table = residue_table([297, 298, 299], name="P", resname="DA", kind="nucleic", size=32)
        assert runs_without_bonds(table, line(3, 6.5)) == [([[0, 1, 2]], [])]

    def test_a_lipid_after_dna_in_the_same_segment_is_not_joined_to_it(self):
        table = residue_table([1, 2, 3, 4], name="P", kind=["nucleic", "nucleic", "", ""], size=[32, 32, 134, 134])
        assert runs_without_bonds(table, line(4, 6.5))[0] == ([[0, 1]], [])

    def test_atoms_of_one_residue_are_joined_whatever_the_residue_is(self):
        table = replace(residue_table([1, 1, 1], kind="", size=3), residue=np.zeros(3, dtype=np.int64))
        assert runs_without_bonds(table) == [([[0, 1, 2]], [])]

    def test_beads_of_one_molecule_are_joined_in_order(self):
        table = AtomTable.beads(5, molecule=np.array([1, 1, 1, 2, 2]))
        assert runs_without_bonds(table) == [([[0, 1, 2]], []), ([[3, 4]], [])]


class TestBonded:
    def test_two_chains_and_a_ring(self):
        bonds = np.concatenate([chain_bonds([0, 1, 2], [3, 4]), chain_bonds([5, 6, 7], closed=True)])
        found, notes = runs_by_bonds(AtomTable.beads(8, bonds=bonds))
        assert found == [[([0, 1, 2], False)], [([3, 4], False)], [([5, 6, 7], True)]]
        assert notes == []

    def test_the_bonds_give_the_order(self):
        assert runs_by_bonds(beads(5, (0, 3), (3, 1), (1, 4), (4, 2)))[0] == [[([0, 3, 1, 4, 2], False)]]

    def test_a_ring_starts_with_its_first_stored_atom(self):
        assert runs_by_bonds(beads(5, (0, 3), (3, 1), (1, 4), (4, 2), (2, 0)))[0] == [[([0, 2, 4, 1, 3], True)]]

    def test_a_bond_that_is_listed_twice_counts_once(self):
        assert runs_by_bonds(beads(3, (0, 1), (1, 0), (1, 2), (1, 2)))[0] == [[([0, 1, 2], False)]]

    def test_rungs_within_a_molecule_are_no_edges(self):
        bonds = np.concatenate([chain_bonds(range(8)), [[0, 7], [1, 6], [2, 5]]])
        found, notes = runs_by_bonds(AtomTable.beads(8, bonds=bonds))
        assert found == [[([*range(8)], True)]]
        assert "2 bonds of bead 0 (atom 0) … bead 7 (atom 7)" in notes[0]

    def test_an_elastic_network_does_not_close_a_chain(self):
        # both ends have other bonds to spare, so the one between them is a spring like the others
        bonds = np.concatenate([chain_bonds(range(6)), [[0, 5], [0, 2], [3, 5], [1, 4]]])
        found, _ = runs_by_bonds(AtomTable.beads(6, bonds=bonds))
        assert found == [[([*range(6)], False)]]

    def test_a_star_is_refused_and_its_centre_named(self):
        arms = [(0, 1), (1, 2), (0, 3), (3, 4), (0, 5), (5, 6)]
        with pytest.raises(StrandError, match=r"branch at bead 0 \(atom 0\), joined to 3 others, and bead 2"):
            runs_by_bonds(beads(7, *arms))

    def test_whole_residues_are_refused(self):
        table = replace(
            residue_table([1, 1, 1, 2], name=["N", "CA", "HA", "N"]),
            residue=np.array([0, 0, 0, 1]),
            bonds=np.array([[0, 1], [1, 2], [1, 3]]),
        )
        with pytest.raises(StrandError, match=r"branch at CA of ALA1 \(atom 1\).*Select backbone atoms only"):
            runs_by_bonds(table)

    def test_a_network_over_a_chain_of_residues_with_a_gap_leaves_the_gap(self):
        bonds = np.concatenate([chain_bonds([0, 1, 2], [3, 4, 5]), [[0, 2], [1, 3], [2, 5], [3, 5]]])
        table = replace(residue_table([1, 2, 3, 9, 10, 11], name="BB"), bonds=bonds)
        found, _ = runs_by_bonds(table)
        assert found == [[([0, 1, 2], False), ([3, 4, 5], False)]]

    def test_residues_without_a_bond_between_them_are_a_gap(self):
        table = replace(residue_table([1, 2, 7, 8]), bonds=chain_bonds([0, 1], [2, 3]))
        rows = np.arange(4)
        (chain,), _ = bonded_chains(table, rows, BondGraph(table, rows))
        assert chain.reasons == ["no bond joins CA of ALA2 (atom 1) to CA of ALA7 (atom 2)"]

    def test_residues_that_restart_without_a_bond_are_two_chains(self):
        table = replace(residue_table([1, 2, 1, 2]), bonds=chain_bonds([0, 1], [2, 3]))
        assert len(runs_by_bonds(table)[0]) == 2

    def test_beads_without_a_bond_between_them_are_two_chains(self):
        assert len(runs_by_bonds(beads(4, (0, 1), (2, 3)))[0]) == 2
