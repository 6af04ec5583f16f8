"""How long a monitored run takes beside reading the same frames. Run with ``pytest -m benchmark -s``.

The machine may be noisy, so the two are timed in turn and their ratio is printed, the least of each; nothing is
asserted about time.
"""

import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import benchmark_systems as systems
import MDAnalysis
import pytest

import mdtopo

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

ROUNDS = 3
OPTIONS = {"cut": "9"}  # the model chain has bonds of 4.8 Å at its turns, which 5 Å might cut


def read_loop(topology: Path, trajectory: Path) -> int:
    """What every analysis must do: read each frame and copy the backbone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe(str(topology), str(trajectory))
        backbone = universe.select_atoms("name CA")
        return sum(len(backbone.positions) for _ in universe.trajectory)


def least_times(jobs: dict[str, Callable[[], object]]) -> dict[str, float]:
    least = dict.fromkeys(jobs, float("inf"))
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            least[name] = min(least[name], time.perf_counter() - start)
    return least


@pytest.mark.parametrize(
    ("n_atoms", "n_frames", "aim"), [(100_000, 200, 1.15), (2_000, 5_000, 3.0)], ids=["100k atoms", "backbone only"]
)
def test_monitor_beside_a_bare_read_loop(tmp_path: Path, n_atoms: int, n_frames: int, aim: float) -> None:
    files = systems.write_trajectory(tmp_path, 2_000, n_atoms, n_frames)

    def monitor(threads: int) -> mdtopo.RunSummary:
        out = tmp_path / "run.h5"
        return mdtopo.monitor(
            *files, select="name CA", out=out, overwrite=True, threads=threads, reader_options=OPTIONS
        )

    summary = monitor(1)  # compiles, and fills the file cache
    assert summary.n_steps == n_frames - 1
    jobs = {"read loop": lambda: read_loop(*files), "1 thread": lambda: monitor(1), "2 threads": lambda: monitor(2)}
    times = least_times(jobs)
    print(f"\n{n_atoms} atoms, 2000 backbone vertices, {n_frames} frames; {summary.counts}")
    for name, seconds in times.items():
        per_frame, ratio = seconds / n_frames * 1e6, seconds / times["read loop"]
        print(f"  {name:10s} {seconds:7.3f} s  {per_frame:8.1f} µs a frame  {ratio:5.2f} x the read loop (aim {aim} x)")


def test_import_time() -> None:
    code = "import time; t = time.perf_counter(); import mdtopo; print(time.perf_counter() - t)"
    runs = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in range(5)
    ]
    print(f"\nimport mdtopo: {min(runs):.3f} s at best of five (aim below 0.5 s)")
