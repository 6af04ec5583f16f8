"""From blocks of frames to step tables: the ladder over every step, and what follows from it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mdtopo.audit import changed_invariants
from mdtopo.blocks import OPEN, Columns, covariances, empty_columns, measure_steps
from mdtopo.curverows import CurveRows
from mdtopo.geometry.rigid import best_rotations, rotation_angles
from mdtopo.passages import crossing_table, decide_exactly, step_data
from mdtopo.planning import BlockPlan, Setting, Stretch, plan_block
from mdtopo.profiles import part_profile
from mdtopo.records import (
    Crossings,
    FrameBlock,
    MonitorConfig,
    PairClass,
    Profile,
    Reason,
    Scope,
    StepTable,
    Strands,
    Stretches,
    Verdict,
)
from mdtopo.spheres import PLACING_ERROR
from mdtopo.typing import Codes, Flags, Indices, Lengths, PointSeries, Ratios

IDENTITY = np.eye(3)

# as plain numbers: NumPy asks an enum for a dozen attributes before it compares with it
UNRESOLVED, CERTIFIED, CROSSING = int(Verdict.UNRESOLVED), int(Verdict.CERTIFIED), int(Verdict.CROSSING)
NONE, LADDER, BAD_DATA = int(Reason.NONE), int(Reason.LADDER), int(Reason.BAD_DATA)
CELL, IMAGE_JUMP = int(Reason.CELL), int(Reason.IMAGE_JUMP)
LOCAL, SELF, INTER = int(PairClass.LOCAL), int(PairClass.SELF), int(PairClass.INTER)
NOTHING, STORED, MOTION = int(Scope.NONE), int(Scope.STORED), int(Scope.MOTION)


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
    Proven: see `measure_plan`.
    """
    plan, after = plan_block(block, setting)
    return measure_plan(plan, setting.strands, setting.config), after


def measure_plan(plan: BlockPlan, strands: Strands, config: MonitorConfig) -> StepTable:
    """Return the measures of the steps of a planned block. It depends on its arguments alone; any thread may call it.

    Raises
    ------
    AuditError
        If the crossings of a step contradict its linking numbers or writhes: a bug.

    Guarantee
    ---------
    Proven: a step whose verdict is CERTIFIED has no two edges, of those that are left, that meet during the linear
    motion between its two frames, in any periodic image; a step whose verdict is CROSSING has each crossing that is
    listed. Steps that hold an unusable frame are UNRESOLVED. The same holds of the smooth curve, for ``curve_verdict``.
    """
    columns = empty_columns(plan.block.n_steps)
    curve = CurveRows.empty(plan.block.n_steps, config.curve)
    bad = np.array([bool(problem) for problem in plan.problems], dtype=np.bool_)
    reasons = np.full(len(bad), NONE, dtype=np.int8)
    crossings: list[Crossings] = []
    profiles: list[Profile] = []
    for part in plan.parts:
        measurable, rows = ~bad[part.steps], columns.part(part.steps)
        rotations = _rotations(plan, part, measurable, config)
        crossings += _measure_part(plan, part, measurable, rotations, strands, config, rows, reasons)
        curve.measure(plan, part, rows, rotations, strands, config)
        if config.profile_steps:
            profiles.append(part_profile(plan, part, rows, _least_clearance(rows)[0], rotations, config))
    table = _table(plan, columns, curve, bad, reasons, Crossings.joined(crossings), strands, config)
    return replace(table, profile=Profile.joined(profiles)) if profiles else table


def _rotations(plan: BlockPlan, part: Stretch, measurable: Flags, config: MonitorConfig) -> PointSeries:
    """Return what is taken out of each step of a part, shape (k, 3, 3)."""
    t = part.traces
    if config.motion == "rigid":
        # about each strand's own centre where the image of a strand is arbitrary, else about the common one
        periodic = plan.block.cells is not None
        groups = t.offsets if periodic else np.array([0, len(t.vertices)], dtype=np.int64)
        return best_rotations(*covariances(part.frames.positions, measurable, t.vertices, groups))
    rotations = np.empty((len(measurable), 3, 3))
    rotations[:] = IDENTITY
    return rotations


def _measure_part(
    plan: BlockPlan,
    part: Stretch,
    measurable: Flags,
    rotations: PointSeries,
    strands: Strands,
    config: MonitorConfig,
    rows: Columns,
    reasons: Codes,
) -> Iterator[Crossings]:
    """Run the kernel over the steps of one part, fill their rows, and yield the crossings of each."""
    t, rigid, periodic = part.traces, config.motion == "rigid", plan.block.cells is not None
    rows.angle[:] = rotation_angles(rotations) if rigid else 0.0
    starts, found = measure_steps(
        part.frames,
        measurable,
        periodic,
        rigid,
        rotations,
        t.vertices,
        t.offsets,
        t.edges,
        t.following,
        t.trace,
        t.local_pairs,
        t.end_terms,
        rows,
    )
    has_found = (starts[1:] > starts[:-1]).any(axis=1)
    audited = has_found | config.audit if t.closed.any() else has_found
    for k in np.flatnonzero(audited & (rows.rung >= 0) & ~np.isnan(rows.displacement)):
        of_step = found.rows(starts[k], starts[k + 1])
        step = step_data(plan, part, int(k), rotations[k], rigid)
        decided = decide_exactly(of_step, step, t.edges)
        rows.settle(int(k), len(of_step.undecided), len(decided.open_pairs))
        reasons[part.steps][k] = decided.reason
        frames = plan.block.frames[part.steps.start + k : part.steps.start + k + 2]
        changed = changed_invariants(step.motion, t, decided, f"frames {frames[0]}-{frames[1]}")
        if len(decided.passages):
            number = plan.block.first_step + part.steps.start + int(k)
            yield crossing_table(decided, step, t, changed, number, frames, strands, config.resolution_length)


def _table(
    plan: BlockPlan,
    columns: Columns,
    curve: CurveRows,
    bad: Flags,
    reasons: Codes,
    crossings: Crossings,
    strands: Strands,
    config: MonitorConfig,
) -> StepTable:
    block = plan.block
    measured = ~np.isnan(columns.displacement)
    clearance, pair = _least_clearance(columns)
    n_crossings = np.bincount(crossings.step - block.first_step, minlength=block.n_steps)
    verdict, reason = _verdicts(columns, measured, bad, reasons, n_crossings)
    stretch, stretch_edge = _greatest_stretch(plan.ratios, strands.edges)
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = (block.times[1:] - block.times[:-1]) / columns.ratio
        nu_ratio = 2.0 * columns.displacement / columns.nu
    return StepTable(
        first_step=block.first_step,
        stretches=_stretches(plan, strands),
        broken=plan.broken,
        problems=_problems(plan, columns),
        crossings=crossings,
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
        clearance_local=columns.clearances[:, LOCAL],
        clearance_local_pair=columns.clearance_witness[:, LOCAL].reshape(-1, 2, 2),
        clearance_self=columns.clearances[:, SELF],
        clearance_self_pair=columns.clearance_witness[:, SELF].reshape(-1, 2, 2),
        clearance_inter=columns.clearances[:, INTER],
        clearance_inter_pair=columns.clearance_witness[:, INTER].reshape(-1, 2, 2),
        bond_stretch=stretch,
        bond_stretch_edge=stretch_edge,
        certifiable_interval=interval,
        verdict=verdict,
        scope=_scopes(verdict, clearance, block, config),
        n_crossings=n_crossings,
        image_jumps=_image_jumps(plan),
        rung=columns.rung.astype(np.int8),
        reason=reason,
        rung_pairs=columns.rung_pairs,
        **curve.values(block.first_step, reason),
    )


def _least_clearance(columns: Columns) -> tuple[Lengths, Indices]:
    filled = np.where(np.isnan(columns.clearances), np.inf, columns.clearances)
    kind = filled.argmin(axis=1)
    rows = np.arange(len(kind))
    least = filled[rows, kind]
    return np.where(np.isinf(least), np.nan, least), columns.clearance_witness[rows, kind]


def _verdicts(
    columns: Columns, measured: Flags, bad: Flags, reasons: Codes, n_crossings: Indices
) -> tuple[Codes, Codes]:
    """Return verdict and reason of each step; CERTIFIED only where the kernel ran and every pair was settled."""
    verdict = np.full(len(bad), UNRESOLVED, dtype=np.int8)
    verdict[measured & (columns.rung != OPEN)] = CERTIFIED
    verdict[n_crossings > 0] = CROSSING
    reason = reasons.copy()
    reason[reasons == NONE] = LADDER
    reason[verdict != UNRESOLVED] = NONE  # from here on the later line wins
    reason[~columns.cell_ok] = CELL
    reason[columns.jump >= 0] = IMAGE_JUMP
    reason[bad] = BAD_DATA
    return verdict, reason


def _scopes(verdict: Codes, clearance: Lengths, block: FrameBlock, config: MonitorConfig) -> Codes:
    """Return what each certificate is about.

    Guarantee
    ---------
    Proven: each of two points is off by η at most, and by the rounding of a turned coordinate; so a clearance above
    twice that leaves room for what the file rounded away. Without a pair there is nothing to hit.
    """
    error: float | Lengths = config.coordinate_error or 0.0
    if config.motion == "rigid" or block.cells is not None:
        greatest = np.abs(block.positions).max(axis=(1, 2))
        if block.cells is not None:
            greatest = greatest + 2.0 * np.abs(block.cells).sum(axis=(1, 2))
        error = error + PLACING_ERROR * np.maximum(greatest[1:], greatest[:-1])
    clear = np.isnan(clearance) | (clearance > 2.0 * error)
    scope = np.full(len(verdict), NOTHING, dtype=np.int8)
    scope[verdict == CERTIFIED] = STORED
    scope[(verdict == CERTIFIED) & clear] = MOTION
    return scope


def _problems(plan: BlockPlan, columns: Columns) -> tuple[str, ...]:
    """Return what is wrong with each step in words, where an edge is lost among its images too."""
    problems = list(plan.problems)
    for part in plan.parts:
        for k in np.flatnonzero(columns.jump[part.steps] >= 0):
            a, b = part.traces.edges[columns.jump[part.steps][k]]
            problems[part.steps.start + k] = (
                f"the edge of vertices {a} and {b} is about half a cell long and jumps by a lattice vector, so that "
                "nobody can tell which image it joins"
            )
    return tuple(problems)


def _image_jumps(plan: BlockPlan) -> Indices:
    jumps = np.zeros(plan.block.n_steps, dtype=np.int64)
    for part in plan.parts:
        jumps[part.steps] = part.frames.jumps[1:]
    return jumps


def _greatest_stretch(ratios: Ratios, edges: Indices) -> tuple[Ratios, Indices]:
    if not ratios.shape[1]:
        return np.full(len(ratios), np.nan), np.full((len(ratios), 2), -1, dtype=np.int64)
    value = np.fmax.reduce(ratios, axis=1)  # of the edges that are left
    worst = (ratios == value[:, np.newaxis]).argmax(axis=1)
    edge, unknown = edges[worst], ~np.isfinite(value)
    value[unknown], edge[unknown] = np.nan, -1
    return value, edge


def _stretches(plan: BlockPlan, strands: Strands) -> Stretches:
    beyond = plan.ratios >= plan.limits.stretch
    if not beyond.any():
        return Stretches.none()
    row, edge = np.nonzero(beyond)
    return Stretches(
        step=plan.block.first_step + row,
        edge=strands.edges[edge],
        ratio=plan.ratios[row, edge],
        limit=plan.limits.stretch[edge],
    )
