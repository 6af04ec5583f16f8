import json
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import mdtopo
from mdtopo import MonitorConfig
from mdtopo.cli.exits import Exit
from mdtopo.cli.monitor import logging_to_stderr


def test_the_summary_goes_to_standard_output(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    out, alerts = tmp_path / "run.h5", tmp_path / "alerts.jsonl"
    outcome = cli("monitor", npz(), "-o", out, "--alerts", alerts)
    assert outcome.code == Exit.DONE
    lines = outcome.out.splitlines()
    assert lines[0] == "PASS: every step is proved: no strand passed through another."
    counts = [int(line[20:].split()[0]) for line in lines[3:8]]
    assert sum(counts) == 11 == int(lines[2].split()[1])
    assert lines[-4].startswith("  closest pair  proved to stay at least ")
    assert lines[-3] == "  smooth curve  interpolating: 11 steps proved"
    assert lines[-4].endswith("-" + lines[-4].rsplit("-", 1)[1])
    assert lines[-2] == f"  alerts        none in {alerts}"
    assert lines[-1] == f"  results       {out}"
    assert alerts.read_text() == ""


def test_the_closest_pair_has_its_name_with_and_without_a_file(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    def closest(outcome: object) -> str:
        (line,) = (line for line in f"{outcome.out}{outcome.err}".splitlines() if "  closest pair  " in line)
        return line

    path = npz()
    wanted = closest(cli("monitor", path, "-o", tmp_path / "run.h5"))
    assert " between " in wanted
    assert closest(cli("monitor", path)) == wanted
    assert closest(cli("watch", tmp_path / "run.h5")) == wanted
    halves = tmp_path / "a.h5", tmp_path / "b.h5"
    for half, frames in zip(halves, (":6", "5:"), strict=True):
        cli("monitor", path, "--frames", frames, "-o", half, "-q")
    assert closest(cli("merge", *halves, "-o", tmp_path / "both.h5")) == wanted


def test_with_alerts_on_standard_output_the_summary_goes_to_standard_error(cli: Callable, npz: Callable) -> None:
    outcome = cli("monitor", npz(), "--alerts", "-", "--near-limit", 1e-9)
    assert [json.loads(line)["kind"] for line in outcome.out.splitlines()] == ["near-limit"]
    assert "WARN: every step is proved, but" in outcome.err


def test_quiet_says_nothing(cli: Callable, npz: Callable) -> None:
    outcome = cli("monitor", npz(), "-q")
    assert (outcome.out, outcome.err) == ("", "")


def test_notes_are_said_on_standard_error(cli: Callable, npz: Callable) -> None:
    lines = cli("monitor", npz(cell=np.zeros((3, 3)))).err.splitlines()
    (note,) = [line for line in lines if "Compiling" not in line]
    assert note.startswith("mdtopo: ")
    assert "not periodic" in note


@pytest.mark.parametrize(
    ("level", "code"),
    [("never", Exit.DONE), ("critical", Exit.DONE), ("warning", Exit.ALERTS), ("info", Exit.ALERTS)],
)
def test_alerts_of_a_severity_or_above_exit_with_3(cli: Callable, npz: Callable, level: str, code: Exit) -> None:
    assert cli("monitor", npz(), "--near-limit", 1e-9, "--fail-on", level).code == code


def test_without_alerts_nothing_fails(cli: Callable, npz: Callable) -> None:
    assert cli("monitor", npz(), "--fail-on", "info").code == Exit.DONE


def test_a_fracture_is_critical(cli: Callable, npz: Callable, breaking: np.ndarray) -> None:
    outcome = cli("monitor", npz(positions=breaking), "--reference-frames", 5, "--fail-on", "critical")
    assert outcome.code == Exit.ALERTS
    assert outcome.out.startswith("FAIL: 1 broken edge; see the alerts.\n")
    assert "1 critical, 2 warnings" in outcome.out


def test_every_option_reaches_the_results_file(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    config = MonitorConfig(
        motion="lab",
        audit=True,
        resolution_length=2.5,
        criterion="nu",
        near_limit=0.7,
        stretch_limit=1.3,
        stretch_spreads=9.0,
        fracture_limit=1.6,
        fracture_spreads=14.0,
        fracture_frames=4,
        reference_frames=3,
        merge_steps=2,
        coordinate_error=0.01,
        block_steps=5,
    )
    words = [
        word
        for name, value in config.to_mapping().items()
        for word in (f"--{name.replace('_', '-')}", *([] if value is True else [str(value)]))
    ]
    path = npz()
    assert (
        cli("monitor", path, "-o", out, "--frames", "1:11:2", "--reader", "arrays", "--threads", 3, *words).code
        == Exit.DONE
    )
    results = mdtopo.read_results(out)
    assert results.config == config.to_mapping()
    assert results.steps["frame_t0"].tolist() == [1, 3, 5, 7]
    assert results.provenance["threads"] == 3
    assert list(results.provenance["argv"][:3]) == ["mdtopo", "monitor", str(path)]


def test_one_frame_is_no_step(cli: Callable, npz: Callable) -> None:
    outcome = cli("monitor", npz(), "--frames", "3:4")
    assert outcome.code == Exit.DONE
    assert outcome.out.startswith("UNPROVEN: there is no step to look at")


def test_only_what_mdtopo_logs_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    with logging_to_stderr({"verbose": True, "quiet": False}):
        logging.getLogger("MDAnalysis.universe").info("chatter")
        logging.getLogger("mdtopo.readers").debug("a detail")
    logging.getLogger("mdtopo").info("after the end")
    assert capsys.readouterr().err == "mdtopo: a detail\n"


@pytest.mark.parametrize(
    ("options", "shown"),
    [({"verbose": False, "quiet": False}, ["info", "warning"]), ({"verbose": False, "quiet": True}, ["warning"])],
)
def test_how_much_is_logged(capsys: pytest.CaptureFixture[str], options: dict[str, bool], shown: list[str]) -> None:
    with logging_to_stderr(options):
        for level in ("debug", "info", "warning"):
            getattr(logging.getLogger("mdtopo"), level)(level)
    assert capsys.readouterr().err == "".join(f"mdtopo: {level}\n" for level in shown)
