"""Compiles what a monitored step needs before tests begin in several processes, each of which would compile it all.

``python kernel_cache.py polyline`` (or ``curve``) compiles one half; the halves take about the same time, and have
little in common. What is compiled already is only loaded.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import mdtopo
from mdtopo.curverows import CurveRows
from mdtopo.planning import plan_step
from mdtopo.profiles import part_profile
from mdtopo.records import FrameBlock, MonitorConfig, Strands
from mdtopo.steprows import unmeasured

STRANDS = Strands.from_lengths([4, 4])
POSITIONS = np.random.default_rng(1).uniform(0, 9, (8, 3)) + np.zeros((2, 1, 1))


def compile_all() -> None:
    """Compile both halves at once.

    Raises
    ------
    subprocess.CalledProcessError
        If one of them fails.
    """
    environment = {**os.environ, "PYTHONPATH": str(Path(mdtopo.__file__).parents[1])}
    halves = [subprocess.Popen([sys.executable, __file__, half], env=environment) for half in HALVES]
    for half in halves:
        half.wait()
    for half in halves:
        if half.returncode:
            raise subprocess.CalledProcessError(half.returncode, half.args)


def compile_polyline() -> None:
    mdtopo.polyline_step(*POSITIONS, STRANDS)


def compile_curve() -> None:
    """Compile what measures the curve, and the profile: the two that a polyline's step does without."""
    config, rotations = MonitorConfig(), np.eye(3)[np.newaxis]
    plan = plan_step(FrameBlock(0, np.arange(2), np.arange(2.0), POSITIONS, None, problems=("", "")), STRANDS)
    (part,) = plan.parts
    rows = unmeasured(1)
    rows["displacement_max"] = rows["clearance"] = 0.0
    CurveRows.empty(1, config.curve).measure(plan, part, rows, rotations, STRANDS, config)
    part_profile(plan, part, rows, rotations, config)


HALVES = {"polyline": compile_polyline, "curve": compile_curve}


if __name__ == "__main__":
    HALVES[sys.argv[1]]()
