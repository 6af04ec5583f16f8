"""Does memory grow with the trajectory? Run with ``pytest -m benchmark -s``."""

import json
import subprocess
import sys
from pathlib import Path

import benchmark_systems as systems
import pytest

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

CHILD = """
import json, resource, sys, mdtopo
top, traj, frames, out = sys.argv[1:]
run = mdtopo.monitor(top, traj, select="name CA", frames=slice(0, int(frames)), out=out, reader_options={"cut": "9"})
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps({"steps": run.n_steps, "peak": peak}))
"""


def peak_memory(files: tuple[Path, Path], n_frames: int, out: Path) -> float:
    """Return the peak resident memory of a run over the first frames, MB."""
    command = [sys.executable, "-c", CHILD, *map(str, files), str(n_frames), str(out)]
    answer = json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
    assert answer["steps"] == n_frames - 1
    return float(answer["peak"])


def test_ten_times_the_frames_take_the_same_memory(tmp_path: Path) -> None:
    files = systems.write_trajectory(tmp_path, 2_000, 2_000, 5_000)
    peak_memory(files, 20, tmp_path / "warm.h5")  # compiles
    short, long = peak_memory(files, 500, tmp_path / "a.h5"), peak_memory(files, 5_000, tmp_path / "b.h5")
    print(f"\npeak memory: {short:.1f} MB over 500 frames, {long:.1f} MB over 5000 (limit: 20 MB more)")
    assert long - short < 20.0
