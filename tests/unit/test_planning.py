"""What is known of a block before it is measured: broken edges, unusable frames, winding rings."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.bonds import reference_lengths
from mdtopo.planning import BlockPlan, Setting, plan_block, reference_samples, ring_windings
from mdtopo.records import Frame, FrameBlock, MonitorConfig, Strands

Points = NDArray[np.float64]
CHAIN = Strands.from_lengths([5])


def line(*, stretched: float = 1.0, edge: int = 2) -> Points:
    """Five beads 1 Å apart, one edge longer."""
    x = np.zeros((5, 3))
    x[:, 0] = np.arange(5.0)
    x[edge + 1 :, 0] += stretched - 1.0
    return x


def block(frames: list[Points], first_step: int = 0, **changes: object) -> FrameBlock:
    n = len(frames)
    fields = {"cells": None, "problems": ("",) * n, "times": np.arange(n, dtype=float) + first_step}
    return FrameBlock(first_step, np.arange(n) + first_step, positions=np.stack(frames), **{**fields, **changes})


def start(strands: Strands = CHAIN, **knobs: object) -> Setting:
    reference = reference_lengths(np.ones((1, len(strands.edges))))
    return Setting.start(strands, MonitorConfig(motion="lab", **knobs), reference)


def cuts(plan: BlockPlan) -> list[tuple[int, int, int]]:
    return [(part.steps.start, part.steps.stop, len(part.traces.edges)) for part in plan.parts]


def long_from(k: int, n: int, *, until: int | None = None) -> list[Points]:
    return [line(stretched=2.0) if k <= i < (n if until is None else until) else line() for i in range(n)]


def test_a_block_without_a_break_is_one_part() -> None:
    plan, after = plan_block(block(long_from(9, 6)), start())
    assert cuts(plan) == [(0, 5, 4)]
    assert plan.broken == ()
    assert after.bonds.is_intact
    np.testing.assert_array_equal(plan.ratios, np.ones((5, 4)))


def test_an_edge_breaks_in_its_third_long_frame_and_later_steps_do_not_have_it() -> None:
    plan, after = plan_block(block(long_from(2, 8)), start())
    (edge,) = plan.broken
    assert (edge.step, edge.frame, edge.edge, edge.ratio, edge.limit) == (3, 4, (2, 3), 2.0, 1.5)
    assert cuts(plan) == [(0, 4, 4), (4, 7, 3)]
    assert plan.ratios[:, 2].tolist()[:4] == [1.0, 2.0, 2.0, 2.0]
    assert np.isnan(plan.ratios[4:, 2]).all()
    assert after.bonds.broken.tolist() == [False, False, True, False]
    assert after.traces.offsets.tolist() == [0, 3, 5]


def test_two_long_frames_break_nothing() -> None:
    plan, after = plan_block(block(long_from(2, 8, until=4)), start())
    assert plan.broken == ()
    assert cuts(plan) == [(0, 7, 4)]
    assert after.bonds.is_intact


def test_the_first_frame_of_a_run_counts_towards_a_streak_once() -> None:
    plan, _ = plan_block(block(long_from(0, 5)), start())
    assert [(edge.step, edge.frame) for edge in plan.broken] == [(1, 2)]
    assert cuts(plan) == [(0, 2, 4), (2, 4, 3)]


def test_an_edge_that_breaks_in_the_very_first_frame_is_no_edge_of_any_step() -> None:
    plan, _ = plan_block(block(long_from(0, 4)), start(fracture_frames=1))
    assert [(edge.step, edge.frame) for edge in plan.broken] == [(0, 0)]
    assert cuts(plan) == [(0, 3, 3)]


def test_two_edges_may_break_in_one_frame() -> None:
    both = line(stretched=2.0)
    both[1:, 0] += 1.0  # edge 0 too
    plan, _ = plan_block(block([line(), both, both, both, both]), start())
    assert [edge.edge for edge in plan.broken] == [(0, 1), (2, 3)]
    assert cuts(plan) == [(0, 3, 4), (3, 4, 2)]


@pytest.mark.parametrize("size", [1, 2, 3, 4, 7])
def test_streaks_and_breaks_do_not_depend_on_the_blocks(size: int) -> None:
    frames = [*long_from(2, 4, until=4), *long_from(3, 9)]
    whole, end = plan_block(block(frames), start())
    setting, broken, ratios, edges = start(), [], [], []
    for first in range(0, len(frames) - 1, size):
        plan, setting = plan_block(block(frames[first : first + size + 1], first), setting)
        broken += plan.broken
        ratios.append(plan.ratios)
        edges += [n for begin, stop, n in cuts(plan) for _ in range(begin, stop)]
    assert tuple(broken) == whole.broken
    assert whole.broken
    np.testing.assert_array_equal(np.concatenate(ratios), whole.ratios)
    assert edges == [n for begin, stop, n in cuts(whole) for _ in range(begin, stop)]
    assert setting.bonds.broken.tolist() == end.bonds.broken.tolist()


def test_an_unusable_frame_neither_ends_nor_adds_to_a_streak() -> None:
    frames = [line(), line(stretched=2.0), line(), *long_from(0, 2), line(stretched=2.0)]
    bad = block(frames, problems=("", "", "damaged", "", "", ""))
    plan, _ = plan_block(bad, start())
    assert [edge.frame for edge in plan.broken] == [4]
    assert np.isnan(plan.ratios[1]).all()
    assert plan.problems == ("", "frame 2: damaged", "frame 2: damaged", "", "")


@pytest.mark.parametrize(
    ("times", "bad"),
    [
        ([0.0, 1.0, 2.0], []),
        ([0.0, 1.0, 1.0], [1]),
        ([0.0, 2.0, 1.0], [1]),
        ([0.0, 0.0, -1.0], [0, 1]),
        ([0.0, np.nextafter(0.0, 1.0), 1.0], []),
        ([np.nan, np.nan, np.nan], []),
        ([0.0, np.nan, -1.0], []),
    ],
)
def test_time_must_increase_where_it_is_known(times: list[float], bad: list[int]) -> None:
    plan, _ = plan_block(block([line()] * 3, times=np.array(times)), start())
    assert [k for k, problem in enumerate(plan.problems) if problem] == bad
    for k in bad:
        assert (
            f"frame {k + 1}: time {times[k + 1]:g} ps does not come after {times[k]:g} ps of frame {k}"
            in (plan.problems[k])
        )


RING = Strands.from_lengths([4], closed=True, names=["the band"])


def band(length: float) -> Points:
    """Four beads along x that close through the boundary of a cell of that length."""
    x = np.zeros((4, 3))
    x[:, 0] = np.arange(4) * length / 4
    return x


def test_a_ring_that_closes_through_the_boundary_is_named() -> None:
    cell = np.diag([8.0, 20.0, 20.0])
    square = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0.0]])
    assert list(ring_windings(Frame(0, 0.0, band(8.0), cell), RING)) == [("the band", [1, 0, 0])]
    assert list(ring_windings(Frame(0, 0.0, square, cell), RING)) == []
    frames = block([square, band(8.0), square, square], cells=np.stack([cell] * 4))
    plan, _ = plan_block(frames, start(RING))
    assert [bool(problem) for problem in plan.problems] == [True, True, False]
    assert "ring 'the band' closes through the periodic boundary (winding [1, 0, 0])" in plan.problems[0]


OPENING = Strands.from_lengths([6], closed=True)


def opening_ring(gap: float) -> Points:
    """Six beads 1 Å apart, but for the edge 2-3 of up to 4.4 Å; knees keep the others short."""
    foot, top = np.array([0.5 * gap, 0.0, 0.0]), np.array([0.5, 1.0, 0.0])
    knee = 0.5 * (foot + top)
    knee[2] = np.sqrt(1.0 - 0.25 * np.sum((foot - top) ** 2))
    mirror = np.array([-1.0, 1.0, 1.0])
    return np.array([mirror * top, mirror * knee, mirror * foot, foot, knee, top])


def test_a_closing_edge_has_the_length_of_its_nearest_image_where_the_ring_winds() -> None:
    cell = np.diag([8.0, 20.0, 20.0])
    frames = block([band(8.0)] * 5, cells=np.stack([cell] * 5))
    setting = Setting.start(RING, MonitorConfig(motion="lab"), reference_lengths(np.full((1, 4), 2.0)))
    plan, _ = plan_block(frames, setting)
    np.testing.assert_array_equal(plan.ratios, np.ones((4, 4)))
    assert plan.broken == ()
    assert all(plan.problems)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 7])
def test_a_ring_that_winds_until_it_breaks_is_judged_alike_however_blocks_are_cut(size: int) -> None:
    """The long edge takes the image on its other side, so that the ring winds: until it is no ring any more."""
    cell = np.diag([7.0, 20.0, 20.0])
    frames = [opening_ring(gap) for gap in (1.0, 1.0, 4.0, 4.1, 4.2, 4.2, 4.1, 4.0, 1.0, 1.0)]
    cells = np.stack([cell] * len(frames))
    setting, problems, broken, ratios, edges = start(OPENING), [], [], [], []
    for first in range(0, len(frames) - 1, size):
        part = slice(first, first + size + 1)
        plan, setting = plan_block(block(frames[part], first, cells=cells[part]), setting)
        problems += plan.problems
        broken += [(edge.frame, edge.edge) for edge in plan.broken]
        ratios.append(plan.ratios[:, 2])
        edges += [n for begin, stop, n in cuts(plan) for _ in range(begin, stop)]
    assert [bool(problem) for problem in problems] == [False, True, True, True, False, False, False, False, False]
    assert broken == [(4, (2, 3))]
    assert edges == [6, 6, 6, 6, 5, 5, 5, 5, 5]
    np.testing.assert_allclose(np.concatenate(ratios), [1.0, 3.0, 2.9, 2.8, *[np.nan] * 5], rtol=1e-12)


def test_reference_samples_are_the_lengths_of_whole_strands_and_nan_for_unusable_frames() -> None:
    cell = 3.0 * np.eye(3)
    x = line()
    wrapped = x - 3.0 * np.floor(x / 3.0)
    frames = [Frame(0, 0.0, wrapped, cell), Frame(1, 1.0, np.full((5, 3), np.nan), cell), Frame(2, 2.0, 1.1 * x)]
    samples = reference_samples(frames, CHAIN)
    np.testing.assert_allclose(samples, [[1.0] * 4, [np.nan] * 4, [1.1] * 4])
