from collections.abc import Callable

import numpy as np
import pytest

from mdtopo.cli.exits import Exit


def test_one_line_a_shard(cli: Callable, npz: Callable) -> None:
    outcome = cli("shards", npz(), "--steps", "4")  # 12 frames, 11 steps
    assert (outcome.code, outcome.out, outcome.err) == (Exit.DONE, "0:4\n3:8\n7:12\n", "")


def test_the_frame_range_is_that_of_the_job(cli: Callable, npz: Callable) -> None:
    outcome = cli("shards", npz(), "--steps", "2", "--frames", "1::3")  # the frames 1, 4, 7, 10
    assert outcome.out == "1:5:3\n4:11:3\n"


def test_short_trajectories_are_one_shard(cli: Callable, npz: Callable) -> None:
    assert cli("shards", npz()).out == "0:12\n"
    assert cli("shards", npz(positions=np.zeros((1, 8, 3)), time=np.zeros(1))).out == "0:1\n"


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["--frames", "20:"], Exit.BAD_INPUT, "selects none of the 12 frames"),
        (["--steps", "0"], Exit.USAGE, "'0' is not a whole number above 0"),
        (["--frames", "x"], Exit.USAGE, "is not a slice"),
    ],
)
def test_what_cannot_be_cut_is_refused(cli: Callable, npz: Callable, words: list[str], code: int, text: str) -> None:
    outcome = cli("shards", npz(), *words)
    assert outcome.code == code
    assert outcome.out == ""
    assert text in outcome.err


def test_a_missing_file_is_named(cli: Callable, tmp_path: object) -> None:
    outcome = cli("shards", f"{tmp_path}/none.npz")
    assert outcome.code == Exit.BAD_INPUT
    assert "none.npz does not exist" in outcome.err
