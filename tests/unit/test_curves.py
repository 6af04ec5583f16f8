"""From frames to the motion of a step: whole strands, images chosen beside each other, one rigid motion out."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.curves import StepMotion, edge_lengths, matching_basis, step_motion, whole_strands
from mdtopo.geometry.lattice import basis_of
from mdtopo.records import Strands, Traces

Points = NDArray[np.float64]

STRANDS = Strands.from_lengths([6, 6, 4], closed=[False, False, True])
T = Traces.of(STRANDS)
TRICLINIC = np.array([[14.0, 0, 0], [-4, 13, 0], [5, -5, 12]])


def strands() -> Points:
    """Two open strands side by side and a square above, whole, around (7, 6, 6)."""
    x = np.zeros((16, 3))
    x[:6, 0] = x[6:12, 0] = 1.2 * np.arange(6)
    x[6:12, 1] = 2.0
    x[12:] = [[2, 0, 2], [3.2, 0, 2], [3.2, 1.2, 2], [2, 1.2, 2]]
    return x + np.array([4.0, 5.0, 5.0])


def wrap(x: Points, cell: Points) -> Points:
    return np.asarray(x - np.floor(x @ np.linalg.inv(cell)) @ cell)


def whole(x: Points, cell: Points) -> tuple[Points, Points]:
    found, basis, winding, *_ = whole_strands(x, cell, T.vertices, T.offsets, T.closed)
    assert not winding.any()
    return found, basis


def motion_of(
    x0: Points, x1: Points, cell0: Points, cell1: Points, *, rigid: bool = False, rotation: Points | None = None
) -> StepMotion:
    (a, h0), (b, h1) = whole(x0, cell0), whole(x1, cell1)
    turn = np.eye(3) if rotation is None else rotation
    return step_motion(a, b, h0, h1, 0.0, True, rigid, turn, T.vertices, T.offsets)


def free_motion(x0: Points, x1: Points, *, rigid: bool, rotation: Points | None = None) -> StepMotion:
    none, turn = np.zeros((3, 3)), np.eye(3) if rotation is None else rotation
    return step_motion(x0, x1, none, none, 0.0, False, rigid, turn, T.vertices, T.offsets)


CELLS = {"cube": 14.0 * np.eye(3), "triclinic": TRICLINIC}


@pytest.mark.parametrize("cell", CELLS)
def test_strands_stored_in_pieces_are_made_whole_and_lie_together(cell: str) -> None:
    rng, h, x = np.random.default_rng(1), CELLS[cell], strands()
    for stored in (x, wrap(x + np.array([7.0, 1.0, 6.0]), h), x + rng.integers(-2, 3, x.shape) @ h):
        found, _ = whole(stored, h)
        np.testing.assert_allclose(found - found[0], x - x[0], atol=1e-9)
        np.testing.assert_array_equal(found[0], stored[0])
        np.testing.assert_allclose(edge_lengths(found, T.edges), edge_lengths(x, T.edges), atol=1e-9)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("rigid", [False, True])
def test_a_file_that_is_centred_anew_by_half_a_cell_tears_no_strand_away(cell: str, rigid: bool) -> None:
    rng, h, x = np.random.default_rng(2), CELLS[cell], strands()
    for counts in ((0.5, 0.5, 0.5), (0.5, 0, 0), (0.49, 0.51, 0.5), (0.3, -0.5, 0.2)):
        moved = x + rng.normal(0, 0.05, x.shape)
        motion = motion_of(wrap(x, h), wrap(moved + np.array(counts) @ h, h), h, h, rigid=rigid)
        shift = (motion.x1 - motion.x0) - (moved - x)
        np.testing.assert_allclose(shift, np.tile(shift[0], (len(x), 1)), atol=1e-9)
        if rigid:
            np.testing.assert_allclose((motion.x1 - motion.x0).mean(axis=0), 0.0, atol=1e-9)


def test_a_strand_that_crosses_the_boundary_between_two_frames_is_placed_beside_where_it_was() -> None:
    h, x = CELLS["cube"], strands()
    moved = x + np.array([0.3, 0, 0])
    stored = moved.copy()
    stored[6:12] += [-14.0, 14.0, 28.0]  # one strand is written in another image
    motion = motion_of(x, stored, h, h)
    np.testing.assert_allclose(motion.x1 - motion.x0, np.tile([0.3, 0, 0], (16, 1)), atol=1e-9)


FLIPS = {
    "b + a": [[1, 0, 0], [1, 1, 0], [0, 0, 1]],
    "c - a": [[1, 0, 0], [0, 1, 0], [-1, 0, 1]],
    "c - b + a": [[1, 0, 0], [0, 1, 0], [1, -1, 1]],
    "permuted": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "negated": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]],
}


@pytest.mark.parametrize("flip", FLIPS)
def test_an_engine_that_flips_a_triclinic_cell_gives_the_same_motion(flip: str) -> None:
    rng, x = np.random.default_rng(3), strands()
    moved = x + rng.normal(0, 0.1, x.shape)
    after = TRICLINIC @ (np.eye(3) + rng.normal(0, 0.005, (3, 3)))
    flipped = np.array(FLIPS[flip]) @ after
    plain = motion_of(x, moved, TRICLINIC, after)
    other = motion_of(x, wrap(moved, flipped), TRICLINIC, flipped)
    assert other.usable
    np.testing.assert_allclose(other.cell1, plain.cell1, atol=1e-9)
    np.testing.assert_allclose(other.cell0, plain.cell0, atol=1e-9)
    between = (other.x1 - plain.x1) @ np.linalg.inv(plain.cell1)  # one lattice vector, the same for all
    np.testing.assert_allclose(between, np.rint(between[:1]).repeat(16, axis=0), atol=1e-9)
    assert np.abs(other.x1 - other.x0).max() < 0.5


def test_matching_the_cell_of_another_lattice_leaves_it_as_it_is() -> None:
    other = basis_of(np.diag([14.0, 29.0, 12.0]))
    assert matching_basis(basis_of(14.0 * np.eye(3)), other) == other


def test_the_lab_frame_leaves_coordinates_that_are_not_periodic_bit_for_bit() -> None:
    rng = np.random.default_rng(4)
    x0, x1 = rng.normal(0, 50, (16, 3)), rng.normal(0, 50, (16, 3))
    kept0, kept1 = x0.copy(), x1.copy()
    motion = free_motion(x0, x1, rigid=False)
    assert motion.x0.tobytes() == kept0.tobytes()
    assert motion.x1.tobytes() == kept1.tobytes()
    assert x1.tobytes() == kept1.tobytes()
    assert (motion.is_turned, motion.usable, motion.translation) == (False, True, (0.0, 0.0, 0.0))
    assert motion.placing == 0.0


def test_the_rigid_motion_is_taken_out_and_its_translation_told() -> None:
    x, turn = strands(), np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
    given = x.copy()
    motion = free_motion(x, x @ turn.T + [3.0, -1.0, 2.0], rigid=True, rotation=np.ascontiguousarray(turn.T))
    np.testing.assert_allclose(motion.x1, x, atol=1e-12)
    assert motion.is_turned
    # the shift of the centroid, as stored
    np.testing.assert_allclose(motion.translation, (x @ turn.T + [3.0, -1.0, 2.0] - x).mean(axis=0), atol=1e-12)
    np.testing.assert_array_equal(x, given)


def test_the_cell_turns_along_with_the_strands() -> None:
    angle, x, h = 0.05, strands(), CELLS["cube"]
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    motion = motion_of(x, x @ turn.T, h, h @ turn.T, rigid=True, rotation=np.ascontiguousarray(turn.T))
    assert motion.is_turned
    np.testing.assert_allclose(motion.cell1, motion.cell0, atol=1e-12)
    np.testing.assert_allclose(motion.x1, motion.x0, atol=1e-12)


def test_no_rotation_is_taken_out_of_a_box_that_would_turn_too_far_with_it() -> None:
    x, h = strands(), CELLS["cube"]
    half_turn = np.diag([-1.0, -1.0, 1.0])
    motion = motion_of(x, x + 0.1, h, h, rigid=True, rotation=half_turn)
    assert (motion.is_turned, motion.usable) == (False, True)
    np.testing.assert_allclose(motion.x1, motion.x0, atol=1e-12)
    np.testing.assert_allclose(motion.translation, [0.1] * 3, atol=1e-12)


@pytest.mark.parametrize(("factor", "usable"), [(1.2, True), (30.0, False)])
def test_a_cell_that_changes_too_much_is_said_to_be_unusable(factor: float, usable: bool) -> None:
    x, h = strands(), CELLS["cube"]
    assert motion_of(x, x, h, factor * h).usable == usable


def test_a_ring_through_the_boundary_has_a_winding() -> None:
    x = strands()
    x[12:] = [[0, 0, 0], [3.5, 0, 0], [7.0, 0, 0], [10.5, 0, 0]]
    _, _, winding, *_ = whole_strands(x, CELLS["cube"], T.vertices, T.offsets, T.closed)
    assert winding.tolist() == [[0, 0, 0], [0, 0, 0], [1, 0, 0]]
