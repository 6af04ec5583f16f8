"""The smooth curve's certificate beside the polyline's: verdicts and time. Run with ``pytest -m benchmark -s``.

The machine may be noisy, so both are timed in turn in one run; nothing is asserted about time.
"""

import time
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import benchmark_systems as systems
import numpy as np
import pytest

from mdtopo import MonitorConfig, Rung, Strands, Verdict, polyline_step
from mdtopo.curveladder import CurveMeasure, measure_curve
from mdtopo.curves import StepMotion, step_motion, whole_strands
from mdtopo.geometry.splines import AMPLIFICATION, CONTROL_ERROR, INTERPOLATING, spline_controls
from mdtopo.pipeline.tables import open_input
from mdtopo.records import Frame, StepReport, Traces
from mdtopo.spheres import PLACING_ERROR

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

LAB = MonitorConfig(motion="lab")
N_STEPS = 100
RUNS = {
    "kg_linear_fine": ("kg/kg_linear.data", "kg/kg_linear_fine.dcd"),
    "gmx/ca_nojump": ("gmx/ca.gro", "gmx/ca_nojump.xtc"),
    "soft_fine": ("soft/soft.data", "soft/soft_fine.dcd"),
}


def motion_between(first: Frame, second: Frame, traces: Traces) -> StepMotion:
    """Return the motion of a step in the lab frame, strands whole."""
    ends = []
    for frame in (first, second):
        if frame.cell is None:
            ends.append((frame.positions, np.zeros((3, 3)), 0.0))
            continue
        whole, cell, _, _, placing = whole_strands(
            frame.positions, frame.cell, traces.vertices, traces.offsets, traces.closed
        )
        ends.append((whole, cell, placing))
    (x0, cell0, placing0), (x1, cell1, placing1) = ends
    periodic = first.cell is not None
    return step_motion(
        x0, x1, cell0, cell1, max(placing0, placing1), periodic, False, np.eye(3), traces.vertices, traces.offsets
    )


def curve_of(motion: StepMotion, traces: Traces, periodic: bool) -> CurveMeasure:
    """Measure the interpolating spline of one step."""
    ends = []
    for x in (motion.x0, motion.x1):
        out = np.empty((len(traces.edges), 4, 3))
        spline_controls(x, traces.vertices, traces.offsets, traces.closed, INTERPOLATING, out)
        ends.append(out)
    greatest = max(np.abs(motion.x0).max(), np.abs(motion.x1).max())
    slack = CONTROL_ERROR * greatest
    if periodic:
        slack += AMPLIFICATION[INTERPOLATING] * PLACING_ERROR * (greatest + motion.placing)
    return measure_curve(ends[0], ends[1], traces.following, motion.cell0, motion.cell1, periodic, slack)


def verdict_of(measure: CurveMeasure) -> Verdict:
    if len(measure.found):
        return Verdict.CROSSING
    return Verdict.UNRESOLVED if measure.rung == Rung.OPEN else Verdict.CERTIFIED


def both(frames: list[Frame], strands: Strands) -> Iterator[tuple[StepReport, float, CurveMeasure, float]]:
    """Yield the polyline's report and the curve's measure of each step, each with its time in s."""
    traces, periodic = Traces.of(strands), frames[0].cell is not None
    curve_of(motion_between(frames[0], frames[1], traces), traces, periodic)  # compiles
    for first, second in pairwise(frames):
        start = time.perf_counter()
        report = polyline_step(
            first.positions, second.positions, strands, cell_t0=first.cell, cell_t1=second.cell, config=LAB
        )
        middle = time.perf_counter()
        measure = curve_of(motion_between(first, second, traces), traces, periodic)
        yield report, middle - start, measure, time.perf_counter() - middle


def tell(name: str, frames: list[Frame], strands: Strands) -> None:
    polyline, curve, flat, times = Counter[str](), Counter[str](), 0, []
    for report, seconds, measure, more in both(frames, strands):
        polyline[report.verdict.name] += 1
        curve[verdict_of(measure).name] += 1
        flat += verdict_of(measure) is Verdict.CERTIFIED and measure.depth == 0
        times.append((seconds, more))
    cost = np.median(times, axis=0) * 1e3
    share = flat / len(times)
    print(f"\n{name}: {len(times)} steps; polyline {dict(polyline)}, curve {dict(curve)}")
    print(f"  curve certified without halving: {share:.0%} of the steps")
    print(
        f"  a step: polyline {cost[0]:.2f} ms, curve {cost[1]:.2f} ms more: {1 + cost[1] / cost[0]:.1f} x the polyline"
    )


@pytest.mark.parametrize("name", RUNS)
def test_verdicts_of_real_runs(shared_data: Path, name: str) -> None:
    with open_input(*(shared_data / part for part in RUNS[name])) as reader:
        frames, strands = list(reader.frames(0, N_STEPS + 1, 1)), reader.strands
    tell(name, frames, strands)


def test_cost_at_2000_vertices() -> None:
    chain = systems.compact_chain(2_000)
    frames = [Frame(k, np.nan, x.astype(float)) for k, x in enumerate(systems.jiggled(chain, 41, step=0.5))]
    tell("compact chain, 2000 vertices", frames, Strands.from_lengths([2_000]))
