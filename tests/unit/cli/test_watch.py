"""The watch beside a program that writes the trajectory at the same time."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import mdtopo
from mdtopo.cli.exits import Exit

DEMO = Path(mdtopo.__file__).parent / "demo"

WRITER = """\
import sys, time
source, target, piece = open(sys.argv[1], "rb").read(), open(sys.argv[2], "wb", buffering=0), int(sys.argv[3])
for start in range(0, len(source), piece):
    target.write(source[start:start + piece])
    time.sleep(0.01)
"""


@pytest.fixture
def growing(tmp_path: Path) -> Callable[[int], list[str]]:
    """Starts a process that writes the trajectory of the demo piece by piece, whatever the frames are."""

    def start(piece: int) -> list[str]:
        target = tmp_path / "pull.dcd"
        writers.append(
            subprocess.Popen([sys.executable, "-c", WRITER, str(DEMO / "pull.dcd"), str(target), str(piece)])
        )
        return [str(DEMO / "duplex.data"), str(target)]

    writers: list[subprocess.Popen[bytes]] = []
    yield start
    for writer in writers:
        writer.wait(30)


def test_the_alerts_are_those_of_the_finished_trajectory(
    cli: Callable, tmp_path: Path, growing: Callable[[int], list[str]]
) -> None:
    metrics = tmp_path / "mdtopo.prom"
    inputs = growing(1111)
    watched = cli("watch", *inputs, "--idle-timeout", 2, "--poll", 0.1, "--prometheus", metrics)
    assert watched.code == Exit.DONE, watched.err
    monitored = cli("monitor", *inputs, "--alerts", "-")
    assert watched.out == monitored.out
    assert [json.loads(line)["kind"] for line in watched.out.splitlines()] == ["stretch", "fracture", "stretch"]
    assert "FAIL: 1 broken edge" in watched.err
    assert f'mdtopo_steps_total{{run="{inputs[-1]}"}} 59\n' in metrics.read_text()
    assert f'mdtopo_running{{run="{inputs[-1]}"}} 0\n' in metrics.read_text()


def test_fail_on_counts_here_too(cli: Callable) -> None:
    words = ["watch", DEMO / "duplex.data", DEMO / "pull.dcd", "--idle-timeout", 0.3, "--poll", 0.1, "--quiet"]
    assert cli(*words, "--fail-on", "critical").code == Exit.ALERTS


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_a_good_end(tmp_path: Path, sent: signal.Signals) -> None:
    target, metrics = tmp_path / "pull.dcd", tmp_path / "mdtopo.prom"
    target.write_bytes((DEMO / "pull.dcd").read_bytes()[:40_000])  # ends within a frame
    words = [str(DEMO / "duplex.data"), str(target), "--poll", "0.1", "--prometheus", str(metrics)]
    environment = {**os.environ, "PYTHONPATH": str(Path(mdtopo.__file__).parents[1])}
    watch = subprocess.Popen(
        [sys.executable, "-m", "mdtopo", "watch", *words], stderr=subprocess.PIPE, text=True, env=environment
    )
    end = time.monotonic() + 60
    while not metrics.exists():
        assert watch.poll() is None
        assert time.monotonic() < end
        time.sleep(0.1)
    watch.send_signal(sent)
    _, said = watch.communicate(timeout=20)
    assert watch.returncode == Exit.DONE, said
    assert "PASS" in said
    assert "Traceback" not in said


def test_a_trajectory_that_never_comes_is_named(cli: Callable, tmp_path: Path) -> None:
    outcome = cli("watch", DEMO / "duplex.data", tmp_path / "none.dcd", "--idle-timeout", 0.2, "--poll", 0.1)
    assert outcome.code == Exit.BAD_INPUT
    assert "none.dcd does not exist" in outcome.err


def test_a_trajectory_that_ends_within_a_frame_is_no_success(cli: Callable, tmp_path: Path) -> None:
    target = tmp_path / "pull.dcd"
    target.write_bytes((DEMO / "pull.dcd").read_bytes()[:40_000])
    outcome = cli("watch", DEMO / "duplex.data", target, "--idle-timeout", 0.3, "--poll", 0.1)
    assert outcome.code == Exit.BAD_INPUT
    assert "UNPROVEN" in outcome.err
    assert "ends within frame 26" in outcome.err


def test_a_run_that_was_put_down_has_its_exit_code(cli: Callable, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    monitored = cli("monitor", DEMO / "duplex.data", DEMO / "pull.dcd", "-o", out, "--max-hours", 0, "--block-steps", 8)
    assert monitored.code == Exit.CHECKPOINT
    outcome = cli("watch", out, "--poll", 0.01)
    assert outcome.code == Exit.CHECKPOINT
    assert "was put down after 8 steps, because the 0 hours of --max-hours are over" in outcome.err
    assert cli("monitor", DEMO / "duplex.data", DEMO / "pull.dcd", "-o", out, "--block-steps", 8).code == Exit.DONE
    outcome = cli("watch", out)
    assert outcome.code == Exit.DONE
    assert [json.loads(line)["kind"] for line in outcome.out.splitlines()] == ["stretch", "fracture", "stretch"]
    assert "FAIL: 1 broken edge" in outcome.err


def test_a_run_that_stopped_early_ends_as_it_did(cli: Callable, tmp_path: Path) -> None:
    cut, out = tmp_path / "cut.dcd", tmp_path / "run.h5"
    cut.write_bytes((DEMO / "pull.dcd").read_bytes()[:40_000])
    assert cli("monitor", DEMO / "duplex.data", cut, "-o", out).code == Exit.BAD_INPUT
    outcome = cli("watch", out)
    assert outcome.code == Exit.BAD_INPUT
    assert "stopped early: " in outcome.err


def test_a_run_that_never_begins_is_named(cli: Callable, tmp_path: Path) -> None:
    outcome = cli("watch", tmp_path / "run.h5", "--idle-timeout", 0.1, "--poll", 0.05)
    assert outcome.code == Exit.BAD_INPUT
    assert "run.h5 does not exist, and no run has begun to write it" in outcome.err


@pytest.mark.parametrize("words", [["--select", "all"], ["--near-limit", "0.5"], ["--config", "a.toml"]], ids=" ".join)
def test_a_run_has_its_own_settings(cli: Callable, tmp_path: Path, words: list[str]) -> None:
    outcome = cli("watch", tmp_path / "run.h5", *words)
    assert outcome.code == Exit.USAGE
    assert f"which has settings of its own; leave {words[0]} out" in outcome.err


@pytest.mark.parametrize("value", ["0", "-1", "soon", "inf"])
def test_times_are_checked(cli: Callable, value: str) -> None:
    outcome = cli("watch", "a.pdb", "b.xtc", f"--idle-timeout={value}")
    assert outcome.code == Exit.USAGE
    assert "is not a number of seconds above 0" in outcome.err


@pytest.mark.parametrize("words", [["--report", "a.html"], ["--max-hours", "1"], ["--part-steps", "5"]], ids=" ".join)
def test_an_option_that_would_do_nothing_is_no_option(cli: Callable, words: list[str]) -> None:
    outcome = cli("watch", "top.pdb", "traj.xtc", *words)
    assert outcome.code == Exit.USAGE
    assert "unrecognized arguments" in outcome.err
