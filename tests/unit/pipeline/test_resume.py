"""Runs that are ended and gone on with: nothing that was finished is lost, and the outcome is the same."""

import errno
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import kill_runs
import numpy as np
import pytest

import mdtopo
from mdtopo import MonitorConfig
from mdtopo.cli import main
from mdtopo.cli.exits import Exit
from mdtopo.errors import InputError, OutputError
from mdtopo.pipeline import PartLength, StopRequest
from mdtopo.pipeline.ahead import read_ahead
from mdtopo.store import OutputLock, folder_of, make_folder, read_running

ROOT = Path(__file__).parents[3]
INSTALLED = Path(mdtopo.__file__).parents[1]
SHORT = PartLength(steps=20)


def small_file_system(folder: Path) -> list[str]:
    """Return what begins a command that has a small file system in the place of a folder."""
    folder.mkdir()
    own = ["unshare", "--map-root-user", "--mount"]
    mounting = f"mount -t tmpfs -o size=8m tmpfs {shlex.quote(str(folder))}"
    if not shutil.which("unshare") or subprocess.run([*own, "sh", "-c", mounting], check=False).returncode:
        pytest.skip("this system does not let its users mount a tmpfs")
    return [*own, "sh", "-c", f'{mounting} && exec "$@"', "sh"]


def ended_runs(folder: Path, how: str, count: int, seed: int) -> dict[str, object]:
    words = [sys.executable, str(ROOT / "tests" / "kill_runs.py"), str(folder), how, str(count), str(seed)]
    words = [*small_file_system(folder), *words] if how == "tmpfs" else words
    environment = {**os.environ, "PYTHONPATH": str(INSTALLED)}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    sys.stdout.write(f"{how}: {done.stdout}")
    found: dict[str, object] = json.loads(done.stdout.splitlines()[-1])
    return found


def check_ended_runs(folder: Path, how: str, count: int) -> None:
    found = ended_runs(folder, how, count, seed=7)
    assert found["failed"] == []
    assert found["ended"] == count
    assert found["lost_parts"] == 0
    assert found["chains"] == found["equal"] > 0


@pytest.mark.parametrize(("how", "count"), [("kill", 20), ("term", 12), ("full", 6), ("tmpfs", 6)])
def test_whatever_ends_a_run_it_goes_on_and_ends_as_if_nothing_had_been(tmp_path: Path, how: str, count: int) -> None:
    check_ended_runs(tmp_path / how, how, count)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["kill", "term", "full", "tmpfs"])
def test_two_hundred_times(tmp_path: Path, how: str) -> None:
    check_ended_runs(tmp_path / how, how, 200)


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


def test_a_run_of_one_part_is_written_once(trajectory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, other = tmp_path / "run.h5", tmp_path / "other.h5"
    mdtopo.monitor(trajectory, out=other, parts=SHORT)
    monkeypatch.setattr("mdtopo.pipeline.run.assemble", lambda *_, **__: pytest.fail("it is written again"))
    summary = mdtopo.monitor(trajectory, out=out)
    assert summary.results == out
    assert not folder_of(out).exists()
    assert kill_runs.contents(out) == kill_runs.contents(other)
    with pytest.raises(pytest.fail.Exception):
        mdtopo.monitor(trajectory, out=tmp_path / "third.h5", parts=SHORT)


def test_one_part_that_cannot_have_its_name_is_kept_and_gone_on_with(
    trajectory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, other = tmp_path / "run.h5", tmp_path / "other.h5"
    mdtopo.monitor(trajectory, out=other)
    replace = Path.replace

    def refused(self: Path, target: Path) -> Path:
        if target == out:
            raise OSError(errno.EPERM, "it is not permitted")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", refused)
    part = folder_of(out) / "part-0000000000.h5"
    with pytest.raises(OutputError, match=rf"not permitted.*{part}.*All 239 steps are safe"):
        mdtopo.monitor(trajectory, out=out)
    assert not list(folder_of(out).glob(".*"))
    monkeypatch.undo()
    assert read_running(out).n_steps == 239
    mdtopo.monitor(trajectory, out=out, on_progress=lambda _: pytest.fail("a step is measured again"))
    assert kill_runs.contents(out) == kill_runs.contents(other)


@pytest.mark.parametrize("taken", [False, True])
def test_what_fails_behind_the_last_step_costs_no_step(
    trajectory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, taken: bool
) -> None:
    out, other = tmp_path / "run.h5", tmp_path / "other.h5"
    mdtopo.monitor(trajectory, out=other)

    def fails(_: object) -> None:
        if not taken:
            raise OutputError("the alerts are full")
        out.write_text("somebody else's")

    monkeypatch.setattr("mdtopo.pipeline.alertfile.AlertFile.finish", fails)
    with pytest.raises(OutputError, match="exists already.*All 239 steps are safe" if taken else "alerts are full"):
        mdtopo.monitor(trajectory, out=out)
    assert read_running(out).n_steps == 239
    monkeypatch.undo()
    out.unlink(missing_ok=True)
    mdtopo.monitor(trajectory, out=out, on_progress=lambda _: pytest.fail("a step is measured again"))
    assert kill_runs.contents(out) == kill_runs.contents(other)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_no_bit_depends_on_threads_parts_or_stops(trajectory: Path, tmp_path: Path, threads: int) -> None:
    whole, other = tmp_path / "whole.h5", tmp_path / "other.h5"
    config = MonitorConfig(block_steps=5)
    mdtopo.monitor(trajectory, out=whole, alerts=whole.with_suffix(".jsonl"), config=config, threads=1)
    count = 0
    while not other.exists():
        summary = mdtopo.monitor(
            trajectory, out=other, alerts=other.with_suffix(".jsonl"), config=config, threads=threads,
            stop=StopsAfter(13), parts=SHORT,
        )  # fmt: skip
        assert bool(summary.checkpoint) is not other.exists()
        count += 1
    assert count == 4
    found, expected = kill_runs.contents(other), kill_runs.contents(whole)
    for key in {*found, *expected} - {"@provenance"}:
        assert found[key] == expected[key], key
    assert other.with_suffix(".jsonl").read_bytes() == whole.with_suffix(".jsonl").read_bytes()
    assert summary.to_mapping() == json.loads(str(expected["@summary"]))
    assert summary.n_fractures >= 1
    assert min(summary.counts.crossed, summary.counts.unresolved, summary.counts.near_limit) > 0


def put_down(trajectory: Path, out: Path, **how: object) -> None:
    assert mdtopo.monitor(trajectory, out=out, stop=StopsAfter(2), **how).checkpoint == "enough"  # type: ignore[arg-type]


def test_finished_parts_of_a_run_can_be_read(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    with pytest.raises(InputError, match="has no finished part yet"):
        read_running(out)
    put_down(trajectory, out, parts=SHORT)
    found = read_running(out)
    assert (found.in_progress, found.complete, len(found.steps["verdict"])) == (True, False, 128)
    mdtopo.monitor(trajectory, out=out)
    whole = mdtopo.read_results(out)
    assert found.steps["clearance"].tobytes() == whole.steps["clearance"][:128].tobytes()
    assert not whole.in_progress


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"config": MonitorConfig(near_limit=0.7)}, "near_limit was 0.8, and now is 0.7"),
        ({"config": MonitorConfig(motion="lab")}, "motion was 'rigid', and now is 'lab'"),
        ({"config": MonitorConfig(curve="bspline")}, "curve was 'interpolating', and now is 'bspline'"),
        ({"frames": slice(0, 200)}, r"frames was \[None, None, None\], and now is \[0, 200, None\]"),
        ({"reader": "arrays"}, "reader was not given, and now is 'arrays'"),
    ],
)
def test_other_settings_are_refused_by_name(
    trajectory: Path, tmp_path: Path, change: dict[str, object], words: str
) -> None:
    out = tmp_path / "run.h5"
    put_down(trajectory, out)
    with pytest.raises(OutputError, match=rf"{words}\. Give the earlier values .*--overwrite"):
        mdtopo.monitor(trajectory, out=out, **change)  # type: ignore[arg-type]
    assert len(read_running(out).steps["verdict"]) == 128
    assert mdtopo.monitor(trajectory, out=out, overwrite=True, **change).n_steps in (199, 239)  # type: ignore[arg-type]


def test_another_input_is_refused_by_name(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    put_down(trajectory, out)
    kill_runs.write_input(trajectory, n_frames=241)
    with pytest.raises(OutputError, match=r"the size of .*input\.npz was \d+ bytes, and now is \d+\."):
        mdtopo.monitor(trajectory, out=out)
    kill_runs.write_input(trajectory, n_frames=240)
    with trajectory.open("r+b") as file:
        file.seek(5000)
        file.write(b"x")
    with pytest.raises(OutputError, match=r"the content of .*input\.npz has changed"):
        mdtopo.monitor(trajectory, out=out)


def test_a_missing_part_is_named(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    assert mdtopo.monitor(trajectory, out=out, stop=StopsAfter(3), parts=SHORT).checkpoint
    first, *_, last = sorted(folder_of(out).glob("part-*.h5"))
    kept = last.read_bytes()
    last.unlink()
    with pytest.raises(OutputError, match=f"{last.name} is missing; restore it"):
        mdtopo.monitor(trajectory, out=out)
    last.write_bytes(kept)
    first.write_bytes(kept[:100])
    with pytest.raises(OutputError, match=r"is truncated or damaged .*Restore it"):
        mdtopo.monitor(trajectory, out=out)


@pytest.fixture
def whole(trajectory: Path, tmp_path: Path) -> Path:
    """The results of a run that nobody ended."""
    out = tmp_path / "whole.h5"
    mdtopo.monitor(trajectory, out=out)
    return out


def check_goes_on(trajectory: Path, out: Path, whole: Path, kept: int, **how: object) -> None:
    """Go on with a run, and check that it has kept some parts and ends as the whole one has."""
    before = kill_runs.digests(folder_of(out))
    mdtopo.monitor(trajectory, out=out, parts=SHORT, stop=StopsAfter(1), **how)  # type: ignore[arg-type]
    after = kill_runs.digests(folder_of(out))
    assert sum(after.get(name) == digest for name, digest in before.items()) == kept
    mdtopo.monitor(trajectory, out=out, **how)  # type: ignore[arg-type]
    found, expected = kill_runs.contents(out), kill_runs.contents(whole)
    for key in {*found, *expected} - {"@provenance"}:
        assert found[key] == expected[key], key


@pytest.mark.parametrize("text", [None, "", "{", "[]", '{"schema": "mdtopo.state/1"}', "\N{SNOWMAN}"])
def test_a_state_file_that_is_lost_or_damaged_costs_nothing(
    trajectory: Path, tmp_path: Path, whole: Path, text: str | None
) -> None:
    out = tmp_path / "run.h5"
    put_down(trajectory, out, parts=SHORT)
    state = folder_of(out) / "state.json"
    if text is None:
        state.unlink()
    else:
        state.write_text(text, encoding="utf-16")
    with pytest.raises(OutputError, match=r"near_limit was 0\.8, and now is 0\.7"):  # the parts know whose they are
        mdtopo.monitor(trajectory, out=out, config=MonitorConfig(near_limit=0.7))
    check_goes_on(trajectory, out, whole, 2)


def test_a_state_file_of_another_version_is_left_alone(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    put_down(trajectory, out, parts=SHORT)
    state = folder_of(out) / "state.json"
    state.write_text(state.read_text().replace("mdtopo.state/1", "mdtopo.state/9"))
    with pytest.raises(OutputError, match=r"has the format mdtopo\.state/9, and this mdtopo knows mdtopo\.state/1"):
        mdtopo.monitor(trajectory, out=out)
    assert mdtopo.monitor(trajectory, out=out, overwrite=True).n_steps == 239


@pytest.mark.parametrize(("name", "kept"), [("part-0000000000.h5", 0), ("part-0000000064.h5", 1)])
@pytest.mark.parametrize("size", [None, 0, 5000])
def test_in_front_of_a_lost_or_damaged_part_a_run_goes_on_when_it_is_told_to(
    trajectory: Path, tmp_path: Path, whole: Path, name: str, kept: int, size: int | None
) -> None:
    out = tmp_path / "run.h5"
    put_down(trajectory, out, parts=SHORT)
    path = folder_of(out) / name
    if size is None:
        path.unlink()
    else:
        os.truncate(path, size)
    with pytest.raises(OutputError, match=r"part-\d+\.h5 .*[Rr]estore it, or give --overwrite to go on in front of it"):
        mdtopo.monitor(trajectory, out=out)
    check_goes_on(trajectory, out, whole, kept, overwrite=True)


def test_what_stands_in_the_place_of_the_parts_is_named(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    folder_of(out).write_text("mine")
    with pytest.raises(OutputError, match=r"run\.h5\.parts is no directory, and parts of .*run\.h5 belong there"):
        mdtopo.monitor(trajectory, out=out)
    assert folder_of(out).read_text() == "mine"


def test_a_lock_that_cannot_be_made_is_named(trajectory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_folder(tmp_path / "run.h5")
    opened = os.open

    def refuse(path: object, *rest: int) -> int:
        if str(path).endswith("lock"):
            raise OSError(errno.EROFS, "Read-only file system")
        return opened(path, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(OutputError, match=r"lock cannot be written \(Read-only file system\)"):
        mdtopo.monitor(trajectory, out=tmp_path / "run.h5")


@pytest.mark.parametrize("make", [Path.touch, Path.mkdir])
def test_an_alert_file_that_is_there_leaves_no_trace(
    trajectory: Path, tmp_path: Path, make: Callable[[Path], None]
) -> None:
    alerts = tmp_path / "alerts.jsonl"
    make(alerts)
    with pytest.raises(OutputError, match=r"alerts\.jsonl (exists already|is a directory)"):
        mdtopo.monitor(trajectory, out=tmp_path / "run.h5", alerts=alerts)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["alerts.jsonl", "input.npz"]


def test_an_alert_file_that_cannot_be_made_leaves_no_trace(trajectory: Path, tmp_path: Path) -> None:
    with pytest.raises(
        OutputError, match=r"alerts\.jsonl cannot be written, because the directory .*none does not exist"
    ):
        mdtopo.monitor(trajectory, out=tmp_path / "run.h5", alerts=tmp_path / "none" / "alerts.jsonl")
    assert [path.name for path in tmp_path.iterdir()] == ["input.npz"]


@pytest.mark.parametrize(
    "words", [["--max-hours", "-1"], ["--max-hours", "nan"], ["--part-minutes", "-1"]], ids=" ".join
)
def test_times_below_zero_are_wrong_usage(
    trajectory: Path, tmp_path: Path, capsys: pytest.CaptureFixture, words: list[str]
) -> None:
    assert main(["monitor", str(trajectory), "-o", str(tmp_path / "run.h5"), *words]) == Exit.USAGE
    assert words[1] in capsys.readouterr().err


def test_an_object_in_memory_is_not_gone_on_with(tmp_path: Path) -> None:
    out, strands = tmp_path / "run.h5", mdtopo.Strands.from_lengths([4])
    x = np.cumsum(np.full((300, 4, 3), 0.01), axis=0) + np.arange(4)[:, np.newaxis]
    summary = mdtopo.monitor(x, strands=strands, out=out, stop=StopsAfter(2))
    assert (summary.checkpoint, summary.stopped, summary.n_steps) == ("", "enough", 128)
    assert not mdtopo.read_results(out).complete
    assert not folder_of(out).exists()


def test_a_finished_run_is_not_measured_again(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    first = mdtopo.monitor(trajectory, out=out)
    before = out.read_bytes()
    assert mdtopo.monitor(trajectory, out=out) == first
    assert out.read_bytes() == before
    with pytest.raises(OutputError, match="exists already"):
        mdtopo.monitor(trajectory, out=out, frames=slice(0, 5))


def test_a_run_that_replaces_its_own_complete_results_goes_on_too(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    mdtopo.monitor(trajectory, out=out)
    put_down(trajectory, out, parts=SHORT, overwrite=True)
    parts = kill_runs.digests(folder_of(out))
    assert len(parts) == 2
    put_down(trajectory, out, parts=SHORT, overwrite=True)
    after = kill_runs.digests(folder_of(out))
    assert parts.items() < after.items()
    before = out.read_bytes()
    assert mdtopo.monitor(trajectory, out=out, overwrite=True).n_steps == 239
    assert out.read_bytes() != before  # the times of the new run
    assert not folder_of(out).exists()


def test_a_second_writer_is_refused_and_the_first_is_named(trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    make_folder(out)
    lock = folder_of(out) / "lock"
    with OutputLock(lock, out), pytest.raises(OutputError, match="another run of this process"):
        mdtopo.monitor(trajectory, out=out)
    code = (
        "import sys, time; from pathlib import Path; from mdtopo.store import OutputLock\n"
        "held = OutputLock(Path(sys.argv[1]), Path('x')); print('held', flush=True); time.sleep(60)"
    )
    make_folder(out)
    words = [sys.executable, "-c", code, str(lock)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=ROOT) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(OutputError, match=rf"run\.h5 is being written by process {other.pid} on "):
            mdtopo.monitor(trajectory, out=out, overwrite=True)
        other.kill()
    assert mdtopo.monitor(trajectory, out=out).n_steps == 239  # the lock died with its holder


def test_alerts_of_another_run_are_not_gone_on_with(trajectory: Path, tmp_path: Path) -> None:
    out, alerts = tmp_path / "run.h5", tmp_path / "alerts.jsonl"
    put_down(trajectory, out, alerts=alerts)
    lines = alerts.read_text().splitlines(keepends=True)
    alerts.write_text("".join(["{}\n", *lines[1:]]))
    with pytest.raises(OutputError, match="does not hold the alerts of this run"):
        mdtopo.monitor(trajectory, out=out, alerts=alerts)


def test_max_hours_puts_a_run_down_with_code_75(
    trajectory: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    out = tmp_path / "run.h5"
    words = ["monitor", str(trajectory), "-o", str(out)]
    assert main([*words, "--max-hours", "0"]) == Exit.CHECKPOINT
    assert "put down after 64 steps, because the 0 hours of --max-hours are over" in capsys.readouterr().err
    assert main(words) == Exit.DONE
    assert mdtopo.read_results(out).complete


def test_a_second_interrupt_ends_at_once(tmp_path: Path) -> None:
    code = (
        "import os, signal; from mdtopo.pipeline import StopRequest, stopping_on_signals\n"
        "with stopping_on_signals(StopRequest()) as request:\n"
        "    os.kill(os.getpid(), signal.SIGINT); print(request.reason, flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGINT); print('never')"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert (ended.returncode, ended.stdout) == (Exit.INTERRUPTED, "SIGINT was received\n")


def test_a_signal_behind_the_end_changes_no_exit_code(trajectory: Path, tmp_path: Path) -> None:
    """A batch system may send one while Python shuts down, and must not take a finished job for a failed one."""
    words = [sys.executable, "-m", "mdtopo", "monitor", str(trajectory), "-o", str(tmp_path / "run.h5")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if "results" in line:
                process.send_signal(signal.SIGTERM)
        assert process.wait(60) == Exit.DONE
    assert mdtopo.read_results(tmp_path / "run.h5").complete


def test_signals_are_given_back(tmp_path: Path) -> None:
    from mdtopo.pipeline import stopping_on_signals

    before = signal.getsignal(signal.SIGTERM)
    with stopping_on_signals(StopRequest()) as request:
        os.kill(os.getpid(), signal.SIGUSR1)
        assert request.reason == "SIGUSR1 was received"
    assert signal.getsignal(signal.SIGTERM) is before


def test_reading_ahead_keeps_order_and_errors_and_ends_its_thread() -> None:
    def numbers(n: int) -> object:
        yield from range(n)
        raise ValueError("the end")

    seen = []
    with pytest.raises(ValueError, match="the end"):
        seen.extend(read_ahead(numbers(50), 2))  # type: ignore[arg-type]
    before = threading.active_count()
    ahead = read_ahead(iter(range(10**9)), 2)
    assert [next(ahead) for _ in range(3)] == [0, 1, 2]
    ahead.close()
    assert threading.active_count() == before


def test_reading_ahead_is_bounded() -> None:
    made: list[int] = []
    ahead = read_ahead((made.append(k) or k for k in range(100)), 2)
    next(ahead)
    time.sleep(0.2)
    assert len(made) <= 1 + 2 + 1  # taken, waiting, and one in hand
    ahead.close()


def test_an_error_while_measuring_ends_the_run_and_keeps_what_was_measured(
    trajectory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mdtopo.pipeline import tables

    measure: Callable = tables.measure_plan

    def fail(plan: object, *rest: object) -> object:
        if plan.block.first_step >= 128:  # type: ignore[attr-defined]
            raise MemoryError("no room")
        return measure(plan, *rest)

    out = tmp_path / "run.h5"
    monkeypatch.setattr(tables, "measure_plan", fail)
    with pytest.raises(MemoryError):
        mdtopo.monitor(trajectory, out=out, threads=2)
    assert len(read_running(out).steps["verdict"]) == 128
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("mdtopo")] == []
