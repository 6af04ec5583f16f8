import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import mdtopo
from mdtopo.cli import COMMANDS, main
from mdtopo.cli.exits import Exit
from mdtopo.errors import AuditError
from mdtopo.store import read_running

NAMES = (
    "demo",
    "doctor",
    "monitor",
    "report",
    "watch",
    "shards",
    "merge",
    "alerts",
    "explain",
    "export",
    "verify",
    "config",
    "readers",
)


def python(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, env={**os.environ, **environment}, check=False
    )


def test_there_is_one_module_for_each_command() -> None:
    assert tuple(module.__name__.rpartition(".")[2] for module in COMMANDS) == NAMES


@pytest.mark.parametrize("words", [["--help"], *([name, "--help"] for name in NAMES)])
def test_every_command_has_help(cli: Callable, words: list[str]) -> None:
    outcome = cli(*words)
    assert outcome.code == Exit.DONE
    assert outcome.out.startswith("usage: mdtopo")
    assert outcome.err == ""


def test_help_names_every_command_and_every_exit_code(cli: Callable) -> None:
    text = cli("--help").out
    for name in NAMES:
        assert f"\n    {name} " in text
    for code in set(Exit) - {Exit.BROKEN_PIPE}:
        assert f"\n  {code.value} " in text


def test_an_unknown_option_is_said_with_the_usage_of_its_command(cli: Callable) -> None:
    outcome = cli("monitor", "a.npz", "--no-such-option")
    assert outcome.code == Exit.USAGE
    assert outcome.err.startswith("usage: mdtopo monitor [options] TOPOLOGY")
    assert "unrecognized arguments: --no-such-option" in outcome.err


def test_version(cli: Callable) -> None:
    assert cli("--version").out == f"mdtopo {mdtopo.__version__}\n"


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["moni"],
        ["monitor"],
        ["monitor", "a.npz", "--no-such-option"],
        ["monitor", "a.npz", "--motion", "sideways"],
        ["monitor", "a.npz", "--near-limit", "far"],
        ["monitor", "a.npz", "--near-limit", "-1"],
        ["monitor", "a.npz", "--near-limit", "3"],
        ["monitor", "a.npz", "--near-limit", "0"],
        ["monitor", "a.npz", "--criterion", "nu", "--near-limit", "0"],
        ["monitor", "a.npz", "--stretch-limit", "3", "--fracture-limit", "1.1"],
        ["monitor", "a.npz", "--threads", "0"],
        ["monitor", "a.npz", "--frames", "3"],
        ["monitor", "a.npz", "--frames", "::-1"],
        ["monitor", "a.npz", "--frames", "a:b"],
        ["monitor", "a.npz", "--reader-option", "dt"],
        ["doctor", "a.npz", "--out", "b.h5"],
    ],
    ids=" ".join,
)
def test_wrong_command_lines_exit_with_2(cli: Callable, words: list[str]) -> None:
    outcome = cli(*words)
    assert outcome.code == Exit.USAGE
    assert outcome.out == ""
    assert "error:" in outcome.err
    assert len(outcome.err.splitlines()) == 2  # the usage, and what is wrong


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["monitor"], ["monitor", "--help"], ["config"]])
def test_quick_commands_import_nothing_slow(words: list[str]) -> None:
    program = (
        "import sys; from mdtopo.cli import main; main(sys.argv[1:]); "
        "print([m for m in ('numba', 'MDAnalysis', 'h5py', 'scipy', 'plotly') if m in sys.modules], file=sys.stderr)"
    )
    assert python("-c", program, *words).stderr.splitlines()[-1] == "[]"


def test_the_package_runs_as_a_module_and_reports_its_exit_code(tmp_path: Path) -> None:
    ended = python("-m", "mdtopo", "monitor", str(tmp_path / "none.npz"))
    assert ended.returncode == Exit.BAD_INPUT
    assert ended.stdout == ""
    assert ended.stderr == f"mdtopo: {tmp_path / 'none.npz'} does not exist.\n"


def test_internal_errors_exit_with_1_and_say_how_to_report(
    cli: Callable, npz: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise AuditError("Two numbers differ.")

    monkeypatch.delenv("MDTOPO_DEBUG", raising=False)
    monkeypatch.setattr("mdtopo.pipeline.monitor", fail)
    outcome = cli("monitor", npz())
    assert outcome.code == Exit.INTERNAL
    assert "AuditError: Two numbers differ." in outcome.err
    assert "report" in outcome.err
    assert "Traceback" not in outcome.err
    assert "Traceback" in cli("monitor", npz(), "-v").err
    monkeypatch.setenv("MDTOPO_DEBUG", "1")
    assert "Traceback" in cli("monitor", npz()).err


def test_an_interrupt_exits_with_130_and_keeps_what_was_measured(
    cli: Callable, npz: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(self: object, progress: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mdtopo.cli.progress.ProgressDisplay.show", interrupt)
    out = tmp_path / "run.h5"
    outcome = cli("monitor", npz(), "--block-steps", 4, "-o", out)
    assert outcome.code == Exit.INTERRUPTED
    assert outcome.err.splitlines()[-1] == (
        f"mdtopo: interrupted. The 4 steps measured until then are in {out}.parts; the same command goes on with them."
    )
    results = read_running(out)
    assert (results.complete, results.in_progress) == (False, True)
    assert len(results.steps["verdict"]) == 4


def test_a_reader_that_goes_away_ends_the_command_quietly(npz: Callable) -> None:
    program = f"{sys.executable} -m mdtopo monitor {npz()} -q --alerts - --near-limit 1e-9; echo $? >&2"
    ended = subprocess.run(
        ["bash", "-c", f"({program}) | true"], capture_output=True, text=True, check=False, timeout=120
    )
    assert ended.stderr == f"{Exit.BROKEN_PIPE.value}\n"


def test_without_a_place_for_compiled_kernels_the_cure_is_said(
    cli: Callable, npz: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("cannot cache function 'row': no locator available for file 'vectors.py'")

    monkeypatch.setattr("mdtopo.pipeline.monitor", fail)
    outcome = cli("monitor", npz())
    assert outcome.code == Exit.BAD_INPUT
    assert "set NUMBA_CACHE_DIR" in outcome.err


def test_main_takes_the_words_of_the_process_by_default(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["mdtopo", "--version"])
    assert main() == Exit.DONE
    assert capsys.readouterr().out.startswith("mdtopo ")
