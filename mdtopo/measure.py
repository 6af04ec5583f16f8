"""From blocks of frames to step tables: the ladder over every step, and what follows from it."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mdtopo.audit import changed_invariants
from mdtopo.blocks import covariances, measure_steps
from mdtopo.curverows import CurveRows
from mdtopo.curves import greatest_magnitudes
from mdtopo.geometry.rigid import best_rotations, rotation_angles
from mdtopo.heap import keep_freed_memory
from mdtopo.outcomes import conclude_steps
from mdtopo.passages import StepData, crossing_table, decide_exactly
from mdtopo.planning import BlockPlan, Setting, Stretch, plan_block
from mdtopo.profiles import part_profile
from mdtopo.records import (
    Crossings,
    FrameBlock,
    MonitorConfig,
    Profile,
    StepReport,
    StepTable,
    Strands,
    Stretches,
)
from mdtopo.spheres import PLACING_ERROR
from mdtopo.steprows import StepRows, columns_of, first_values, settle, unmeasured
from mdtopo.typing import Flags, Indices, Lengths, PointSeries

IDENTITY = np.eye(3)

CURVE_COLUMNS = tuple(c.name for c in StepTable.columns() if c.name.startswith("curve_"))


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
    m = _measured(plan, strands, config)
    table = StepTable(
        first_step=plan.block.first_step,
        stretches=_stretches(plan, strands) if m.any_beyond else Stretches.none(),
        broken=plan.broken,
        problems=_problems(plan, m.rows),
        crossings=m.crossings,
        frame_t0=plan.block.frames[:-1],
        frame_t1=plan.block.frames[1:],
        time_t0=plan.block.times[:-1],
        time_t1=plan.block.times[1:],
        **columns_of(m.rows),
        **m.curve.values(plan.block.first_step, m.rows["reason"]),
    )
    if not config.profile_steps:
        return table
    profiles = [
        part_profile(plan, part, m.rows[part.steps], turned, config)
        for part, turned in zip(plan.parts, m.rotations, strict=True)
    ]
    return replace(table, profile=Profile.joined(profiles))


def measure_one(plan: BlockPlan, strands: Strands, config: MonitorConfig) -> StepReport:
    """Return what a plan of one step measures: the report of `measure_plan`, for half its cost.

    Raises
    ------
    AuditError
        If the crossings of the step contradict its linking numbers or writhes: a bug.

    Guarantee
    ---------
    Proven: see `measure_plan`.
    """
    m, block = _measured(plan, strands, config), plan.block
    curve = m.curve.values(block.first_step, m.rows["reason"])
    columns = [curve[name] for name in CURVE_COLUMNS]
    values = [*block.frames.tolist(), *block.times.tolist(), *first_values(m.rows)]
    values += [column[0].copy() if column.ndim > 1 else column.item(0) for column in columns]
    return StepTable.report_of(
        block.first_step, _problems(plan, m.rows)[0], m.crossings, curve["curve_crossings"], values
    )


class _Measured(NamedTuple):
    """What is known of the steps of a plan, before it is laid out; `any_beyond`: whether any edge is stretched."""

    rows: StepRows
    curve: CurveRows
    crossings: Crossings
    rotations: list[PointSeries]
    any_beyond: bool


def _measured(plan: BlockPlan, strands: Strands, config: MonitorConfig) -> _Measured:
    keep_freed_memory()
    n = plan.block.n_steps
    rows, curve = unmeasured(n), CurveRows.empty(n, config.curve)
    bad = np.array([bool(problem) for problem in plan.problems], dtype=np.bool_)
    rotations: list[PointSeries] = []
    crossings: list[Crossings] = []
    for part in plan.parts:
        measurable, own = ~bad[part.steps], rows[part.steps]
        rotations.append(_rotations(plan, part, measurable, config))
        crossings += _measure_part(plan, part, measurable, rotations[-1], strands, config, own)
        curve.measure(plan, part, own, rotations[-1], strands, config)
    errors, limits = _errors(plan.block, config), plan.limits.stretch
    any_beyond = conclude_steps(rows, bad, plan.block.times, errors, plan.ratios, limits, strands.edges)
    return _Measured(rows, curve, Crossings.joined(crossings), rotations, any_beyond)


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
    rows: StepRows,
) -> Iterator[Crossings]:
    """Run the kernel over the steps of one part, fill their rows, and yield the crossings of each."""
    t, rigid, periodic = part.traces, config.motion == "rigid", plan.block.cells is not None
    rows["rotation_angle"] = rotation_angles(rotations) if rigid else 0.0
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
    has_rings = bool(t.closed.any())
    for k in _to_settle(starts, rows, config.audit and has_rings):
        of_step, row = found.rows(starts[k], starts[k + 1]), rows[k]
        step = StepData(plan, part, k, rotations[k], rigid)
        decided = decide_exactly(of_step, step, t.edges)
        settle(row, len(of_step.undecided), len(decided.open_pairs))
        row["reason"], row["n_crossings"] = decided.reason, len(decided.passages)
        frames = plan.block.frames[step.row : step.row + 2]
        changed = changed_invariants(step.motion, t, decided, f"frames {frames[0]}-{frames[1]}") if has_rings else set()
        if len(decided.passages):
            number = plan.block.first_step + step.row
            yield crossing_table(decided, step, t, changed, number, frames, strands, config.resolution_length)


def _to_settle(starts: Indices, rows: StepRows, audit: bool) -> list[int]:
    """Return the measured steps in which the kernel has found something, or all of them for an audit."""
    n_found = [n_passages + n_undecided for n_passages, n_undecided in starts.tolist()]
    steps = enumerate(pairwise(n_found))
    return [
        k for k, (before, after) in steps if after > before or (audit and not np.isnan(rows["displacement_max"][k]))
    ]


def _errors(block: FrameBlock, config: MonitorConfig) -> Lengths:
    """Return how far each point of a step may be from where the file, or a turned coordinate, has it, Å."""
    errors = np.full(block.n_steps, config.coordinate_error or 0.0)
    if config.motion == "rigid" or block.cells is not None:
        greatest = greatest_magnitudes(block.positions)
        if block.cells is not None:
            greatest = greatest + 2.0 * np.abs(block.cells).sum(axis=(1, 2))
        errors += PLACING_ERROR * np.maximum(greatest[1:], greatest[:-1])
    return errors


def _problems(plan: BlockPlan, rows: StepRows) -> tuple[str, ...]:
    """Return what is wrong with each step in words, where an edge is lost among its images too."""
    if plan.block.cells is None:
        return plan.problems
    problems = list(plan.problems)
    for part in plan.parts:
        jumping = rows["jumping_edge"][part.steps]
        for k in np.flatnonzero(jumping >= 0):
            a, b = part.traces.edges[jumping[k]]
            problems[part.steps.start + k] = (
                f"the edge of vertices {a} and {b} is about half a cell long and jumps by a lattice vector, so that "
                "nobody can tell which image it joins"
            )
    return tuple(problems)


def _stretches(plan: BlockPlan, strands: Strands) -> Stretches:
    row, edge = np.nonzero(plan.ratios >= plan.limits.stretch)
    return Stretches(
        step=plan.block.first_step + row,
        edge=strands.edges[edge],
        ratio=plan.ratios[row, edge],
        limit=plan.limits.stretch[edge],
    )
