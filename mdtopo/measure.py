"""From frames to step tables: the ladder over every step of a block, and what follows from it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.bonds import BondLimits, BondState, reference_lengths
from mdtopo.curves import edge_lengths, step_motion, whole_strands
from mdtopo.errors import InputError
from mdtopo.geometry.rigid import best_rotations, covariance, rotation_angles
from mdtopo.ladder import N_RUNGS, measure_step
from mdtopo.records import (
    BrokenEdge,
    Frame,
    FrameBlock,
    MonitorConfig,
    PairClass,
    Reason,
    ReferenceLengths,
    Rung,
    StepReport,
    StepTable,
    Strands,
    Stretches,
    Traces,
    Verdict,
)
from mdtopo.typing import Cell, Flags, Indices, Lengths, Points, Ratios

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class WholeFrames(NamedTuple):
    """Frames with whole strands: positions, reduced cells, edge lengths, and which frames can be used at all."""

    positions: FloatArray
    cells: FloatArray
    lengths: FloatArray
    winding: IntArray
    usable: BoolArray


class Columns(NamedTuple):
    """The columns that the kernel writes, one row per step."""

    displacement: FloatArray
    displacement_vertex: IntArray
    angle: FloatArray
    is_turned: BoolArray
    translation: FloatArray
    nu: FloatArray
    nu_witness: IntArray
    nu_class: IntArray
    ratio: FloatArray
    ratio_witness: IntArray
    clearances: FloatArray
    clearance_witness: IntArray
    rung: IntArray
    rung_pairs: IntArray
    cell_ok: BoolArray


@njit(cache=True, nogil=True)
def whole_frames(
    positions: FloatArray,
    cells: FloatArray,
    usable: BoolArray,
    periodic: bool,
    vertices: IntArray,
    offsets: IntArray,
    closed: BoolArray,
    edges: IntArray,
) -> WholeFrames:
    """Return the frames of a block with whole strands and the lengths of their edges; NaN where a frame is unusable."""
    n_frames = len(positions)
    whole, bases = positions.copy(), np.zeros((n_frames, 3, 3))
    lengths = np.full((n_frames, len(edges)), np.nan)
    winding = np.zeros((n_frames, len(closed), 3), dtype=np.int64)
    for k in range(n_frames):
        if not usable[k]:
            continue
        if periodic:
            whole[k], bases[k], winding[k] = whole_strands(positions[k], cells[k], vertices, offsets, closed)
        lengths[k] = edge_lengths(whole[k], edges)
    return WholeFrames(whole, bases, lengths, winding, usable)


@njit(cache=True, nogil=True)
def covariances(positions: FloatArray, measurable: BoolArray, vertices: IntArray, groups: IntArray) -> FloatArray:
    """Return the covariance of each step's two frames, shape (k, 3, 3); zero where the step is not measurable."""
    found = np.zeros((len(measurable), 3, 3))
    for k in range(len(measurable)):
        if measurable[k]:
            found[k] = covariance(positions[k], positions[k + 1], vertices, groups)
    return found


@njit(cache=True, nogil=True)
def measure_steps(
    frames: WholeFrames,
    measurable: BoolArray,
    periodic: bool,
    rigid: bool,
    rotations: FloatArray,
    vertices: IntArray,
    offsets: IntArray,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    local_pairs: IntArray,
    end_terms: IntArray,
    out: Columns,
) -> None:
    """Measure each step whose two frames can be used, and write its row; other rows stay as they are."""
    for k in range(len(frames.positions) - 1):
        if not measurable[k]:
            continue
        motion = step_motion(
            frames.positions[k],
            frames.positions[k + 1],
            frames.cells[k],
            frames.cells[k + 1],
            periodic,
            rigid,
            rotations[k],
            vertices,
            offsets,
        )
        out.is_turned[k], out.cell_ok[k] = motion.is_turned, motion.usable
        out.translation[k, 0], out.translation[k, 1], out.translation[k, 2] = motion.translation
        if not motion.usable:
            continue
        m = measure_step(motion, periodic, edges, following, trace, local_pairs, end_terms)
        out.displacement[k], out.displacement_vertex[k] = m.displacement, m.displacement_vertex
        out.nu[k], out.nu_class[k], out.ratio[k], out.rung[k] = m.nu, m.nu_class, m.ratio, m.rung
        out.nu_witness[k, :], out.ratio_witness[k, :] = m.nu_witness, m.ratio_witness
        out.clearances[k, :], out.clearance_witness[k, :, :] = m.clearances, m.clearance_witness
        out.rung_pairs[k, :] = m.rung_pairs


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

    def all_edges(self, values: Lengths) -> Ratios:
        """Spread values of the edges that are left over all edges, as ratios to the reference; NaN where broken."""
        ratios = np.full((len(values), len(self.limits.reference)), np.nan)
        ratios[:, self.traces.edge_index] = values / self.limits.reference[self.traces.edge_index]
        return ratios


def measure_block(block: FrameBlock, setting: Setting) -> tuple[StepTable, Setting]:
    """Return the measures of the steps of a block, and the setting for the next block.

    Parameters
    ----------
    block : FrameBlock
        k + 1 frames; its first frame was the last one of the block before, or the run's first.
    setting : Setting
        As returned with the block before, or `Setting.start`.

    Guarantee
    ---------
    Proven: a step whose verdict is CERTIFIED has no two edges, of those that are left, that meet during the linear
    motion between its two frames, in any periodic image. Steps that hold an unusable frame are UNRESOLVED.
    """
    usable = np.array([not problem for problem in block.problems])
    columns = _empty_columns(block.n_steps)
    problems = list(block.problems)
    ratios = np.full((block.n_steps + 1, len(setting.limits.reference)), np.nan)
    broken: list[BrokenEdge] = []
    start = 0
    if not setting.has_started:
        setting, fresh = _watch_first_frame(block, usable, setting)
        broken += fresh
    while start < block.n_steps:
        frames = _whole(block, usable, slice(start, None), setting)
        _note_winding(frames, start, setting, usable, problems)
        ratios[start + 1 :] = setting.all_edges(frames.lengths[1:])  # a frame belongs to the step that it ends
        stop, after = _until_break(ratios[start + 1 :], setting)
        part = slice(start, start + stop)
        _measure(block, frames, usable, part, setting, columns)
        broken += _newly_broken(block, part.stop, ratios[part.stop], setting.bonds, after, setting)
        setting = _with_bonds(setting, after)
        start = part.stop
    return _table(block, columns, ratios, tuple(broken), problems, usable, setting), setting


def _whole(block: FrameBlock, usable: Flags, part: slice, setting: Setting) -> WholeFrames:
    periodic = block.cells is not None
    cells = block.cells if block.cells is not None else np.zeros((len(block.frames), 3, 3))
    t = setting.traces
    return whole_frames(
        block.positions[part], cells[part], usable[part], periodic, t.vertices, t.offsets, t.closed, t.edges
    )


def _note_winding(frames: WholeFrames, start: int, setting: Setting, usable: Flags, problems: list[str]) -> None:
    """Mark frames in which a ring closes through the boundary: it cannot be made whole, so nothing can be proved."""
    for k, trace in zip(*np.nonzero(frames.winding.any(axis=2)), strict=True):
        vertex = setting.traces.vertices[setting.traces.offsets[trace]]
        name = setting.strands.names[setting.strands.strand_of_vertex[vertex]]
        usable[start + k] = False
        problems[start + k] = (
            f"ring {name!r} closes through the periodic boundary (winding {frames.winding[k, trace].tolist()}), "
            "which mdtopo does not handle; leave it out of the selection"
        )


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


def _watch_first_frame(block: FrameBlock, usable: Flags, setting: Setting) -> tuple[Setting, list[BrokenEdge]]:
    """Count the run's first frame too: every other frame is the end of a step, this one is not."""
    frames = _whole(block, usable, slice(0, 1), setting)
    ratios = setting.all_edges(frames.lengths)[0]
    after = setting.bonds.after(ratios, setting.limits, setting.config.fracture_frames)
    fresh = _newly_broken(block, 0, ratios, setting.bonds, after, setting)
    return replace(_with_bonds(setting, after), has_started=True), fresh


def _with_bonds(setting: Setting, after: BondState) -> Setting:
    traces = setting.traces
    if after.broken.sum() > setting.bonds.broken.sum():
        traces = Traces.of(setting.strands, np.flatnonzero(after.broken).tolist())
    return replace(setting, bonds=after, traces=traces)


def _newly_broken(
    block: FrameBlock, k: int, ratios: Ratios, before: BondState, after: BondState, setting: Setting
) -> list[BrokenEdge]:
    return [
        BrokenEdge(
            step=max(block.first_step + k - 1, 0),
            frame=int(block.frames[k]),
            edge=(int(setting.strands.edges[e, 0]), int(setting.strands.edges[e, 1])),
            ratio=float(ratios[e]),
            limit=float(setting.limits.fracture[e]),
        )
        for e in np.flatnonzero(after.broken & ~before.broken)
    ]


def _measure(
    block: FrameBlock, frames: WholeFrames, usable: Flags, part: slice, setting: Setting, columns: Columns
) -> None:
    """Run the kernel over the steps of `part`, for which `setting.traces` holds."""
    n_steps = part.stop - part.start
    here = WholeFrames(*(array[: n_steps + 1] for array in frames))
    later = block.times[part.start + 1 : part.stop + 1]
    forward = ~(later <= block.times[part.start : part.stop])  # an unknown time (NaN) is no objection
    measurable = usable[part] & usable[part.start + 1 : part.stop + 1] & forward
    t, periodic, rigid = setting.traces, block.cells is not None, setting.config.motion == "rigid"
    rotations = np.broadcast_to(np.eye(3), (n_steps, 3, 3))
    if rigid:
        # about each strand's own centre where the image of a strand is arbitrary, else about the common one
        groups = t.offsets if periodic else np.array([0, len(t.vertices)], dtype=np.int64)
        rotations = best_rotations(covariances(here.positions, measurable, t.vertices, groups))
    columns.angle[part] = rotation_angles(rotations)
    measure_steps(
        here,
        measurable,
        periodic,
        rigid,
        np.ascontiguousarray(rotations),
        t.vertices,
        t.offsets,
        t.edges,
        t.following,
        t.trace,
        t.local_pairs,
        t.end_terms,
        Columns(*(array[part] for array in columns)),
    )


def _empty_columns(n: int) -> Columns:
    def number(*shape: int) -> FloatArray:
        return np.full((n, *shape), np.nan)

    def index(*shape: int) -> IntArray:
        return np.full((n, *shape), -1, dtype=np.int64)

    return Columns(
        displacement=number(),
        displacement_vertex=index(),
        angle=number(),
        is_turned=np.zeros(n, dtype=np.bool_),
        translation=number(3),
        nu=number(),
        nu_witness=index(4),
        nu_class=index(),
        ratio=number(),
        ratio_witness=index(4),
        clearances=number(3),
        clearance_witness=index(3, 4),
        rung=np.full(n, Rung.OPEN, dtype=np.int64),
        rung_pairs=np.zeros((n, N_RUNGS), dtype=np.int64),
        cell_ok=np.ones(n, dtype=np.bool_),
    )


def _table(
    block: FrameBlock,
    columns: Columns,
    ratios: Ratios,
    broken: tuple[BrokenEdge, ...],
    problems: list[str],
    usable: Flags,
    setting: Setting,
) -> StepTable:
    step_problems = _step_problems(block, problems, usable)
    measured = ~np.isnan(columns.displacement)
    clearance, pair = _least_clearance(columns)
    verdict, reason = _verdicts(columns, np.array([bool(p) for p in step_problems], dtype=np.bool_))
    stretch, stretch_edge = _greatest_stretch(ratios[1:], setting.strands.edges)
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = (block.times[1:] - block.times[:-1]) / columns.ratio
        nu_ratio = 2.0 * columns.displacement / columns.nu
    return StepTable(
        first_step=block.first_step,
        stretches=_stretches(block.first_step, ratios[1:], setting),
        broken=broken,
        problems=step_problems,
        frame_t0=block.frames[:-1],
        frame_t1=block.frames[1:],
        time_t0=block.times[:-1],
        time_t1=block.times[1:],
        displacement_max=columns.displacement,
        displacement_vertex=columns.displacement_vertex,
        rotation_angle=np.where(measured, np.where(columns.is_turned, columns.angle, 0.0), np.nan),
        translation=columns.translation,
        nu=columns.nu,
        nu_pair=columns.nu_witness.reshape(-1, 2, 2),
        nu_class=columns.nu_class.astype(np.int8),
        nu_ratio=nu_ratio,
        nu_margin=0.5 * columns.nu - columns.displacement,
        pair_ratio=columns.ratio,
        pair_ratio_pair=columns.ratio_witness.reshape(-1, 2, 2),
        clearance=clearance,
        clearance_pair=pair.reshape(-1, 2, 2),
        clearance_local=columns.clearances[:, PairClass.LOCAL],
        clearance_self=columns.clearances[:, PairClass.SELF],
        clearance_inter=columns.clearances[:, PairClass.INTER],
        bond_stretch=stretch,
        bond_stretch_edge=stretch_edge,
        certifiable_interval=interval,
        verdict=verdict,
        rung=columns.rung.astype(np.int8),
        reason=reason,
        rung_pairs=columns.rung_pairs,
    )


def _step_problems(block: FrameBlock, problems: list[str], usable: Flags) -> tuple[str, ...]:
    """Return what is wrong with each step, in words; empty where nothing is."""
    found = []
    for k in range(block.n_steps):
        bad = [f"frame {block.frames[f]}: {problems[f]}" for f in (k, k + 1) if not usable[f]]
        if block.times[k + 1] <= block.times[k]:
            bad.append(
                f"frame {block.frames[k + 1]}: time {block.times[k + 1]:g} ps does not come after "
                f"{block.times[k]:g} ps of frame {block.frames[k]}"
            )
        found.append("; ".join(bad))
    return tuple(found)


def _least_clearance(columns: Columns) -> tuple[Lengths, Indices]:
    filled = np.where(np.isnan(columns.clearances), np.inf, columns.clearances)
    kind = filled.argmin(axis=1)
    rows = np.arange(len(kind))
    least = filled[rows, kind]
    return np.where(np.isinf(least), np.nan, least), columns.clearance_witness[rows, kind]


def _verdicts(columns: Columns, bad: Flags) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return verdict and reason of each step; CERTIFIED only where the kernel ran and every pair was settled."""
    measured = ~np.isnan(columns.displacement)
    certified = measured & (columns.rung != Rung.OPEN)
    verdict = np.where(certified, Verdict.CERTIFIED, Verdict.UNRESOLVED).astype(np.int8)
    reason = np.select(
        [certified, bad, ~columns.cell_ok], [Reason.NONE, Reason.BAD_DATA, Reason.CELL], default=Reason.LADDER
    ).astype(np.int8)
    return verdict, reason


def _greatest_stretch(ratios: Ratios, edges: Indices) -> tuple[Ratios, Indices]:
    filled = np.where(np.isnan(ratios), -np.inf, ratios)
    if not filled.shape[1]:
        return np.full(len(filled), np.nan), np.full((len(filled), 2), -1, dtype=np.int64)
    worst = filled.argmax(axis=1)
    value = filled[np.arange(len(worst)), worst]
    known = np.isfinite(value)
    edge = np.where(known[:, np.newaxis], edges[worst], -1)
    return np.where(known, value, np.nan), edge


def _stretches(first_step: int, ratios: Ratios, setting: Setting) -> Stretches:
    over = ratios >= setting.limits.stretch
    if not over.any():
        return Stretches.none()
    row, edge = np.nonzero(over)
    return Stretches(
        step=first_step + row,
        edge=setting.strands.edges[edge],
        ratio=ratios[row, edge],
        limit=setting.limits.stretch[edge],
    )


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
    return whole_frames(
        frame.positions[np.newaxis],
        cell[np.newaxis],
        np.ones(1, dtype=np.bool_),
        frame.cell is not None,
        traces.vertices,
        traces.offsets,
        traces.closed,
        traces.edges,
    )


def polyline_step(
    x_t0: Points,
    x_t1: Points,
    strands: Strands,
    *,
    cell_t0: Cell | None = None,
    cell_t1: Cell | None = None,
    config: MonitorConfig | None = None,
) -> StepReport:
    """Return what one step of the strands' polylines measures and proves.

    Parameters
    ----------
    x_t0, x_t1 : ndarray, shape (n, 3)
        Positions at the step's start and end, Å.
    strands : Strands
        Which vertices form which strand.
    cell_t0, cell_t1 : ndarray, shape (3, 3), optional
        Lattice vectors as rows, Å; both or neither.
    config : MonitorConfig, optional
        Defaults where left out.

    Raises
    ------
    InputError
        If shapes do not fit, a value is not finite, or only one cell is given.

    Guarantee
    ---------
    Proven: see `measure_block`. The reference of `bond_stretch` is the step's start.

    Examples
    --------
    Two crossed bars, 0.1 Å apart, move 1.1 Å away from each other (the paper's one-frame bound cannot prove it):

    >>> import numpy as np
    >>> bars = Strands.from_lengths([2, 2])
    >>> x0 = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0.1], [0, 1, 0.1]])
    >>> x1 = x0 + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1.1], [0, 0, 1.1]])
    >>> report = polyline_step(x0, x1, bars, config=MonitorConfig(motion="lab"))
    >>> report.verdict.name, round(report.clearance, 6)
    ('CERTIFIED', 0.1)
    """
    if (cell_t0 is None) != (cell_t1 is None):
        raise InputError("Only one of cell_t0 and cell_t1 is given; a periodic step needs both.")
    x0, x1 = checked_positions(x_t0, strands, "x_t0"), checked_positions(x_t1, strands, "x_t1")
    cells = None
    if cell_t0 is not None and cell_t1 is not None:
        cells = np.stack([checked_cell(cell_t0, "cell_t0"), checked_cell(cell_t1, "cell_t1")])
    frame = Frame(0, np.nan, x0, None if cells is None else cells[0])
    reference = reference_lengths(reference_samples([frame], strands))
    setting = Setting.start(strands, config or MonitorConfig(), reference)
    block = FrameBlock(0, np.array([0, 1]), np.array([np.nan, np.nan]), np.stack([x0, x1]), cells, problems=("", ""))
    table, _ = measure_block(block, setting)
    return table.report(0)


def nu(x: Points, strands: Strands, *, cell: Cell | None = None) -> float:
    """Return ν, the paper's PL separation: the least distance of disjoint vertices and edges, Å.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions, Å.
    strands : Strands
        Which vertices form which strand.
    cell : ndarray, shape (3, 3), optional
        Lattice vectors as rows, Å.

    Notes
    -----
    Jordan et al. (2008), section 5. In space the least distance needs pairs of edges: vertex against edge alone misses a
    plain X. The value is that of closest points, right to rounding.

    Examples
    --------
    >>> import numpy as np
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    >>> nu(square, Strands.from_lengths([4], closed=True))
    1.0
    """
    return polyline_step(x, x, strands, cell_t0=cell, cell_t1=cell, config=MonitorConfig(motion="lab")).nu


def checked_positions(x: Points, strands: Strands, name: str) -> Points:
    """Return positions as C-contiguous float64.

    Raises
    ------
    InputError
        If the shape does not fit the strands, or a coordinate is not finite.
    """
    array = np.ascontiguousarray(x, dtype=np.float64)
    if array.shape != (strands.n_vertices, 3):
        raise InputError(f"{name} has shape {array.shape}; the strands need ({strands.n_vertices}, 3).")
    if problem := Frame(0, np.nan, array).problem:
        raise InputError(f"{name} cannot be used: {problem}.")
    return array


def checked_cell(cell: Cell, name: str) -> Cell:
    """Return a cell as C-contiguous float64.

    Raises
    ------
    InputError
        If it is not a finite (3, 3) array with a volume.
    """
    array = np.ascontiguousarray(cell, dtype=np.float64)
    if array.shape != (3, 3) or not np.isfinite(array).all() or np.linalg.det(array) == 0.0:
        raise InputError(f"{name} must be a (3, 3) array of lattice vectors as rows, with a volume; got {cell!r}.")
    return array
