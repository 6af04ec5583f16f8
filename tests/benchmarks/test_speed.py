"""How long a monitored run takes beside reading the same frames. Run with ``pytest -m benchmark -s``.

The machine may be noisy and shared, so the two are timed in turn, many times, and the medians of their ratios are
printed: of the time on the wall, and of the processor time of all threads, which others on the machine change less. Of
the latter, reading and measuring can share two cores; the former can only show it where two are free.
"""

import os
import statistics
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
from mdtopo.pipeline import merge

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

ROUNDS = 7
OPTIONS = {"cut": "9"}  # the model chain has bonds of 4.8 Å at its turns, which 5 Å might cut
Times = list[tuple[float, float]]
"""Of each round: seconds on the wall, and of all processors together."""


def read_loop(topology: Path, trajectory: Path) -> int:
    """What every analysis must do: read each frame and copy the backbone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe(str(topology), str(trajectory))
        backbone = universe.select_atoms("name CA")
        return sum(len(backbone.positions) for _ in universe.trajectory)


def timed(job: Callable[[], object]) -> tuple[float, float]:
    start, before = time.perf_counter(), os.times()
    job()
    after = os.times()
    return time.perf_counter() - start, after.user - before.user + after.system - before.system


def in_turn(jobs: dict[str, Callable[[], object]]) -> dict[str, Times]:
    times: dict[str, Times] = {name: [] for name in jobs}
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            times[name].append(timed(job))
    return times


def median_ratios(times: Times, others: Times) -> tuple[float, float]:
    wall, processors = (
        statistics.median(one[k] / other[k] for one, other in zip(times, others, strict=True)) for k in (0, 1)
    )
    return wall, processors


@pytest.mark.parametrize(
    ("n_atoms", "n_frames", "aim"), [(100_000, 200, 1.05), (2_000, 5_000, 2.0)], ids=["100k atoms", "backbone only"]
)
def test_monitor_beside_a_bare_read_loop(tmp_path: Path, n_atoms: int, n_frames: int, aim: float) -> None:
    files = systems.write_trajectory(tmp_path, 2_000, n_atoms, n_frames)

    def monitor(threads: int) -> mdtopo.RunSummary:
        out = tmp_path / "run.h5"
        return mdtopo.monitor(
            *files, select="name CA", out=out, overwrite=True, threads=threads, reader_options=OPTIONS,
            config=systems.POLYLINE_ONLY,
        )  # fmt: skip

    summary = monitor(1)  # compiles, and fills the file cache
    assert summary.n_steps == n_frames - 1
    times = in_turn(
        {"read loop": lambda: read_loop(*files), "1 thread": lambda: monitor(1), "2 threads": lambda: monitor(2)}
    )
    print(f"\n{n_atoms} atoms, 2000 backbone vertices, {n_frames} frames, {ROUNDS} rounds; {summary.counts}")
    for name, of_job in times.items():
        wall, processors = median_ratios(of_job, times["read loop"])
        seconds, busy = (statistics.median(t[k] for t in of_job) for k in (0, 1))
        print(
            f"  {name:10s} {seconds:7.3f} s, {wall:5.2f} x the read loop (aim {aim} x with 2 threads); processors "
            f"{busy:7.3f} s, {processors:5.2f} x"
        )


SHARD = """
import os, sys, time, mdtopo
from benchmark_systems import POLYLINE_ONLY
top, traj, start, stop, out, core = sys.argv[1:]
os.sched_setaffinity(0, {int(core)})  # as a batch system does
def run(frames, out):
    mdtopo.monitor(top, traj, select="name CA", frames=frames, out=out, overwrite=True, threads=1,
                   reader_options={"cut": "9"}, config=POLYLINE_ONLY)
run(slice(0, 200), out)  # compiles, and fills the file cache
print("ready", flush=True)
for _ in sys.stdin:
    begun, before = time.perf_counter(), os.times()
    run(slice(int(start), int(stop)), out)
    after = os.times()
    print(time.perf_counter() - begun, after.user - before.user + after.system - before.system, flush=True)
"""


class Shard:
    """A process on one core that measures a range of frames whenever it is told to, and says how long it took."""

    def __init__(self, files: tuple[Path, Path], frames: slice, out: Path, core: int) -> None:
        words = [sys.executable, "-c", SHARD, *map(str, files), str(frames.start), str(frames.stop), str(out)]
        words.append(str(core))
        tests = Path(systems.__file__).parent
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tests.parent), str(tests)])}
        self.out = out
        self._process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        assert self._read() == "ready"

    def begin(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write("go\n")
        self._process.stdin.flush()

    def ended(self) -> tuple[float, float]:
        wall, processors = map(float, self._read().split())
        return wall, processors

    def close(self) -> None:
        self._process.communicate(timeout=30)

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


def test_two_processes_on_two_shards(tmp_path: Path) -> None:
    """Efficiency: what one process takes, over twice what each of two takes that run side by side on a half."""
    n_frames = 5_001
    files = systems.write_trajectory(tmp_path, 2_000, 2_000, n_frames)
    middle = n_frames // 2
    one, other = sorted(os.sched_getaffinity(0))[:2]
    single = Shard(files, slice(0, n_frames), tmp_path / "single.h5", one)
    halves = [
        Shard(files, slice(0, middle + 1), tmp_path / "a.h5", one),
        Shard(files, slice(middle, n_frames), tmp_path / "b.h5", other),
    ]
    wall, processors, joining = [], [], []
    for _ in range(ROUNDS):
        single.begin()
        alone = single.ended()
        for half in halves:
            half.begin()
        both = [half.ended() for half in halves]
        wall.append(alone[0] / (2.0 * max(seconds for seconds, _ in both)))
        processors.append(alone[1] / sum(busy for _, busy in both))
        joining.append(
            timed(lambda: merge(*(h.out for h in halves), out=tmp_path / "m.h5", overwrite=True))[0] / alone[0]
        )
    for process in (single, *halves):
        process.close()
    print(
        f"\ntwo processes on two shards of {n_frames} frames, a core each, medians of {ROUNDS} rounds: efficiency "
        f"{statistics.median(wall):.2f} on the wall (aim 0.85), {statistics.median(processors):.2f} by processor time; "
        f"merging takes {statistics.median(joining):.3f} of the single run"
    )


def test_import_time() -> None:
    code = "import time; t = time.perf_counter(); import mdtopo; print(time.perf_counter() - t)"
    runs = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in range(5)
    ]
    print(f"\nimport mdtopo: {min(runs):.3f} s at best of five (aim below 0.5 s)")
