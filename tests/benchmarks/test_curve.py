"""The smooth curve in a run, beside the polyline alone: verdicts and time. Run with ``pytest -m benchmark -s``.

The machine may be noisy, so both are timed in turn in one run, in processor time, and the best time of each counts.
"""

import time
from collections import Counter
from pathlib import Path
from typing import Any

import benchmark_systems as systems
import numpy as np
import pytest

from mdtopo import MonitorConfig, RunSummary, Strands, Verdict, monitor, read_results
from mdtopo.records import CurveVerdict
from mdtopo.store import Results

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

N_STEPS, ROUNDS = 100, 5
RUNS = {
    "kg_linear_fine": ("kg/kg_linear.data", "kg/kg_linear_fine.dcd"),
    "kg_rings_fine": ("kg/kg_rings.data", "kg/kg_rings_fine.dcd"),
    "gmx/ca_nojump": ("gmx/ca.gro", "gmx/ca_nojump.xtc"),
    "soft_fine": ("soft/soft.data", "soft/soft_fine.dcd"),
}
TARGET = 3.0
"""A run with the curve may take so many times the time of the polyline alone."""


def timed(curve: Any, *inputs: Any, **how: Any) -> tuple[float, RunSummary]:
    start = time.process_time()
    summary = monitor(*inputs, config=MonitorConfig(curve=curve), threads=1, **how)
    return time.process_time() - start, summary


def cost_of(*inputs: Any, **how: Any) -> tuple[float, float, int]:
    """Return the least processor times of a run, s, with the polyline alone and with the curve, and how many steps."""
    timed("none", *inputs, **how)
    timed("interpolating", *inputs, **how)
    best = [np.inf, np.inf]
    for _ in range(ROUNDS):
        for k, curve in enumerate(("none", "interpolating")):
            seconds, summary = timed(curve, *inputs, **how)
            best[k] = min(best[k], seconds)
    return best[0], best[1], summary.n_steps


def tell_cost(name: str, polyline: float, both: float, steps: int) -> None:
    print(
        f"\n{name}, {steps} steps: polyline {1e3 * polyline / steps:.2f} ms a step, with the curve "
        f"{1e3 * both / steps:.2f} ms: {both / polyline:.2f} x the polyline"
    )


def tell_verdicts(name: str, results: Results) -> None:
    steps = results.steps
    polyline = Counter(Verdict(v).name for v in steps["verdict"].tolist())
    curve = Counter(CurveVerdict(v).name for v in steps["curve_verdict"].tolist())
    flat = ((steps["curve_verdict"] == CurveVerdict.CERTIFIED) & (steps["curve_depth"] == 0)).mean()
    print(f"\n{name}, {len(steps['verdict'])} steps: polyline {dict(polyline)}, curve {dict(curve)}")
    print(
        f"  certified by hulls alone: {flat:.0%} of the steps; greatest depth {steps['curve_depth'].max()}, median "
        f"bezier_ratio {np.nanmedian(steps['curve_bezier_ratio']):.3g}"
    )


@pytest.mark.parametrize("name", RUNS)
def test_verdicts_of_real_runs(shared_data: Path, tmp_path: Path, name: str) -> None:
    inputs = [shared_data / part for part in RUNS[name]]
    monitor(*inputs, out=tmp_path / "run.h5")
    tell_verdicts(name, read_results(tmp_path / "run.h5"))
    tell_cost(name, *cost_of(*inputs, frames=slice(0, N_STEPS + 1)))


def test_cost_at_2000_vertices() -> None:
    chain = systems.compact_chain(2_000)
    frames = np.stack([x.astype(float) for x in systems.jiggled(chain, N_STEPS + 1, step=0.5)])
    polyline, both, steps = cost_of(frames, strands=Strands.from_lengths([2_000]))
    tell_cost("compact chain, 2000 vertices", polyline, both, steps)
    if both > TARGET * polyline:
        print(f"  more than the {TARGET:g} x that is aimed at")
