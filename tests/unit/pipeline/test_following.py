"""A run that is followed by its output says its alerts once more, and how it ended."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import kill_runs
import pytest

import mdtopo
from mdtopo import MonitorConfig
from mdtopo.cli import main
from mdtopo.cli.exits import Exit
from mdtopo.errors import InputError
from mdtopo.pipeline import PartLength, StopRequest
from mdtopo.pipeline.following import Followed, follow
from mdtopo.store import OutputLock, folder_of, make_folder
from mdtopo.store.lock import is_held
from mdtopo.store.stages import Stage, is_output, look_at

ROOT = Path(__file__).parents[3]
INSTALLED = Path(mdtopo.__file__).parents[1]
CONFIG = MonitorConfig(block_steps=4)
SHORT = PartLength(steps=20)


@pytest.fixture
def trajectory(tmp_path: Path) -> Path:
    return kill_runs.write_input(tmp_path / "input.npz")


class StopsAfter(StopRequest):
    """Asks to stop at the n-th block."""

    def __init__(self, n: int) -> None:
        super().__init__()
        self.left = n

    @property
    def reason(self) -> str:
        self.left -= 1
        return "enough" if self.left <= 0 else ""


def advance(trajectory: Path, out: Path, n_blocks: int = 13) -> None:
    alerts = out.with_suffix(".jsonl")
    mdtopo.monitor(trajectory, out=out, alerts=alerts, config=CONFIG, stop=StopsAfter(n_blocks), parts=SHORT)


def followed(out: Path, acts: list[Callable[[], object]] | None = None, **how: object) -> tuple[Followed, bytes]:
    """Follow a run; between two looks the next of the acts is done, and when there is none left, time passes."""
    now, left, alerts = [0.0], list(acts or []), out.with_name("followed.jsonl")

    def sleep(seconds: float) -> None:
        now[0] += seconds
        if left:
            left.pop(0)()

    options = {"poll": 0.125, "idle_timeout": 3.0, "overwrite": True, "clock": lambda: now[0], "sleep": sleep, **how}
    return follow(out, alerts=alerts, **options), alerts.read_bytes()  # type: ignore[arg-type]


def test_the_alerts_are_those_of_the_run_as_its_parts_come(trajectory: Path, tmp_path: Path) -> None:
    out, metrics, seen = tmp_path / "run.h5", tmp_path / "run.prom", []

    def go_on() -> None:
        seen.append(metrics.read_text() if metrics.exists() else "")
        advance(trajectory, out)

    result, alerts = followed(out, [go_on] * 5, prometheus=metrics)
    assert result.end.stage is Stage.COMPLETE
    assert alerts == out.with_suffix(".jsonl").read_bytes()
    stored = mdtopo.read_results(out)
    assert result.summary.to_mapping() == stored.summary
    assert result.config.to_mapping() == stored.config
    counts = [f'mdtopo_steps_total{{run="{out}"}} {n}\n' for n in (52, 104, 156, 208)]
    assert seen[0] == ""
    assert [count in text for count, text in zip(counts, seen[1:], strict=True)] == [True] * 4
    assert f'mdtopo_steps_total{{run="{out}"}} 239\n' in metrics.read_text()
    assert f'mdtopo_running{{run="{out}"}} 0\n' in metrics.read_text()


def test_a_finished_run_is_said_at_once(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    advance(trajectory, out, 1000)
    result, alerts = followed(out)
    assert result.end.stage is Stage.COMPLETE
    assert alerts == out.with_suffix(".jsonl").read_bytes()


def test_a_run_that_was_put_down_is_left_after_a_second_look(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    advance(trajectory, out)
    result, alerts = followed(out)
    assert (result.end.stage, result.end.reason, result.summary.n_steps) == (Stage.PUT_DOWN, "enough", 52)
    assert (result.summary.checkpoint, result.summary.results) == ("enough", None)
    assert alerts == out.with_suffix(".jsonl").read_bytes()  # events that are open are not said: they may go on


def test_a_run_that_has_failed_says_why(trajectory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mdtopo.pipeline import tables

    measure: Callable = tables.measure_plan

    def fail(plan: object, *rest: object) -> object:
        if plan.block.first_step >= 100:  # type: ignore[attr-defined]
            raise MemoryError("no room")
        return measure(plan, *rest)

    out = tmp_path / "run.h5"
    with monkeypatch.context() as patched:
        patched.setattr(tables, "measure_plan", fail)
        with pytest.raises(MemoryError):
            advance(trajectory, out, 1000)
    result, _ = followed(out)
    assert (result.end.stage, result.end.reason, result.summary.n_steps) == (Stage.FAILED, "no room", 100)
    advance(trajectory, out, 1000)
    assert followed(out)[0].end.stage is Stage.COMPLETE


def test_another_run_in_the_place_of_the_first_is_no_continuation(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    advance(trajectory, out)

    def replace_it() -> None:
        mdtopo.monitor(trajectory, out=out, overwrite=True)

    with pytest.raises(InputError, match="another run than before"):
        followed(out, [replace_it])


def test_old_results_are_not_the_run_that_replaces_them(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    advance(trajectory, out, 1000)
    mdtopo.monitor(trajectory, out=out, config=CONFIG, overwrite=True, stop=StopsAfter(6), parts=SHORT)
    assert look_at(out).stage is Stage.PUT_DOWN
    result, _ = followed(out)
    assert (result.end.stage, result.summary.n_steps) == (Stage.PUT_DOWN, 24)


def test_what_counts_as_an_output(trajectory: Path, tmp_path: Path) -> None:
    assert not is_output(trajectory)
    assert not is_output(tmp_path / "later.xtc")
    assert is_output(tmp_path / "later.h5")
    advance(trajectory, tmp_path / "run.out", 1000)
    assert is_output(tmp_path / "run.out")
    make_folder(tmp_path / "run.dat")
    assert is_output(tmp_path / "run.dat")


def test_a_lock_is_asked_for_and_not_tried(tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    make_folder(out)
    lock = folder_of(out) / "lock"
    assert not is_held(lock)
    with OutputLock(lock, out):
        assert is_held(lock)
        asked = subprocess.run(
            [sys.executable, "-c", "import sys; from pathlib import Path; from mdtopo.store.lock import is_held; "
             "sys.exit(7 if is_held(Path(sys.argv[1])) else 0)", str(lock)], cwd=ROOT, check=False
        )  # fmt: skip
        assert asked.returncode == 7
        assert is_held(lock)  # who asks does not let go of it
    lock.write_text("")  # what a killed process leaves
    assert not is_held(lock)


@pytest.fixture
def running(trajectory: Path, tmp_path: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """A monitor in another process, held in its middle."""
    out = tmp_path / "run.h5"
    words = [sys.executable, "-m", "mdtopo", *kill_runs.command([str(trajectory)], out)]
    with subprocess.Popen(words, env={**os.environ, "PYTHONPATH": str(INSTALLED)}) as process:
        end = time.monotonic() + 60
        while len(list(folder_of(out).glob("part-*.h5"))) < 3:
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.001)
        process.send_signal(signal.SIGSTOP)
        yield process, out
        process.kill()


def test_a_monitor_in_another_process_is_followed_to_its_end(running: tuple[subprocess.Popen[bytes], Path]) -> None:
    process, out = running
    result, first = followed(out)
    assert result.end.stage is Stage.RUNNING
    assert 60 <= result.summary.n_steps < 239
    process.send_signal(signal.SIGCONT)
    result, alerts = followed(out, idle_timeout=None, clock=time.monotonic, sleep=time.sleep)
    assert result.end.stage is Stage.COMPLETE
    assert process.wait(60) == 0
    assert alerts == out.with_suffix(".jsonl").read_bytes()
    assert alerts.startswith(first)
    assert first


def test_a_monitor_that_is_killed_meanwhile(
    running: tuple[subprocess.Popen[bytes], Path], capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    process, out = running
    process.kill()
    process.wait(60)
    assert main(["watch", str(out), "--poll", "0.01", "-q"]) == Exit.CHECKPOINT
    said = capfdbinary.readouterr()
    alerts = out.with_suffix(".jsonl")
    assert said.out
    assert alerts.read_bytes().startswith(said.out)
    assert f"the run of {out} was killed; " in said.err.decode()
    trajectory = out.with_name("input.npz")
    assert main(kill_runs.command([str(trajectory)], out)) == Exit.DONE
    assert main(["watch", str(out), "-q", "--fail-on", "critical"]) == Exit.ALERTS
    assert capfdbinary.readouterr().out == alerts.read_bytes()
