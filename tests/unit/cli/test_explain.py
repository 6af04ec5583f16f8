from collections.abc import Callable
from pathlib import Path

import pytest

from mdtopo.cli.exits import Exit


@pytest.fixture
def results(cli: Callable, npz: Callable, tmp_path: Path) -> Path:
    out = tmp_path / "run.h5"
    assert cli("monitor", npz(), "-o", out, "--frames", "::2", "-q").code == Exit.DONE
    return out


def test_the_story_is_printed_by_step_and_by_frame(cli: Callable, results: Path) -> None:
    outcome = cli("explain", results, 3)
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    assert outcome.out.startswith("Verdict\n  Step 3 joins the frames 6 and 8, 6 to 8 ps.\n  CERTIFIED: ")
    assert max(map(len, outcome.out.splitlines())) <= 100
    assert cli("explain", results, "--frame", 6).out == outcome.out


@pytest.mark.parametrize("words", [[], ["3", "--frame", "6"], ["-1"], ["three"]], ids=" ".join)
def test_wrong_words_exit_with_2(cli: Callable, results: Path, words: list[str]) -> None:
    outcome = cli("explain", results, *words)
    assert (outcome.code, outcome.out, len(outcome.err.splitlines())) == (Exit.USAGE, "", 2)


def test_a_step_or_frame_that_is_not_there_exits_with_4(cli: Callable, results: Path) -> None:
    outcome = cli("explain", results, 5)
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert outcome.err == "mdtopo: The results have no step 5; they hold the steps 0 to 4.\n"
    outcome = cli("explain", results, "--frame", 7)
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert outcome.err == "mdtopo: No step begins or ends at frame 7; the analysed frames lie from 0 to 10.\n"
