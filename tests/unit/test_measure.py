"""Tables of many steps: no bit depends on how they are cut, and what cannot be measured is said."""

from collections.abc import Sequence
from dataclasses import fields
from functools import cache

import numpy as np
import oracles
import pytest
from numpy.typing import NDArray

from mdtopo.measure import measure_one, measure_plan
from mdtopo.pipeline import step_tables
from mdtopo.planning import plan_step
from mdtopo.readers import ReaderRequest, Source, open_reader
from mdtopo.records import (
    Crossings,
    FrameBlock,
    MonitorConfig,
    PairClass,
    Profile,
    Reason,
    Rung,
    StepReport,
    StepTable,
    Strands,
    Stretches,
    Verdict,
)
from mdtopo.records.profile import rounded_down

Points = NDArray[np.float64]
STRANDS = Strands.from_lengths([8, 6, 5], closed=[False, True, False])
BREAKS, BAD = 41, 30
N_FRAMES = 72


def run(
    frames: Points,
    strands: Strands,
    *,
    cell: Points | None = None,
    time: Sequence[float] | None = None,
    threads: int = 1,
    **knobs: object,
) -> StepTable:
    given = {"cell": cell, "time": time}
    options = {name: np.asarray(value) for name, value in given.items() if value is not None}
    reader = open_reader(Source(object=frames), ReaderRequest(strands=strands, options=options))
    with reader:
        config = MonitorConfig(**{"profile_steps": 5, **knobs})  # type: ignore[arg-type]
        return StepTable.joined(list(step_tables(reader, config=config, threads=threads)))


@cache
def trajectory() -> Points:
    """Three strands that jiggle; an edge of the first grows from one frame on, and one frame is damaged."""
    rng = np.random.default_rng(3)
    rest = np.zeros((19, 3))
    rest[:8, 0] = 1.5 * np.arange(8)
    angle = np.arange(6) * np.pi / 3
    rest[8:14] = np.stack([5 + 1.5 * np.cos(angle), 1.5 * np.sin(angle), 3 + 0 * angle], axis=1)
    rest[14:, 1], rest[14:, 2] = 1.5 * np.arange(5), -1.6
    frames = rest + np.cumsum(rng.normal(0, 0.03, (N_FRAMES, 19, 3)), axis=0)
    frames[:, 4:8, 0] += 1.2 * np.clip(np.arange(N_FRAMES) - BREAKS + 1, 0, 4)[:, np.newaxis]
    frames[BAD, 2, 1] = np.nan
    return frames


CELLS = {"no cell": None, "cell": np.array([[14.0, 0, 0], [2, 12, 0], [-1, 1, 11]])}


@cache
def whole_run(cell: str, motion: str) -> StepTable:
    return run(trajectory(), STRANDS, cell=CELLS[cell], motion=motion, block_steps=500)


def assert_same_bits(found: StepTable, expected: StepTable) -> None:
    for column in StepTable.columns():
        one, other = getattr(found, column.name), getattr(expected, column.name)
        assert one.dtype == other.dtype
        assert one.tobytes() == other.tobytes(), column.name
    for entry in fields(Stretches):
        one, other = getattr(found.stretches, entry.name), getattr(expected.stretches, entry.name)
        assert one.tobytes() == other.tobytes(), entry.name
    for name in ("window", "step", "least", "clearance"):
        assert getattr(found.profile, name).tobytes() == getattr(expected.profile, name).tobytes(), name
    assert found.profile.window_frames == expected.profile.window_frames
    assert found.broken == expected.broken
    assert found.problems == expected.problems
    assert found.first_step == expected.first_step


@pytest.mark.parametrize("motion", ["lab", "rigid"])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(("block_steps", "threads"), [(1, 1), (1, 3), (7, 2), (7, 1), (64, 2), (64, 3)])
def test_no_bit_depends_on_how_steps_are_cut_into_blocks(
    cell: str, motion: str, block_steps: int, threads: int
) -> None:
    table = run(trajectory(), STRANDS, cell=CELLS[cell], motion=motion, block_steps=block_steps, threads=threads)
    assert_same_bits(table, whole_run(cell, motion))


def test_the_run_that_is_cut_has_a_break_a_bad_frame_stretches_and_both_verdicts() -> None:
    table = whole_run("no cell", "rigid")
    assert len(table) == N_FRAMES - 1
    assert [edge.edge for edge in table.broken] == [(3, 4)]
    assert len(table.stretches.step) > 0
    assert set(table.verdict.tolist()) == {Verdict.CERTIFIED, Verdict.UNRESOLVED}


@pytest.mark.parametrize("motion", ["lab", "rigid"])
@pytest.mark.parametrize("cell", CELLS)
def test_the_profile_of_a_window_is_of_its_step_of_least_clearance(cell: str, motion: str) -> None:
    table = whole_run(cell, motion)
    profile = table.profile
    assert (profile.window_frames, profile.window.tolist()) == (5, list(range(15)))
    for row in range(len(profile)):
        steps = np.arange(5 * row, min(5 * row + 5, len(table)))
        least = table.clearance[steps]
        assert profile.step[row] == steps[np.nanargmin(least)]
        assert profile.least[row] == np.nanmin(least)
        assert np.nanmin(profile.clearance[row]) == rounded_down(profile.least[row : row + 1])[0]
    before = profile.step < BREAKS
    assert np.isfinite(profile.clearance[before]).all()
    assert BAD not in profile.step
    assert BAD - 1 not in profile.step


def test_a_window_in_which_nothing_can_be_measured_has_no_row() -> None:
    windows = run(trajectory(), STRANDS, profile_steps=1).profile.window.tolist()
    assert set(range(N_FRAMES - 1)) - set(windows) == {BAD - 1, BAD}


def test_a_profile_of_no_steps_is_none() -> None:
    assert len(run(trajectory()[:9], STRANDS, profile_steps=0).profile) == 0


def test_windows_begin_at_fixed_frames_of_the_trajectory() -> None:
    frames = trajectory()[:29]
    reader = open_reader(Source(object=frames), ReaderRequest(strands=STRANDS))
    config = MonitorConfig(profile_steps=4)
    with reader:
        whole = StepTable.joined(list(step_tables(reader, frames=slice(1, None, 2), config=config))).profile
        cuts = [slice(1, 8, 2), slice(7, 20, 2), slice(19, None, 2)]
        shards = [StepTable.joined(list(step_tables(reader, frames=cut, config=config))) for cut in cuts]
    joined = Profile.joined([shard.moved_to(first).profile for shard, first in zip(shards, (0, 3, 9), strict=True)])
    assert whole.window_frames == joined.window_frames == 8
    assert whole.window.tolist() == joined.window.tolist() == [0, 1, 2, 3]
    for name in ("step", "least", "clearance"):
        assert getattr(joined, name).tobytes() == getattr(whole, name).tobytes()


def test_steps_of_a_damaged_frame_are_unresolved_by_name_and_no_other_step_is() -> None:
    table = whole_run("no cell", "lab")
    bad = np.flatnonzero(table.reason == Reason.BAD_DATA)
    assert bad.tolist() == [BAD - 1, BAD]
    assert (table.verdict[bad] == Verdict.UNRESOLVED).all()
    assert (table.rung[bad] == Rung.OPEN).all()
    assert [bool(p) for p in table.problems] == [k in bad for k in range(len(table))]
    assert f"frame {BAD}: 1 vertex has a coordinate that is not finite" in table.problems[BAD]
    for name in ("displacement_max", "nu", "nu_ratio", "nu_margin", "pair_ratio", "clearance", "certifiable_interval"):
        assert np.isnan(getattr(table, name)[bad]).all(), name
        assert np.isfinite(getattr(table, name)[BAD + 1]) or name == "certifiable_interval"
    assert (table.nu_pair[bad] == -1).all()
    assert (table.nu_class[bad] == PairClass.NONE).all()


def test_a_frame_without_its_cell_is_unresolved_by_name() -> None:
    frames = trajectory()[:6]
    cells = np.stack([CELLS["cell"]] * 6)
    cells[3] = 0.0
    table = run(frames, STRANDS, cell=cells)
    assert np.flatnonzero(table.reason == Reason.BAD_DATA).tolist() == [2, 3]
    assert "frame 3: it has no periodic box, unlike the trajectory's first frame" in table.problems[2]


def test_a_cell_that_appears_later_is_unresolved_by_name() -> None:
    cells = np.stack([CELLS["cell"]] * 6)
    cells[0] = np.nan
    table = run(trajectory()[:6], STRANDS, cell=cells)
    assert (table.reason == Reason.BAD_DATA).all()
    assert "it has a periodic box" in table.problems[3]


def test_a_step_back_in_time_is_unresolved() -> None:
    table = run(trajectory()[:5], STRANDS, time=[0.0, 1.0, 1.0, 2.0, 1.5])
    assert np.flatnonzero(table.verdict == Verdict.UNRESOLVED).tolist() == [1, 3]
    assert (table.reason[[1, 3]] == Reason.BAD_DATA).all()


def test_the_certifiable_interval_is_the_spacing_over_the_ratio() -> None:
    table = run(trajectory()[:5], STRANDS, time=[0.0, 2.0, 4.0, 6.0, 8.0])
    np.testing.assert_allclose(table.certifiable_interval * table.pair_ratio, 2.0)


# --- broken edges -----------------------------------------------------------------------------------------------------


def passing(breaks: bool) -> tuple[Points, Strands]:
    """A bar falls through the middle edge of a line of four beads, which is cut first, or is not."""
    strands = Strands.from_lengths([4, 2])
    frames = np.zeros((14, 6, 3))
    frames[:, :4, 0] = [-4.5, -1.5, 1.5, 4.5]
    frames[:, 4] = [0, -1.5, 0]
    frames[:, 5] = [0, 1.5, 0]
    frames[:, 4:, 2] = 2.2
    frames[8:, 4:, 2] -= 0.8 * np.arange(1, 7)[:, np.newaxis]
    if breaks:
        frames[3:, :2, 0] -= 3.0
        frames[3:, 2:4, 0] += 3.0
    return frames, strands


def test_a_passage_through_a_broken_edge_is_no_passage() -> None:
    table = run(*passing(breaks=True), motion="lab", reference_frames=3)
    assert [(edge.edge, edge.step, edge.frame) for edge in table.broken] == [((1, 2), 4, 5)]
    assert (table.verdict == Verdict.CERTIFIED).all()


def test_the_same_passage_through_an_intact_edge_is_not_certified() -> None:
    table = run(*passing(breaks=False), motion="lab", reference_frames=3)
    assert table.broken == ()
    assert np.flatnonzero(table.verdict != Verdict.CERTIFIED).tolist() == [9]


def test_nu_after_a_break_is_that_of_the_pieces() -> None:
    frames, strands = passing(breaks=True)
    frames = np.round(frames + np.random.default_rng(1).normal(0, 0.1, frames.shape), 3)  # no ties
    table = run(frames, strands, motion="lab", reference_frames=3)
    assert [edge.step for edge in table.broken] == [4]
    for step in range(len(table)):
        offsets = [0, 4, 6] if step <= 4 else [0, 2, 4, 6]
        expected = oracles.nu(frames[step], offsets, [False] * (len(offsets) - 1))
        assert table.nu[step] == pytest.approx(expected.value, rel=1e-12)


def test_bond_stretch_names_the_longest_edge_that_is_left() -> None:
    frames, strands = passing(breaks=True)
    table = run(frames, strands, motion="lab", reference_frames=3)
    assert table.bond_stretch[:6].tolist() == [1.0, 1.0, 3.0, 3.0, 3.0, 1.0]
    assert table.bond_stretch_edge[2:5].tolist() == [[1, 2]] * 3
    assert table.stretches.step.tolist() == [2, 3, 4]
    assert (table.stretches.limit == 1.2).all()  # all edges are 3 Å at the start: no spread
    assert table.stretches.ratio.tolist() == [3.0, 3.0, 3.0]


def test_a_strand_whose_every_edge_is_broken_leaves_a_table_without_pairs() -> None:
    strands = Strands.from_lengths([2])
    frames = np.zeros((7, 2, 3))
    frames[:, 1, 0] = 1.0
    frames[1:, 1, 0] = 9.0
    table = run(frames, strands, motion="lab", reference_frames=1)
    assert len(table.broken) == 1
    assert (table.verdict[3:] == Verdict.CERTIFIED).all()
    assert np.isnan(table.clearance[3:]).all()
    assert np.isnan(table.bond_stretch[3:]).all()
    assert (table.bond_stretch_edge[3:] == -1).all()


@pytest.mark.parametrize("curve", ["none", "interpolating"])
@pytest.mark.parametrize("motion", ["lab", "rigid"])
@pytest.mark.parametrize("cell", CELLS)
def test_one_step_is_reported_as_its_row_of_a_table(cell: str, motion: str, curve: str) -> None:
    config = MonitorConfig(motion=motion, curve=curve, profile_steps=0)  # type: ignore[arg-type]
    for k, shift in ((0, 0.0), (1, 4.0), (BAD, 0.0)):  # certified, with crossings, and one that cannot be measured
        positions = trajectory()[k : k + 2].copy()
        positions[:, 14:] += (3.7, -1.0, 0.0)
        positions[1, 14:, 2] += shift
        cells = None if CELLS[cell] is None else np.stack([CELLS[cell]] * 2)
        problem = "damaged" if k == BAD else ""
        block = FrameBlock(7, np.array([k, k + 1]), np.array([0.5, 1.5]), positions, cells, (problem, ""))
        plan = plan_step(block, STRANDS)
        found, expected = measure_one(plan, STRANDS, config), measure_plan(plan, STRANDS, config).report(0)
        for entry in fields(StepReport):
            one, other = getattr(found, entry.name), getattr(expected, entry.name)
            if isinstance(other, Crossings):
                assert [repr(c) for c in one] == [repr(c) for c in other]
            elif isinstance(other, np.ndarray):
                assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes()), entry.name
            else:
                assert type(one) is type(other), entry.name
                np.testing.assert_equal(one, other)
        assert found.verdict is {0: Verdict.CERTIFIED, 1: Verdict.CROSSING, BAD: Verdict.UNRESOLVED}[k]
