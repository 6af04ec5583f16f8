"""Commands on the output of a run that has not ended: the answer so far, said to be one, or one clear sentence."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mdtopo import MonitorConfig, monitor
from mdtopo.cli.exits import Exit
from mdtopo.pipeline import PartLength, StopRequest


class Stop(StopRequest):
    """Stops a run after a few blocks."""

    left = 3

    @property
    def reason(self) -> str:
        self.left -= 1
        return "" if self.left > 0 else "enough"


@pytest.fixture
def half(npz: Callable, breaking: np.ndarray, tmp_path: Path) -> Path:
    """A run of which 8 of 11 steps are in finished parts, and its output, which is not there yet."""
    out = tmp_path / "half.h5"
    config = MonitorConfig(block_steps=2, near_limit=0.01)
    parts = PartLength(steps=2)
    assert monitor(npz(positions=breaking), out=out, config=config, threads=1, parts=parts, stop=Stop()).checkpoint
    assert not out.exists()
    return out


def n_steps(half: Path) -> int:
    from mdtopo.store import read_running

    return len(read_running(half).stored)


SAID = "mdtopo: in progress: the run of {} has not ended; this is about the {} steps of its finished parts.\n"


def test_alerts_so_far(cli: Callable, half: Path) -> None:
    outcome = cli("alerts", half)
    assert (outcome.code, outcome.err) == (Exit.DONE, SAID.format(half, n_steps(half)))
    drawn = cli("alerts", half, "--near-limit", "0.02", "--kind", "near-limit")
    assert (drawn.code, drawn.err) == (Exit.DONE, outcome.err)
    assert '"limit": 0.02' in drawn.out


def test_a_step_of_a_finished_part_is_explained_and_a_later_one_is_not_known(cli: Callable, half: Path) -> None:
    outcome = cli("explain", half, 3)
    assert (outcome.code, outcome.err) == (Exit.DONE, SAID.format(half, n_steps(half)))
    assert outcome.out.startswith("Verdict\n  Step 3 joins the frames 3 and 4, 3 to 4 ps.")
    assert cli("explain", half, "--frame", 3).out == outcome.out
    outcome = cli("explain", half, 10)
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    last = n_steps(half) - 1
    assert outcome.err.endswith(f"mdtopo: The results have no step 10; they hold the steps 0 to {last}.\n")


def test_finished_parts_are_verified(cli: Callable, half: Path) -> None:
    outcome = cli("verify", half, "--share", "1")
    assert outcome.code == Exit.DONE
    assert outcome.out.startswith("AGREES: ")
    assert f"{half}: {n_steps(half)} steps" in outcome.out
    assert "note: in progress: the run has not ended, and only its finished parts were looked at" in outcome.out


def test_finished_parts_are_exported(cli: Callable, half: Path, tmp_path: Path) -> None:
    out = tmp_path / "half.xyz"
    outcome = cli("export", half, "--what", "polyline", "--format", "xyz", "-o", out)
    assert (outcome.code, outcome.err) == (Exit.DONE, SAID.format(half, n_steps(half)))
    assert f"{n_steps(half) + 1} times" in outcome.out


def test_a_trajectory_that_grows_is_not_read_again(cli: Callable, half: Path, tmp_path: Path) -> None:
    source = tmp_path / "tiny.npz"
    with source.open("ab") as file:
        file.write(b"more")
    for words in (["verify", half], ["export", half, "--what", "polyline", "--format", "xyz", "-o", tmp_path / "x"]):
        outcome = cli(*words)
        assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
        assert outcome.err.endswith("A trajectory that still grows can be read again when its run has ended.\n")


@pytest.mark.parametrize("command", ["alerts", "explain", "verify", "export"])
def test_a_run_without_a_finished_part_gives_one_sentence(cli: Callable, tmp_path: Path, command: str) -> None:
    out = tmp_path / "new.h5"
    os.mkdir(f"{out}.parts")
    more = {"explain": [0], "export": ["--what", "polyline", "--format", "xyz", "-o", tmp_path / "x"]}
    outcome = cli(command, out, *more.get(command, []))
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert outcome.err == f"mdtopo: {out} has no finished part yet; wait for the run, or start it.\n"
