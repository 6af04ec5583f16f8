from dataclasses import replace

import numpy as np
import pytest
from atom_tables import chain_bonds, residue_table

from mdtopo.strands import AtomTable
from mdtopo.strands.links import REACH, BondGraph, backbone_links, has_bonds

N, CA, C, CB, SG = range(5)
"""Order of the atoms in each residue of the peptides of these tests."""


def peptide_bonds(n_residues, disulfides=()):
    bonds = []
    for residue in range(n_residues):
        first = 5 * residue
        bonds += [(first + N, first + CA), (first + CA, first + C), (first + CA, first + CB)]
        bonds += [(first + CB, first + SG)]
        bonds += [(first + C, first + 5 + N)] if residue + 1 < n_residues else []
    bonds += [(5 * i + SG, 5 * j + SG) for i, j in disulfides]
    return np.array(bonds)


def peptide(n_residues, atoms=(CA,), **changes):
    names = np.array(["N", "CA", "C", "CB", "SG"])
    table = residue_table(
        np.repeat(np.arange(1, n_residues + 1), len(atoms)), name=np.tile(names[list(atoms)], n_residues)
    )
    residue = np.repeat(np.arange(n_residues), len(atoms))
    index = 5 * residue + np.tile(atoms, n_residues)
    return replace(table, residue=residue, atom_index=index, bonds=peptide_bonds(n_residues, **changes))


def links(table):
    rows = np.arange(len(table))
    return backbone_links(table, rows, BondGraph(table, rows)).tolist()


def consecutive(n):
    return [[k, k + 1] for k in range(n - 1)]


def test_alpha_carbons_are_linked_through_the_peptide_bond():
    assert links(peptide(5)) == consecutive(5)


def test_a_disulfide_is_no_link_of_an_alpha_carbon_trace():
    assert links(peptide(8, disulfides=[(1, 6)])) == consecutive(8)


def test_a_disulfide_is_no_link_of_a_backbone_of_three_atoms():
    assert links(peptide(8, atoms=(N, CA, C), disulfides=[(1, 6)])) == consecutive(24)


def test_a_disulfide_between_neighbours_changes_nothing():
    assert links(peptide(6, disulfides=[(2, 3)])) == consecutive(6)


def test_direct_bonds_of_beads_are_all_links():
    bonds = np.concatenate([chain_bonds(range(6)), [[0, 3], [1, 5]]])
    assert links(AtomTable.beads(6, bonds=bonds)) == sorted([*consecutive(6), [0, 3], [1, 5]])


@pytest.mark.parametrize(("length", "is_link"), [(REACH, True), (REACH + 1, False)])
def test_paths_of_bonds_have_a_reach(length, is_link):
    table = replace(AtomTable.beads(2, bonds=chain_bonds(range(length + 1))), atom_index=np.array([0, length]))
    assert links(table) == ([[0, 1]] if is_link else [])


def test_a_path_ends_at_a_selected_atom_of_another_chain():
    table = AtomTable.beads(5, bonds=chain_bonds(range(5)))
    graph = BondGraph(table, np.arange(5))
    assert backbone_links(table, np.array([0, 1, 3, 4]), graph).tolist() == [[0, 1], [3, 4]]


def test_bonds_of_disulfides_alone_do_not_describe_a_chain():
    rows = np.arange(8)
    table = peptide(8)
    assert has_bonds(table, rows)
    assert not has_bonds(replace(table, bonds=np.array([[9, 34]])), rows)
    assert not has_bonds(replace(table, bonds=None), rows)
    assert not has_bonds(replace(table, bonds=np.empty((0, 2), dtype=np.int64)), rows)


@pytest.mark.parametrize(("n_bonded", "answer"), [(4, False), (5, True)])
def test_bonds_count_when_more_than_half_of_the_atoms_have_one(n_bonded, answer):
    bonds = np.array([[k, 100 + k] for k in range(n_bonded)])
    assert has_bonds(AtomTable.beads(8, bonds=bonds), np.arange(8)) is answer
