import csv
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from mdtopo.cli.alertformats import printable
from mdtopo.cli.exits import Exit


@pytest.fixture
def results(cli: Callable, npz: Callable, breaking: np.ndarray, tmp_path: Path) -> Path:
    """Results of a strand that breaks, with three kinds of alerts; beside it the stream as the run wrote it."""
    out = tmp_path / "run.h5"
    words = ["-o", out, "--alerts", tmp_path / "alerts.jsonl", "--near-limit", "0.01", "-q"]
    assert cli("monitor", npz(positions=breaking), *words).code == Exit.DONE
    return out


def lines(text: str) -> list[dict]:
    return [json.loads(line) for line in text.splitlines()]


def test_what_is_not_a_terminal_gets_the_lines_that_the_run_wrote(cli: Callable, results: Path) -> None:
    outcome = cli("alerts", results)
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    assert outcome.out == results.with_name("alerts.jsonl").read_text()
    assert {line["kind"] for line in lines(outcome.out)} == {"near-limit", "stretch", "fracture"}
    assert cli("alerts", results, "--near-limit", "0.01").out == outcome.out


def test_a_terminal_gets_a_table(cli: Callable, results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cli("alerts", results, "--format", "table").out.splitlines()[0].split()[:3] == ["severity", "kind", "steps"]
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    outcome = cli("alerts", results, "--kind", "fracture")
    heading, row = outcome.out.splitlines()
    assert heading.split() == ["severity", "kind", "steps", "peak", "frames", "time/ps", "value", "limit", "where"]
    assert row.split()[:6] == ["critical", "fracture", "7", "7", "7-8", "7-8"]
    assert outcome.err == "mdtopo: 1 of 4 alerts; near-limit means a pair ratio of 0.01 or more.\n"


def test_filters_narrow_and_combine(cli: Callable, results: Path) -> None:
    every = lines(cli("alerts", results).out)
    assert [line["kind"] for line in lines(cli("alerts", results, "--kind", "stretch").out)] == ["stretch"] * 2
    both = lines(cli("alerts", results, "--kind", "stretch", "--kind", "fracture").out)
    assert both == [line for line in every if line["kind"] in ("stretch", "fracture")]
    assert [line["kind"] for line in lines(cli("alerts", results, "--severity", "critical").out)] == ["fracture"]
    assert lines(cli("alerts", results, "--severity", "info").out) == every
    assert lines(cli("alerts", results, "--kind", "stretch", "--severity", "critical").out) == []
    assert lines(cli("alerts", results, "--strand", "strand 0").out) == every


def test_that_no_alert_passes_is_said(cli: Callable, results: Path) -> None:
    outcome = cli("alerts", results, "--kind", "crossing")
    assert (outcome.code, outcome.out, outcome.err) == (Exit.DONE, "", "mdtopo: no alerts match, of 4.\n")


@pytest.mark.parametrize(("frames", "found"), [("0:7", 0), ("0:8", 1), ("8:", 1), ("9:", 0), (":", 1), ("7:8", 1)])
def test_a_frame_range_keeps_alerts_that_meet_it(cli: Callable, results: Path, frames: str, found: int) -> None:
    kept = lines(cli("alerts", results, "--kind", "fracture", "--frames", frames).out)  # of the frames 7 and 8
    assert len(kept) == found


def test_another_limit_draws_the_near_limit_alerts_anew(cli: Callable, npz: Callable, results: Path) -> None:
    assert lines(cli("alerts", results, "--kind", "near-limit", "--near-limit", "1.0").out) == []
    drawn = cli("alerts", results, "--criterion", "clearance", "--near-limit", 0.98, "--kind", "near-limit").out
    near = lines(drawn)[0]
    assert near["limit"] == 0.98
    assert "clearance" in near["message"]
    again = results.with_name("again.h5")
    words = ["--criterion", "clearance", "--near-limit", "0.98"]
    assert cli("monitor", results.with_name("tiny.npz"), "-o", again, *words, "-q").code == Exit.DONE
    assert cli("alerts", results, *words).out == cli("alerts", again).out


@pytest.mark.parametrize(
    "words", [["--near-limit", "3"], ["--criterion", "pair", "--near-limit", "1.01"]], ids=" ".join
)
def test_a_pair_ratio_beyond_the_limit_is_not_near_it(cli: Callable, results: Path, words: list[str]) -> None:
    outcome = cli("alerts", results, "--strand", "strand 0", *words)
    assert (outcome.code, outcome.out) == (Exit.USAGE, "")
    assert f"near_limit is {words[-1]}: a pair ratio of 1 is the limit itself" in outcome.err
    assert cli("alerts", results, "--near-limit", "1").code == Exit.DONE
    assert cli("alerts", results, "--near-limit", "3", "--criterion", "clearance").code == Exit.DONE


def test_csv_has_the_fields_of_the_json_lines(cli: Callable, results: Path) -> None:
    rows = list(csv.DictReader(io.StringIO(cli("alerts", results, "--format", "csv").out)))
    objects = lines(cli("alerts", results).out)
    assert [list(row) for row in rows] == [list(line) for line in objects]
    assert [row["message"] for row in rows] == [line["message"] for line in objects]
    assert [row["residues"].split("; ") for row in rows] == [line["residues"] for line in objects]


@pytest.mark.parametrize(
    "words",
    [
        ["--kind", "explosion"],
        ["--severity", "fatal"],
        ["--frames", "3"],
        ["--frames", "-3:"],
        ["--frames", "0:9:2"],
        ["--format", "xml"],
        ["--near-limit", "-1"],
        ["--near-limit", "nan"],
        ["--criterion", "clearance"],
    ],
    ids=" ".join,
)
def test_wrong_words_exit_with_2(cli: Callable, results: Path, words: list[str]) -> None:
    outcome = cli("alerts", results, *words)
    assert (outcome.code, outcome.out) == (Exit.USAGE, "")
    assert len(outcome.err.splitlines()) == 2


def test_wrong_input_exits_with_4_and_one_sentence(cli: Callable, results: Path, tmp_path: Path) -> None:
    outcome = cli("alerts", results, "--strand", "strand 1")
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert outcome.err == f"mdtopo: {results} has no strand 'strand 1'; its strands are 'strand 0'.\n"
    assert cli("alerts", tmp_path / "no.h5").code == Exit.BAD_INPUT
    with h5py.File(results, "a") as file:
        del file["steps/nu_ratio"]
    outcome = cli("alerts", results, "--criterion", "nu", "--near-limit", 1)
    assert (outcome.code, len(outcome.err.splitlines())) == (Exit.BAD_INPUT, 1)
    assert "no step column 'nu_ratio'" in outcome.err
    assert cli("alerts", results).code == Exit.DONE  # the stored ones are there all the same


def test_labels_cannot_steer_a_terminal() -> None:
    assert printable("A:GLY\x1b[2J1\n") == "A:GLY\\x1b[2J1\\n"
    assert printable("α'") == "α'"


def test_a_reader_that_goes_away_is_no_error(results: Path) -> None:
    import subprocess

    command = f"{sys.executable} -m mdtopo alerts {results} --format csv | head -1"
    outcome = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False)
    assert outcome.stderr == ""
    assert outcome.stdout.startswith("schema,id,kind,severity,")


def test_results_that_are_not_complete_are_called_so(cli: Callable, results: Path) -> None:
    whole = cli("alerts", results).out
    with h5py.File(results, "r+") as file:
        file.attrs["complete"] = False
    outcome = cli("alerts", results)
    assert (outcome.code, outcome.out) == (Exit.DONE, whole)
    assert outcome.err == f"mdtopo: {results} is not complete: this is about the 11 steps that it holds.\n"
