"""From blocks of frames to step tables: the ladder over every step, and what follows from it."""

import numpy as np
from numpy.typing import NDArray

from mdtopo.blocks import Columns, covariances, empty_columns, measure_steps
from mdtopo.geometry.rigid import best_rotations, rotation_angles
from mdtopo.planning import BlockPlan, Setting, Stretch, plan_block
from mdtopo.records import (
    Crossings,
    FrameBlock,
    Motion,
    PairClass,
    Reason,
    Rung,
    Scope,
    StepTable,
    Strands,
    Stretches,
    Verdict,
)
from mdtopo.typing import Flags, Indices, Lengths, Ratios


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
    return measure_plan(plan, setting.strands, setting.config.motion), after


def measure_plan(plan: BlockPlan, strands: Strands, motion: Motion) -> StepTable:
    """Return the measures of the steps of a planned block. It depends on its arguments alone; any thread may call it.

    Guarantee
    ---------
    Proven: a step whose verdict is CERTIFIED has no two edges, of those that are left, that meet during the linear
    motion between its two frames, in any periodic image. Steps that hold an unusable frame are UNRESOLVED.
    """
    columns = empty_columns(plan.block.n_steps)
    bad = np.array([bool(problem) for problem in plan.problems], dtype=np.bool_)
    for part in plan.parts:
        _measure_part(part, ~bad[part.steps], plan.block.cells is not None, motion == "rigid", columns)
    return _table(plan, columns, bad, strands)


def _measure_part(part: Stretch, measurable: Flags, periodic: bool, rigid: bool, columns: Columns) -> None:
    """Run the kernel over the steps of one part, and fill their rows."""
    t, n_steps = part.traces, len(measurable)
    rotations = np.tile(np.eye(3), (n_steps, 1, 1))
    if rigid:
        # about each strand's own centre where the image of a strand is arbitrary, else about the common one
        groups = t.offsets if periodic else np.array([0, len(t.vertices)], dtype=np.int64)
        rotations = best_rotations(*covariances(part.frames.positions, measurable, t.vertices, groups))
    rows = columns.part(part.steps)
    rows.angle[:] = rotation_angles(rotations)
    measure_steps(
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


def _table(plan: BlockPlan, columns: Columns, bad: Flags, strands: Strands) -> StepTable:
    block = plan.block
    measured = ~np.isnan(columns.displacement)
    clearance, pair = _least_clearance(columns)
    verdict, reason = _verdicts(columns, measured, bad)
    stretch, stretch_edge = _greatest_stretch(plan.ratios, strands.edges)
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = (block.times[1:] - block.times[:-1]) / columns.ratio
        nu_ratio = 2.0 * columns.displacement / columns.nu
    return StepTable(
        first_step=block.first_step,
        stretches=_stretches(plan, strands),
        broken=plan.broken,
        problems=plan.problems,
        crossings=Crossings.none(),
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
        clearance_local_pair=columns.clearance_witness[:, PairClass.LOCAL].reshape(-1, 2, 2),
        clearance_self=columns.clearances[:, PairClass.SELF],
        clearance_self_pair=columns.clearance_witness[:, PairClass.SELF].reshape(-1, 2, 2),
        clearance_inter=columns.clearances[:, PairClass.INTER],
        clearance_inter_pair=columns.clearance_witness[:, PairClass.INTER].reshape(-1, 2, 2),
        bond_stretch=stretch,
        bond_stretch_edge=stretch_edge,
        certifiable_interval=interval,
        verdict=verdict,
        scope=np.where(verdict == Verdict.CERTIFIED, Scope.STORED, Scope.NONE).astype(np.int8),
        n_crossings=np.zeros(len(verdict), dtype=np.int64),
        image_jumps=np.zeros(len(verdict), dtype=np.int64),
        rung=columns.rung.astype(np.int8),
        reason=reason,
        rung_pairs=columns.rung_pairs,
    )


def _least_clearance(columns: Columns) -> tuple[Lengths, Indices]:
    filled = np.where(np.isnan(columns.clearances), np.inf, columns.clearances)
    kind = filled.argmin(axis=1)
    rows = np.arange(len(kind))
    least = filled[rows, kind]
    return np.where(np.isinf(least), np.nan, least), columns.clearance_witness[rows, kind]


def _verdicts(columns: Columns, measured: Flags, bad: Flags) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return verdict and reason of each step; CERTIFIED only where the kernel ran and every pair was settled."""
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


def _stretches(plan: BlockPlan, strands: Strands) -> Stretches:
    row, edge = np.nonzero(plan.ratios >= plan.limits.stretch)
    return Stretches(
        step=plan.block.first_step + row,
        edge=strands.edges[edge],
        ratio=plan.ratios[row, edge],
        limit=plan.limits.stretch[edge],
    )
