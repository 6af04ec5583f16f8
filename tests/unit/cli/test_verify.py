from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from mdtopo.cli.exits import Exit


@pytest.fixture
def results(cli: Callable, npz: Callable, tmp_path: Path) -> Path:
    """Results of the strand that trembles, made from tiny.npz beside it."""
    out = tmp_path / "run.h5"
    assert cli("monitor", npz(), "-o", out, "-q").code == Exit.DONE
    return out


def tamper(path: Path, column: str, row: int, factor: float) -> None:
    with h5py.File(path, "a") as file:
        file[f"steps/{column}"][row] *= factor


def test_results_that_agree_exit_with_0(cli: Callable, results: Path) -> None:
    outcome = cli("verify", results, "--nearest", 3, "--share", 0.5)
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    lines = outcome.out.splitlines()
    assert lines[0] == "AGREES: all of the 7 steps that were checked."
    assert lines[2] == f"  {results}: 11 steps"
    assert [line.split() for line in lines[3:]] == [
        ["checked", "steps", "agree", "differ"],
        ["crossing", "0", "0", "0"],
        ["unresolved", "0", "0", "0"],
        ["nearest", "3", "3", "0"],
        ["random", "4", "4", "0"],
        ["all", "7", "7", "0"],
    ]


def test_how_far_it_has_come_is_said_on_standard_error(
    cli: Callable, results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mdtopo.cli.progress.LINE_SECONDS", 0.0)
    said = cli("verify", results, "--nearest", 2, "--share", 0).err.splitlines()
    assert [line.split(" steps")[0] for line in said] == ["mdtopo: 1/2", "mdtopo: 2/2"]
    assert all(line.endswith(", 0 differences") for line in said)


def test_results_that_were_tampered_with_exit_with_5_and_say_what_differs(cli: Callable, results: Path) -> None:
    tamper(results, "nu", 4, 1.5)
    outcome = cli("verify", results, "--share", 1)
    assert outcome.code == Exit.DIFFERS == 5
    assert outcome.out.startswith("DIFFERS: 1 of the 11 steps that were checked.\n")
    (sentence,) = (line for line in outcome.out.splitlines() if line.startswith("  step "))
    assert sentence.startswith("  step 4: nu is 1.")
    assert sentence.endswith(" Å by the referee")
    assert outcome.err == ""


def test_a_file_that_contradicts_itself_exits_with_5(cli: Callable, results: Path) -> None:
    with h5py.File(results, "a") as file:
        file["steps/n_crossings"][2] = 1
    outcome = cli("verify", results, "--steps", "0")
    assert outcome.code == Exit.DIFFERS
    assert outcome.out.startswith("DIFFERS: the results file contradicts itself.\n")
    assert "  the file: step 2 is said to have 1 crossings, and 0 are listed\n" in outcome.out


def test_a_trajectory_that_is_gone_exits_with_4(cli: Callable, results: Path, tmp_path: Path) -> None:
    (tmp_path / "tiny.npz").rename(tmp_path / "moved.npz")
    outcome = cli("verify", results)
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert outcome.err == (
        f"mdtopo: {tmp_path / 'tiny.npz'} does not exist, and {results} was made from it; name all input files, in "
        "their order, where they are now.\n"
    )
    assert cli("verify", results, tmp_path / "moved.npz").code == Exit.DONE


def test_a_trajectory_that_has_changed_exits_with_4(cli: Callable, results: Path, npz: Callable) -> None:
    source = npz(time=None)
    outcome = cli("verify", results)
    assert outcome.code == Exit.BAD_INPUT
    assert outcome.err == f"mdtopo: {source} is not the file that {results} was made from: its size has changed.\n"


@pytest.mark.parametrize("words", [["none.h5"], ["--steps", "99"]], ids=" ".join)
def test_bad_input_exits_with_4_and_one_sentence(cli: Callable, results: Path, words: list[str]) -> None:
    outcome = cli("verify", *(words if words[0] == "none.h5" else [results, *words]))
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert len(outcome.err.splitlines()) == 1


@pytest.mark.parametrize(
    "words",
    [[], ["--share", "2"], ["--share", "x"], ["--nearest", "-1"], ["--steps", "a"], ["--steps", "3-"], ["--seed", "x"]],
    ids=" ".join,
)
def test_wrong_command_lines_exit_with_2(cli: Callable, words: list[str]) -> None:
    outcome = cli("verify", *(["run.h5", *words] if words else []))
    assert (outcome.code, outcome.out) == (Exit.USAGE, "")
    assert "error:" in outcome.err


def test_named_steps_and_no_others(cli: Callable, results: Path) -> None:
    outcome = cli("verify", results, "--steps", "3,7-9")
    assert outcome.code == Exit.DONE
    assert "  named              4       4       0\n" in outcome.out
    assert "random" not in outcome.out


def test_what_is_left_out_is_said(cli: Callable, results: Path) -> None:
    outcome = cli("verify", results, "--max-steps", 2)
    assert outcome.out.startswith("AGREES: all of the 2 steps")
    assert "  note: 9 more were left out (--max-steps)\n" in outcome.out
    assert cli("verify", results, "--max-steps", 1).out.startswith("AGREES: the one step that was checked.")
    assert cli("verify", results, "--max-steps", 0).out.startswith("AGREES: but no step was checked.")


def test_long_lists_of_differences_are_cut(cli: Callable, results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mdtopo.cli.verify.SHOWN_DIFFERENCES", 3)
    for row in range(11):
        tamper(results, "displacement_max", row, 2.0)
    out = cli("verify", results, "--share", 1).out
    assert out.count("displacement_max is ") == 3
    assert "  and 8 more differences\n" in out


def test_what_is_open_is_told(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    time = [0.0, 1, 2, 3, 3, 5, 6, 7, 8, 9, 10, 11]
    assert cli("monitor", npz(time=time), "-o", tmp_path / "run.h5", "-q").code == Exit.DONE
    outcome = cli("verify", tmp_path / "run.h5")
    assert outcome.code == Exit.DONE
    assert "  note: unresolved step 3: the time of frame 4 does not come after that of frame 3\n" in outcome.out
