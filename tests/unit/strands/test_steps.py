from itertools import product

import numpy as np
import pytest
from atom_tables import line, residue_table
from hypothesis import given
from hypothesis import strategies as st

from mdtopo.strands import AtomTable
from mdtopo.strands.steps import CA_CUT, MEDIAN_FACTOR, NUCLEIC_CUT, SKIP_FACTOR, StepCheck, nearest_steps

DODECAHEDRON = np.array([[70.0, 0.0, 0.0], [0.0, 70.0, 0.0], [35.0, 35.0, 49.5]])
SKEWED = np.array([[10.0, 0.0, 0.0], [9.0, 3.0, 0.0], [4.0, 2.5, 6.0]])


def check(table, positions, cell=None, cut=None):
    rows = np.arange(len(table))
    return StepCheck(table, np.stack([rows[:-1], rows[1:]], axis=1), positions, cell, cut)


def stretched(n, place, length, step=3.8):
    """Return a line of which one step has another length."""
    positions = line(n, step)
    positions[place + 1 :, 0] += length - step
    return positions


def test_without_a_cell_a_step_is_its_length():
    assert nearest_steps(np.array([[3.0, 4.0, 0.0]]), None).tolist() == [5.0]


@pytest.mark.parametrize("cell", [np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_a_cell_that_is_none_is_not_periodic(cell):
    assert nearest_steps(np.array([[30.0, 40.0, 0.0]]), cell).tolist() == [50.0]


@pytest.mark.parametrize("cell", [DODECAHEDRON, SKEWED, np.diag([5.0, 7.0, 90.0])])
@given(fractions=st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
def test_nearest_step_agrees_with_a_search_over_many_images(cell, fractions):
    difference = np.array(fractions) @ cell
    images = [difference + np.array(shift) @ cell for shift in product(range(-6, 7), repeat=3)]
    expected = min(np.linalg.norm(image) for image in images)
    assert nearest_steps(difference[None, :], cell)[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("factor", "is_gap"), [(1.0 - 1e-9, False), (1.0 + 1e-9, True)])
@pytest.mark.parametrize(
    ("name", "kind", "step", "cut"),
    [
        ("CA", "protein", 3.8, CA_CUT),
        ("C4'", "nucleic", 6.0, NUCLEIC_CUT),
        ("C4*", "nucleic", 6.0, NUCLEIC_CUT),
        ("P", "nucleic", 6.0, NUCLEIC_CUT),
        ("BB", "protein", 3.5, MEDIAN_FACTOR * 3.5),
        ("", "", 0.97, MEDIAN_FACTOR * 0.97),
    ],
)
def test_near_misses_on_both_sides_of_the_default_cut(name, kind, step, cut, factor, is_gap):
    table = residue_table(range(1, 10), name=name, kind=kind)
    found = check(table, stretched(9, 4, cut * factor, step))
    assert bool(found.gap_reason(4, 5)) is is_gap
    assert found.gap_reason(3, 4) == ""


@pytest.mark.parametrize(("factor", "is_gap"), [(1.0 - 1e-9, False), (1.0 + 1e-9, True)])
def test_near_misses_on_both_sides_of_a_given_cut(factor, is_gap):
    table = residue_table(range(1, 10))
    assert bool(check(table, stretched(9, 4, 7.5 * factor), cut=7.5).gap_reason(4, 5)) is is_gap


@pytest.mark.parametrize(("factor", "is_gap"), [(1.0 - 1e-9, False), (1.0 + 1e-9, True)])
def test_the_cut_is_closer_where_residue_numbers_are_missing(factor, is_gap):
    table = residue_table([1, 2, 3, 4, 5, 8, 9, 10, 11], name="BB")
    reason = check(table, stretched(9, 4, SKIP_FACTOR * 3.5 * factor, 3.5)).gap_reason(4, 5)
    assert bool(reason) is is_gap
    assert not is_gap or reason.endswith("with 2 residue numbers missing in between")


def test_numbers_of_beads_may_skip():
    table = AtomTable.beads(9)
    table.resid[5:] += 10
    assert check(table, stretched(9, 4, 2.0, 1.0)).gap_reason(4, 5) == ""


def test_the_reason_names_both_atoms_and_both_lengths():
    reason = check(residue_table(range(1, 10), chain="A"), stretched(9, 4, 12.0)).gap_reason(4, 5)
    assert reason == ("CA of A:ALA5 (atom 4) and CA of A:ALA6 (atom 5) are 12 Å apart, beyond the cut of 5 Å")


def test_a_step_through_the_boundary_is_short():
    cell = np.diag([20.0, 20.0, 20.0])
    positions = line(9) % 20.0
    assert np.linalg.norm(np.diff(positions, axis=0), axis=1).max() > 15.0
    found = check(residue_table(range(1, 10)), positions, cell)
    assert [found.gap_reason(k, k + 1) for k in range(8)] == [""] * 8


def test_a_position_that_is_not_a_number_is_no_gap():
    positions = line(9)
    positions[4] = np.nan
    found = check(residue_table(range(1, 10), name="BB"), positions)
    assert [found.gap_reason(k, k + 1) for k in range(8)] == [""] * 8


def test_the_median_is_not_moved_by_a_few_long_steps():
    positions = line(20, 1.0)
    positions[10:, 0] += 50.0
    positions[15:, 0] += 50.0
    found = check(AtomTable.beads(20), positions)
    assert [k for k in range(19) if found.gap_reason(k, k + 1)] == [9, 14]


@pytest.mark.parametrize(("length", "meets"), [(5.0, True), (5.0 + 1e-9, False)])
def test_ends_meet_within_the_cut(length, meets):
    positions = line(3)
    positions[2] = [0.0, length, 0.0]
    assert check(residue_table([1, 2, 3]), positions).is_short(2, 0) is meets
