"""What must be known of a block of frames in order, before its steps can be measured in any order.

Strands are made whole, and edges are held against their reference lengths: an edge that breaks is no edge of the steps
behind it. This is the one thing that is handed from block to block, and it is cheap. What remains to be done for a
`BlockPlan` depends on nothing else, so threads may take one each.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from mdtopo.blocks import WholeFrames, whole_frames
from mdtopo.bonds import BondLimits, BondState, lengths_to_divide_by
from mdtopo.records import BrokenEdge, Frame, FrameBlock, MonitorConfig, ReferenceLengths, Strands, Traces
from mdtopo.typing import Flags, Lengths, PointSeries, Ratios


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What is constant over a run, and what is not but must be handed from block to block.

    Attributes
    ----------
    strands, config
        As given.
    limits : BondLimits
        When an edge counts as stretched or broken.
    traces : Traces
        The edges that are left.
    bonds : BondState
        Which edges are broken, after the last frame seen.
    has_started : bool
        Whether the run's first frame has been seen.
    """

    strands: Strands
    config: MonitorConfig
    limits: BondLimits
    traces: Traces
    bonds: BondState
    has_started: bool = False

    @classmethod
    def start(cls, strands: Strands, config: MonitorConfig, reference: ReferenceLengths) -> "Setting":
        """Return the setting before the first frame."""
        intact = BondState.intact(len(strands.edges))
        return cls(strands, config, BondLimits.of(reference, config), Traces.of(strands), intact)

    def behind(self, bonds: BondState) -> "Setting":
        """Return the setting of a run that goes on behind a frame with these bonds, which has been seen."""
        traces = Traces.of(self.strands, np.flatnonzero(bonds.broken).tolist())
        return replace(self, bonds=bonds, traces=traces, has_started=True)

    def write_ratios(self, lengths: Lengths, ratios: Ratios) -> None:
        """Write lengths of the edges that are left, over the reference, into rows of all edges; NaN where broken."""
        reference, index = self.limits.reference, self.traces.edge_index
        if np.array_equal(index, np.arange(len(reference))):  # none is broken
            np.divide(lengths, reference, out=ratios)
            return
        ratios.fill(np.nan)
        ratios[:, index] = lengths / reference[index]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Steps of a block that have the same edges.

    Attributes
    ----------
    steps : slice
        Which steps, counted within the block.
    frames : WholeFrames
        Their frames, one more than there are steps.
    traces : Traces
        Their edges.
    """

    steps: slice
    frames: WholeFrames
    traces: Traces


@dataclass(frozen=True, slots=True, eq=False)
class BlockPlan:
    """A block whose strands are whole and whose broken edges are known.

    Attributes
    ----------
    block : FrameBlock
        The frames as they were read.
    parts : tuple of Stretch
        The steps, cut where an edge breaks.
    ratios : ndarray, shape (n_steps, n_edges)
        Length of each edge over its reference, at the end of each step; NaN for edges that are broken.
    broken : tuple of BrokenEdge
        Edges that break in this block.
    problems : tuple of str, length n_steps
        Why a step cannot be measured, in words; empty where it can.
    limits : BondLimits
        When an edge counts as stretched or broken.
    bonds : tuple of BondState
        After the block's first frame, and after its last one.
    """

    block: FrameBlock
    parts: tuple[Stretch, ...]
    ratios: Ratios
    broken: tuple[BrokenEdge, ...]
    problems: tuple[str, ...]
    limits: BondLimits
    bonds: tuple[BondState, BondState]


def plan_block(block: FrameBlock, setting: Setting) -> tuple[BlockPlan, Setting]:
    """Return what can be done of a block at once, and the setting for the next block.

    Parameters
    ----------
    block : FrameBlock
        k + 1 frames; its first frame was the last one of the block before, or the run's first.
    setting : Setting
        As returned with the block before, or `Setting.start`.
    """
    problems: list[str] = []
    ratios = np.empty((block.n_steps + 1, len(setting.limits.reference)))
    parts: list[Stretch] = []
    broken: list[BrokenEdge] = []
    start = 0
    if not setting.has_started:
        setting, broken = _watch_first_frame(block, setting)
    first = setting.bonds
    while start < block.n_steps:
        frames = _whole(block, slice(start, None), setting.traces)
        setting.write_ratios(frames.lengths[1:], ratios[start + 1 :])  # a frame belongs to the step that it ends
        count, after = _until_break(ratios[start + 1 :], setting)
        part = Stretch(slice(start, start + count), frames.first(count + 1), setting.traces)
        parts.append(part)
        problems += _step_problems(block, part, setting.strands)
        start += count
        broken += _newly_broken(block, start, ratios[start], after, setting)
        setting = _with_bonds(setting, after)
    bonds = first, setting.bonds
    return BlockPlan(block, tuple(parts), ratios[1:], tuple(broken), tuple(problems), setting.limits, bonds), setting


def plan_step(block: FrameBlock, strands: Strands) -> BlockPlan:
    """Return what can be done of two frames without a run around them: nothing is watched, so nothing breaks.

    Parameters
    ----------
    block : FrameBlock
        Two frames. The first one's edge lengths are the reference.
    strands : Strands
    """
    traces, n_edges = Traces.of(strands), len(strands.edges)
    frames = _whole(block, slice(None), traces)
    reference, (unknown, bonds) = lengths_to_divide_by(frames.lengths[0]), _unwatched(n_edges)
    ratios = frames.lengths[1:] / reference  # no edge is broken, so these are all edges, in order
    limits = BondLimits(reference, unknown, unknown)
    part = Stretch(slice(0, 1), frames, traces)
    problems = tuple(_step_problems(block, part, strands))
    return BlockPlan(block, (part,), ratios, (), problems, limits, (bonds, bonds))


@lru_cache(maxsize=8)
def _unwatched(n_edges: int) -> tuple[Ratios, BondState]:
    """Return limits that are never met, and the bonds that are there; nobody may write to them."""
    return np.full(n_edges, np.nan), BondState.intact(n_edges)


def _whole(block: FrameBlock, part: slice, traces: Traces) -> WholeFrames:
    usable = np.array([not problem for problem in block.problems[part]], dtype=np.bool_)
    cells = block.cells if block.cells is not None else np.zeros((len(block.frames), 3, 3))
    return _whole_frames(block.positions[part], cells[part], usable, block.cells is not None, traces)


def _whole_frames(
    positions: PointSeries, cells: PointSeries, usable: Flags, periodic: bool, traces: Traces
) -> WholeFrames:
    t = traces
    frames = whole_frames(positions, cells, usable, periodic, t.vertices, t.offsets, t.closed, t.edges)
    if periodic:
        _close_winding_rings(frames, traces)
    return frames


def _close_winding_rings(frames: WholeFrames, traces: Traces) -> None:
    """Give the closing edge of a ring that closes through the boundary its length in the nearest image, in place.

    Laid out along the ring it leads back to the first vertex of the same cell instead, and would count as broken.
    """
    if not frames.winding.any():
        return
    for k, trace in zip(*np.nonzero(frames.winding.any(axis=2)), strict=True):
        first, last = traces.vertices[traces.offsets[trace]], traces.vertices[traces.offsets[trace + 1] - 1]
        way = frames.positions[k, first] + frames.winding[k, trace] @ frames.cells[k] - frames.positions[k, last]
        frames.lengths[k, traces.edges[:, 0] == last] = np.linalg.norm(way)  # a vertex is the tail of one edge


def _windings(part: Stretch, strands: Strands) -> dict[int, str]:
    """Return by frame of a part which ring closes through the boundary: it cannot be made whole."""
    found: dict[int, str] = {}
    if not part.frames.winding.any():
        return found
    for k, trace in zip(*np.nonzero(part.frames.winding.any(axis=2)), strict=True):
        name = strands.names[strands.strand_of_vertex[part.traces.vertices[part.traces.offsets[trace]]]]
        found[int(k)] = (
            f"ring {name!r} closes through the periodic boundary (winding {part.frames.winding[k, trace].tolist()}), "
            "which mdtopo does not handle; leave it out of the selection"
        )
    return found


def _until_break(ratios: Ratios, setting: Setting) -> tuple[int, BondState]:
    """Return how many frames pass until an edge breaks (that one included), or all, and the bond state then."""
    state, count = setting.bonds, len(ratios)
    over = ratios >= setting.limits.fracture
    if not over.any() and not state.streak.any():
        return count, state
    for k in range(count):
        after = state.after(ratios[k], setting.limits, setting.config.fracture_frames)
        if after.broken.sum() > state.broken.sum():
            return k + 1, after
        state = after
    return count, state


def _watch_first_frame(block: FrameBlock, setting: Setting) -> tuple[Setting, list[BrokenEdge]]:
    """Count the run's first frame too: every other frame is the end of a step, this one is not."""
    frames = _whole(block, slice(0, 1), setting.traces)
    ratios = np.empty((1, len(setting.limits.reference)))
    setting.write_ratios(frames.lengths, ratios)
    after = setting.bonds.after(ratios[0], setting.limits, setting.config.fracture_frames)
    fresh = _newly_broken(block, 0, ratios[0], after, setting)
    return replace(_with_bonds(setting, after), has_started=True), fresh


def _with_bonds(setting: Setting, after: BondState) -> Setting:
    traces = setting.traces
    if after.broken.sum() > setting.bonds.broken.sum():
        traces = Traces.of(setting.strands, np.flatnonzero(after.broken).tolist())
    return replace(setting, bonds=after, traces=traces)


def _newly_broken(block: FrameBlock, k: int, ratios: Ratios, after: BondState, setting: Setting) -> list[BrokenEdge]:
    return [
        BrokenEdge(
            step=max(block.first_step + k - 1, 0),
            frame=int(block.frames[k]),
            edge=(int(setting.strands.edges[e, 0]), int(setting.strands.edges[e, 1])),
            ratio=float(ratios[e]),
            limit=float(setting.limits.fracture[e]),
        )
        for e in np.flatnonzero(after.broken & ~setting.bonds.broken)
    ]


def _step_problems(block: FrameBlock, part: Stretch, strands: Strands) -> Iterator[str]:
    """Yield what is wrong with each step of a part, in words; empty where nothing is.

    What a ring does is asked of the edges that the step has: the frame in which one of them breaks belongs to two
    steps, and only the one before has a ring there.
    """
    windings = _windings(part, strands) if block.cells is not None else {}
    times = block.times.tolist()
    if not windings and not any(block.problems) and all(after > before for before, after in pairwise(times)):
        yield from [""] * (part.steps.stop - part.steps.start)  # step by step it would take longer than the kernel
        return
    for k in range(part.steps.start, part.steps.stop):
        frames = ((f, block.problems[f] or windings.get(f - part.steps.start, "")) for f in (k, k + 1))
        bad = [f"frame {block.frames[f]}: {problem}" for f, problem in frames if problem]
        if times[k + 1] <= times[k]:  # an unknown time (NaN) is no objection
            bad.append(
                f"frame {block.frames[k + 1]}: time {times[k + 1]:g} ps does not come after {times[k]:g} ps of frame "
                f"{block.frames[k]}"
            )
        yield "; ".join(bad)


def reference_samples(frames: list[Frame], strands: Strands) -> Lengths:
    """Return the edge lengths of the given frames, Å, shape (n_frames, n_edges); NaN rows for unusable frames."""
    traces = Traces.of(strands)
    samples = np.full((len(frames), len(strands.edges)), np.nan)
    for k, frame in enumerate(frames):
        if not frame.problem:
            samples[k, traces.edge_index] = _one_whole_frame(frame, traces).lengths[0]
    return samples


def ring_windings(frame: Frame, strands: Strands) -> Iterator[tuple[str, list[int]]]:
    """Yield the name and the winding, in reduced lattice vectors, of each ring that closes through the boundary."""
    traces = Traces.of(strands)
    winding = _one_whole_frame(frame, traces).winding[0]
    for trace in np.flatnonzero(winding.any(axis=1)):
        yield strands.names[trace], winding[trace].tolist()


def _one_whole_frame(frame: Frame, traces: Traces) -> WholeFrames:
    cell = frame.cell if frame.cell is not None else np.zeros((3, 3))
    usable = np.ones(1, dtype=np.bool_)
    positions, cells = frame.positions[np.newaxis], cell[np.newaxis]
    return _whole_frames(positions, cells, usable, frame.cell is not None, traces)
