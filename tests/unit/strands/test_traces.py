from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from atom_tables import chain_bonds, edge_atoms, line, residue_table, strand_atoms
from hypothesis import given
from hypothesis import strategies as st

from mdtopo.errors import StrandError
from mdtopo.strands import AtomTable, strands_from_atoms


def test_one_chain_is_one_strand_with_its_labels():
    traces = strands_from_atoms(residue_table([5, 6, 7], chain="A", resname="GLY"), line(3))
    assert traces.order.tolist() == [0, 1, 2]
    assert traces.strands.names == ("chain A",)
    assert traces.strands.labels.text(2) == "A:GLY7"
    assert traces.strands.labels.atom.tolist() == ["CA"] * 3
    assert (traces.strands.gaps, traces.notes) == ((), ())


def test_atoms_out_of_order_are_put_in_order():
    bonds = np.array([[2, 0], [0, 3], [3, 1]])
    traces = strands_from_atoms(AtomTable.beads(4, bonds=bonds), line(4))
    assert traces.order.tolist() == [1, 3, 0, 2]
    assert traces.strands.labels.atom_index.tolist() == [1, 3, 0, 2]


chains = st.lists(st.tuples(st.integers(2, 7), st.booleans()), min_size=1, max_size=5)


@given(chains=chains, data=st.data())
def test_the_storage_order_does_not_matter_where_bonds_are_known(chains, data):
    chains = [(n, closed and n > 2) for n, closed in chains]
    offsets = np.concatenate([[0], np.cumsum([n for n, _ in chains])])
    parts = [list(range(a, b)) for a, b in pairwise(offsets.tolist())]
    bonds = np.concatenate([chain_bonds(p, closed=c) for p, (_, c) in zip(parts, chains, strict=True)])
    molecule = np.repeat(np.arange(len(chains)), [n for n, _ in chains])
    place = np.array(data.draw(st.permutations(range(len(molecule)))))  # where each bead is stored
    stored = AtomTable.beads(len(place), molecule=molecule[np.argsort(place)], bonds=place[bonds])
    traces = strands_from_atoms(stored, np.zeros((len(place), 3)))
    assert edge_atoms(traces) == {frozenset(place[bond].tolist()) for bond in bonds}
    assert sorted(map(sorted, strand_atoms(traces))) == sorted(sorted(place[p].tolist()) for p in parts)
    for atoms, closed in zip(strand_atoms(traces), traces.strands.closed, strict=True):
        assert closed == next(c for p, (_, c) in zip(parts, chains, strict=True) if atoms[0] in place[p])


def test_rungs_between_molecules_are_no_edges_and_are_counted():
    bonds = np.concatenate([chain_bonds([0, 1, 2], [3, 4, 5]), [[0, 5], [1, 4], [2, 3]]])
    traces = strands_from_atoms(AtomTable.beads(6, molecule=np.repeat([1, 2], 3), bonds=bonds), line(6))
    assert strand_atoms(traces) == [[0, 1, 2], [3, 4, 5]]
    assert traces.strands.names == ("molecule 1", "molecule 2")
    assert "there are 3 bonds, first bead 1:0 (atom 0) to bead 2:5 (atom 5)" in traces.notes[0]


def test_bonds_of_disulfides_alone_leave_the_chain_to_the_other_rules():
    table = replace(residue_table([1, 2, 3, 4, 5, 6]), bonds=np.array([[101, 104]]))
    assert strand_atoms(strands_from_atoms(table, line(6))) == [[0, 1, 2, 3, 4, 5]]


def test_use_bonds_no_takes_the_stored_order():
    table = AtomTable.beads(4, bonds=np.array([[2, 0], [0, 3], [3, 1]]))
    traces = strands_from_atoms(table, line(4, 1.0), use_bonds=False)
    assert traces.order.tolist() == [0, 1, 2, 3]


def test_a_gap_is_reported_between_its_vertices_and_names_its_residues():
    positions = line(6)
    positions[3:, 0] += 30.0
    strands = strands_from_atoms(residue_table([1, 2, 3, 8, 9, 10], chain="B"), positions).strands
    assert strands.names == ("chain B 1-3", "chain B 8-10")
    (gap,) = strands.gaps
    assert gap.vertices == (2, 3)
    assert "4 residue numbers missing" in gap.reason


def test_a_residue_between_two_gaps_is_left_out_and_one_gap_remains():
    positions = line(5)
    positions[2:, 0] += 30.0
    positions[3:, 0] += 30.0
    traces = strands_from_atoms(residue_table([1, 2, 10, 20, 21]), positions)
    assert traces.strands.labels.resid.tolist() == [1, 2, 20, 21]
    assert [gap.vertices for gap in traces.strands.gaps] == [(1, 2)]
    assert traces.notes == ("Left out 1 atom joined to no other selected one: 1 CA of ALA.",)


def test_gaps_of_a_second_chain_count_on_from_the_first():
    positions = line(8)
    positions[6:, 0] += 30.0
    table = residue_table([1, 2, 3, 4, 1, 2, 3, 4], chain=["A"] * 4 + ["B"] * 4)
    assert [gap.vertices for gap in strands_from_atoms(table, positions).strands.gaps] == [(5, 6)]


def test_two_chains_of_one_segment_get_numbers_for_names():
    strands = strands_from_atoms(residue_table([7, 8, 7, 8]), line(4)).strands
    assert strands.names == ("strand 0", "strand 1")
    assert [strands.labels.text(v) for v in (0, 2)] == ["0:ALA7", "1:ALA7"]


def test_two_chains_of_one_label_are_told_apart():
    strands = strands_from_atoms(residue_table([7, 8, 7, 8], chain="A"), line(4)).strands
    assert strands.names == ("chain A", "chain A#2")
    assert [strands.labels.text(v) for v in (0, 2)] == ["A:ALA7", "A#2:ALA7"]


def test_a_label_that_looks_like_a_numbered_one_does_not_clash():
    table = residue_table([7, 8, 7, 8, 1, 2], chain=["A"] * 4 + ["A#2"] * 2)
    names = strands_from_atoms(table, line(6)).strands.names
    assert len(set(names)) == 3


def test_calcium_is_left_out_beside_a_protein():
    table = residue_table(
        [1, 2, 3, 301], resname=["ALA"] * 3 + ["CA"], kind=["protein"] * 3 + [""], size=[10, 10, 10, 1]
    )
    traces = strands_from_atoms(table, line(4))  # the ion is as near as a neighbour
    assert strand_atoms(traces) == [[0, 1, 2]]
    assert traces.notes == ("Left out 1 ion or water bead: 1 CA of CA.",)


def test_lipids_beside_dna_are_left_out_with_a_note():
    table = residue_table(
        [1, 2, 3, 1, 2],
        name="P",
        resname=["DA"] * 3 + ["POPC"] * 2,
        kind=["nucleic"] * 3 + [""] * 2,
        size=[32] * 3 + [134] * 2,
    )
    traces = strands_from_atoms(table, line(5, 6.5))
    assert strand_atoms(traces) == [[0, 1, 2]]
    assert traces.notes == ("Left out 2 atoms joined to no other selected one: 2 P of POPC.",)


def test_lipids_with_bonds_are_left_out_too():
    table = replace(
        residue_table([1, 2, 3], name="P", resname="POPC", kind="", size=134),
        atom_index=np.array([0, 134, 268]),
        bonds=np.array([[0, 1], [134, 135], [268, 269]]),
    )
    with pytest.raises(StrandError, match=r"No two of the 3 selected atoms are joined \(3 P of POPC\)"):
        strands_from_atoms(table, line(3))


def test_nothing_but_lipids_is_refused_with_a_cure():
    table = residue_table([297, 298], name="P", resname="POPE", kind="", size=134)
    with pytest.raises(StrandError, match=r"first is P of POPE297 \(atom 0\). Select backbone atoms, give"):
        strands_from_atoms(table, line(2, 6.0))


def test_a_single_vertex_is_refused_by_name():
    with pytest.raises(StrandError, match=r"leaves a single vertex, CA of A:ALA5 \(atom 0\); a strand needs"):
        strands_from_atoms(residue_table([5], chain="A"), line(1))


def plasmid(n=12):
    angle = 2 * np.pi * np.arange(n) / n
    positions = 6.0 * n / (2 * np.pi) * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return residue_table(range(1, n + 1), name="C4'", resname="DA", kind="nucleic"), positions


def test_ends_that_meet_are_noted_where_nothing_says_that_they_close():
    traces = strands_from_atoms(*plasmid())
    assert not traces.strands.closed.any()
    assert traces.notes == (
        "The ends of the strand from C4' of DA1 (atom 0) on are as near as neighbours; "
        "if it is a ring, pass --reader-option close_ends=yes.",
    )


def test_ends_that_meet_close_a_ring_on_demand():
    traces = strands_from_atoms(*plasmid(), close_ends=True)
    assert traces.strands.edges[-1].tolist() == [11, 0]
    assert traces.notes == ()


def test_ends_of_a_protein_often_meet_and_are_not_noted():
    table, positions = plasmid()
    assert strands_from_atoms(replace(table, residue_kind=np.full(12, "protein")), positions).notes == ()


@pytest.mark.parametrize(("n", "closed"), [(3, False), (4, True)])
def test_three_atoms_are_no_ring(n, closed):
    traces = strands_from_atoms(*plasmid(n), close_ends=True)
    assert traces.strands.closed.tolist() == [closed]


def test_an_open_chain_is_not_closed_on_demand():
    traces = strands_from_atoms(residue_table(range(1, 8)), line(7), close_ends=True)
    assert not traces.strands.closed.any()


def test_every_edge_of_a_torn_ring_is_found_through_the_boundary():
    table, positions = plasmid(20)
    side = np.ptp(positions[:, 0]) + 1.0
    cell = np.diag([side, side, 50.0])
    wrapped = (positions + 3.0) % [side, side, 50.0]
    strands = strands_from_atoms(table, wrapped, cell, close_ends=True).strands
    assert (strands.closed.tolist(), strands.n_vertices, strands.gaps) == ([True], 20, ())
