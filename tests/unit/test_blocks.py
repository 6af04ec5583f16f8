"""Frames of a block are made whole as each of them would be on its own, whether something has to be moved or not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.blocks import WholeFrames, whole_frames
from mdtopo.curves import edge_lengths, greatest_magnitude, greatest_magnitudes, image_jumps, whole_strands
from mdtopo.pipeline import block_of
from mdtopo.records import Frame, Strands, Traces
from mdtopo.records.frames import LARGEST_COORDINATE

Points = NDArray[np.float64]

CELLS = {"cube": 14.0 * np.eye(3), "triclinic": np.array([[14.0, 0, 0], [-4, 13, 0], [5, -5, 12]])}
SHAPES = (([7], [False]), ([6, 5, 4], [False, True, False]))


def frames_of(
    stored: Points, cells: Points, usable: NDArray[np.bool_], strands: Strands, *, periodic: bool = True
) -> WholeFrames:
    t = Traces.of(strands)
    return whole_frames(stored, cells, usable, periodic, t.vertices, t.offsets, t.closed, t.edges)


def check_each_frame(stored: Points, cells: Points, strands: Strands) -> WholeFrames:
    """Every field is, bit for bit, what `whole_strands` and `image_jumps` say of the frames one by one."""
    t, kept = Traces.of(strands), stored.copy()
    found = frames_of(stored, cells, np.ones(len(stored), dtype=np.bool_), strands)
    before = None
    for k, (x, cell) in enumerate(zip(stored, cells, strict=True)):
        whole, basis, winding, counts, placing = whole_strands(x, cell, t.vertices, t.offsets, t.closed)
        assert found.positions[k].tobytes() == whole.tobytes()
        assert found.cells[k].tobytes() == basis.tobytes()
        assert found.lengths[k].tobytes() == edge_lengths(whole, t.edges).tobytes()
        assert found.placing[k] == placing
        np.testing.assert_array_equal(found.winding[k], winding)
        jumps = 0 if before is None else image_jumps(before, counts, found.cells[k - 1], basis, t.edges)
        assert found.jumps[k] == jumps
        before = counts
    assert stored.tobytes() == kept.tobytes()
    return found


def walks(strands: Strands, n_frames: int, seed: int) -> Points:
    rng = np.random.default_rng(seed)
    bonds = rng.normal(0, 0.6, (n_frames, strands.n_vertices, 3))
    x = np.cumsum(bonds, axis=1)
    for start, stop, closed in zip(strands.offsets[:-1], strands.offsets[1:], strands.closed, strict=True):
        x[:, start:stop] -= x[:, start : start + 1] + rng.uniform(-2, 2, 3)
        if closed:  # as a zigzag, so that the closing edge is short too
            x[:, start:stop] = x[:, start : start + 1] + 0.3 * bonds[:, start:stop]
    return x


@pytest.mark.parametrize(("lengths", "closed"), SHAPES)
@pytest.mark.parametrize("cell", CELLS)
def test_frames_stored_whole_and_in_pieces_follow_each_other(cell: str, lengths: list[int], closed: list[bool]) -> None:
    rng, strands, h = np.random.default_rng(3), Strands.from_lengths(lengths, closed=closed), CELLS[cell]
    x = walks(strands, 12, 1)
    pieces = [0, 3, 4, 8, 11]
    x[pieces] += rng.integers(-1, 2, (len(pieces), strands.n_vertices, 3)) @ h
    found = check_each_frame(x, np.tile(h, (12, 1, 1)), strands)
    assert (found.jumps > 0).tolist() == [k in (1, 3, 4, 5, 8, 9, 11) for k in range(12)]
    check_each_frame(x, h * rng.uniform(0.97, 1.03, (12, 1, 1)), strands)


def test_positions_are_not_copied_where_nothing_is_moved() -> None:
    strands, h = Strands.from_lengths([6, 5]), CELLS["cube"]
    x = walks(strands, 4, 2)
    assert np.shares_memory(check_each_frame(x, np.tile(h, (4, 1, 1)), strands).positions, x)
    x[2, 3] += h[1]
    assert not np.shares_memory(check_each_frame(x, np.tile(h, (4, 1, 1)), strands).positions, x)


@pytest.mark.parametrize("length", [5.0 - 1e-9, np.nextafter(5.0, 0.0), 5.0, np.nextafter(5.0, 6.0), 5.0 + 1e-9])
@pytest.mark.parametrize("closed", [False, True])
def test_an_edge_of_half_a_cell_is_as_by_itself(length: float, closed: bool) -> None:
    strands, h = Strands.from_lengths([3], closed=[closed]), 10.0 * np.eye(3)
    x = np.array([[[0.0, 0, 0], [length, 0, 0], [length, 0.5, 0]]])
    found = check_each_frame(np.concatenate([x, x + 0.25, -x]), np.tile(h, (3, 1, 1)), strands)
    assert found.positions[0, 1, 0] == (length if length <= 5.0 else length - 10.0)


@pytest.mark.parametrize("apart", [4.75, np.nextafter(5.0, 0.0), 5.0, np.nextafter(5.0, 6.0), 5.25, 12.0])
def test_a_strand_that_is_nearer_in_another_image_is_moved_there(apart: float) -> None:
    strands, h = Strands.from_lengths([2, 2]), 10.0 * np.eye(3)
    x = np.array([[[0.0, 0, 0], [1.0, 0, 0], [apart, 0, 0], [apart + 1.0, 0, 0]]])
    found = check_each_frame(np.concatenate([x, -x]), np.tile(h, (2, 1, 1)), strands)
    assert (found.positions[0, 2, 0] == apart) == (apart <= 5.0)


def test_a_frame_that_cannot_be_used_is_left_out() -> None:
    strands, h = Strands.from_lengths([6]), CELLS["triclinic"]
    x, usable = walks(strands, 5, 4), np.array([True, True, False, True, False])
    x[1, 2] += h[0]
    x[2], x[4] = np.nan, np.nan
    cells = np.tile(h, (5, 1, 1))
    cells[4] = np.nan
    found = frames_of(x, cells, usable, strands)
    assert np.isnan(found.lengths).all(axis=1).tolist() == (~usable).tolist()
    assert found.jumps.tolist() == [0, 2, 0, 0, 0]


def test_without_a_cell_frames_stay_as_they_are() -> None:
    strands = Strands.from_lengths([6, 5], closed=[False, True])
    x = 100.0 * walks(strands, 3, 5)
    found = frames_of(x, np.zeros((3, 3, 3)), np.ones(3, dtype=np.bool_), strands, periodic=False)
    assert np.shares_memory(found.positions, x)
    assert found.lengths.tobytes() == np.stack([edge_lengths(one, Traces.of(strands).edges) for one in x]).tobytes()


def test_the_greatest_magnitude_is_that_of_a_plain_search() -> None:
    rng = np.random.default_rng(6)
    for scale in (5e-324, 1e-300, 1.0, 1e12, 1e300):
        for sign in (-1.0, 1.0):
            x = scale * rng.uniform(-1, 1, (rng.integers(1, 40), 3))
            x[rng.integers(len(x)), rng.integers(3)] = sign * scale
            assert greatest_magnitude(x) == np.abs(x).max() == scale
    assert greatest_magnitude(np.array([[-0.0, 0.0, -0.0]])) == 0.0
    assert greatest_magnitude(np.empty((0, 3))) == 0.0
    assert greatest_magnitudes(np.array([[[1.0, -2, 0]], [[3, 0, -0.0]]])).tolist() == [2.0, 3.0]
    for nan in (np.nan, -np.nan):
        assert np.isnan(greatest_magnitude(np.array([[1.0, nan, np.inf], [-np.inf, 2.0, 3.0]])))
    assert greatest_magnitude(np.array([[1.0, -np.inf, 1e308]])) == np.inf


@pytest.mark.parametrize("periodic", [False, True])
def test_a_block_says_of_each_frame_what_the_frame_says(periodic: bool) -> None:
    limit = LARGEST_COORDINATE
    values = [0.0, limit, -limit, np.nextafter(limit, np.inf), -2 * limit, np.nan, -np.inf, 1.0, 1.0, 1.0]
    cells = [np.diag([5.0, 6, 7])] * 7 + [np.diag([5.0, 6, 0]), np.full((3, 3), np.nan), np.diag([5.0, 6, 7])]
    frames = [
        Frame(k, float(k), np.array([[1.0, 2, 3], [4, 5, value]]), cell if periodic else None)
        for k, (value, cell) in enumerate(zip(values, cells, strict=True))
    ]
    problems = block_of(frames, 0, periodic=periodic).problems
    assert problems == tuple(frame.problem for frame in frames)
    assert [bool(problem) for problem in problems] == [False] * 3 + [True] * 4 + [periodic] * 2 + [False]
    assert all("unlike" in problem for problem in block_of(frames, 0, periodic=not periodic).problems)
    assert greatest_magnitude(np.array([[1.0, -np.inf, 2.0]])) == np.inf
    assert np.isnan(greatest_magnitude(np.array([[np.inf, np.nan, 2.0]])))
    assert np.isnan(greatest_magnitude(np.array([[1e300, -np.nan, 2.0]])))
