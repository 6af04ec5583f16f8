"""Does memory grow with the trajectory? Run with ``pytest -m benchmark -s``."""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import benchmark_systems as systems
import pytest

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

CHILD = """
import json, resource, sys, mdtopo
top, traj, frames, out, threads = sys.argv[1:]
held = []
def note(progress):
    if progress.steps * 20 >= (len(held) + 1) * progress.total:
        with open("/proc/self/statm") as file:
            held.append(int(file.read().split()[1]) * resource.getpagesize() / 2**20)
run = mdtopo.monitor(top, traj, select="name CA", frames=slice(0, int(frames)), out=out, overwrite=True,
                     threads=int(threads), reader_options={"cut": "9"}, on_progress=note,
                     config=mdtopo.MonitorConfig(curve="none"))
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps({"steps": run.n_steps, "peak": used.ru_maxrss / 1024, "held": held,
                  "processors": used.ru_utime + used.ru_stime}))
"""


def measured(files: tuple[Path, Path], n_frames: int, out: Path, threads: int = 2) -> dict[str, Any]:
    """Run over the first frames in a process of its own, and return its memory, MB, and its processor time, s."""
    command = [sys.executable, "-c", CHILD, *map(str, files), str(n_frames), str(out), str(threads)]
    answer: dict[str, Any] = json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
    assert answer["steps"] == n_frames - 1
    return answer


def test_ten_times_the_frames_take_the_same_memory(tmp_path: Path) -> None:
    files = systems.write_trajectory(tmp_path, 2_000, 2_000, 5_000)
    measured(files, 20, tmp_path / "warm.h5")  # compiles
    short, long = (measured(files, n, tmp_path / f"{n}.h5")["peak"] for n in (500, 5_000))
    print(f"\npeak memory: {short:.1f} MB over 500 frames, {long:.1f} MB over 5000 (limit: 20 MB more)")
    assert long - short < 20.0


def test_a_million_steps(tmp_path: Path) -> None:
    """One strand of 100 vertices: memory stays, the results file is small, and the report is made."""
    n_steps = 1_000_000
    files, out, page = (
        systems.write_trajectory(tmp_path, 100, 100, n_steps + 1),
        tmp_path / "run.h5",
        tmp_path / "r.html",
    )
    measured(files, 20, out)
    begun = time.perf_counter()
    run = measured(files, n_steps + 1, out)
    seconds, held = time.perf_counter() - begun, run["held"]
    busy = run["processors"] / n_steps * 1e6
    print(f"\n{n_steps} steps of 100 vertices: {seconds:.0f} s, {busy:.0f} µs of processors a step")
    shown = " ".join(f"{mb:.0f}" for mb in held)
    print(f"  memory at every twentieth of the run, MB: {shown}; at most {run['peak']:.0f}")
    print(f"  results file {out.stat().st_size / 1e6:.1f} MB (aim below 200)")
    begun = time.perf_counter()
    report = [sys.executable, "-m", "mdtopo", "report", str(out), "-o", str(page)]
    subprocess.run(report, capture_output=True, check=True)
    print(f"  report in {time.perf_counter() - begun:.0f} s, page {page.stat().st_size / 1e6:.1f} MB")
    assert held[-1] - held[1] < 10.0
    # the profile, a row of float32 for 32 steps and 8 million values at most, is there three times when it is joined
    profile = 3 * 4 * min(8_000_000, n_steps // 32 * 100) / 2**20
    assert run["peak"] - held[1] < 30.0 + profile
    assert out.stat().st_size < 200e6
