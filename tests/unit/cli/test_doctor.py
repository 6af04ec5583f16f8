import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mdtopo import Strands
from mdtopo.cli.diagnosis import Box, Sample, advice, diagnose, strand_groups
from mdtopo.cli.exits import Exit
from mdtopo.errors import TrajectoryError
from mdtopo.readers import Reader, ReaderRequest, Source
from mdtopo.readers.arrays import ArraysReader
from mdtopo.records import MonitorConfig

GOOD = Sample(50, {"BALL": 50}, 0, 0, 0, 0, 5, (0.2, 0.3), (0.1, 0.2), 5.0)


def findings(outcome: object) -> dict:
    assert outcome.code == Exit.DONE, outcome
    return json.loads(outcome.out)


def test_json_and_text_say_the_same(cli: Callable, npz: Callable) -> None:
    path = npz(cell=np.diag([20.0, 30.0, 40.0]))
    found, text = findings(cli("doctor", path, "--json")), cli("doctor", path).out
    assert (found["reader"], found["n_vertices"], found["n_frames"]) == ("arrays", 8, 12)
    assert found["box"] == {"lengths": [20.0, 30.0, 40.0], "angles": [90.0, 90.0, 90.0]}
    assert (found["time_first"], found["time_last"], found["spacing_least"]) == (0.0, 11.0, 1.0)
    assert found["strands"] == [
        {"count": 1, "n_vertices": 8, "is_closed": False, "names": ["strand 0"] * 2, "labels": ["0", "7"]}
    ]
    assert found["sample"]["rungs"]["BALL"] == found["sample"]["steps"] == 11
    assert (found["gaps"], found["problems"]) == ([], [])
    for line in (
        "Strands: 8 vertices in 1 strand",
        "  strand 0  8 vertices, open, 0 to 7",
        "  frames       12",
        "  time         0 to 11 ps, 1 ps between analysed frames",
        "  box          periodic, 20 x 30 x 40 Å, angles 90, 90, 90 degrees (first frame)",
        "    100.0 %  no vertex moved half the least distance (the paper's ball)",
    ):
        assert f"\n{line}\n" in text
    assert "The save interval is good in this sample: each of the first 11 steps" in text
    assert "Problems" not in text


def test_the_frame_range_is_that_of_the_job(cli: Callable, npz: Callable) -> None:
    found = findings(cli("doctor", npz(), "--frames", "2::3", "--json"))
    assert found["sample"]["steps"] == 3
    assert found["spacing_least"] == 3.0
    assert found["edge_frames"] == 10  # references come from the trajectory's first frames whichever are analysed


@pytest.mark.parametrize("words", [["--frames", ":1"], ["--frames", "20:"]])
def test_without_a_step_there_is_no_advice(cli: Callable, npz: Callable, words: list[str]) -> None:
    outcome = cli("doctor", npz(), *words)
    assert outcome.code == Exit.DONE
    assert "There is no step to judge by" in outcome.out
    assert "The first" not in outcome.out


def test_without_times_and_box_it_says_so(cli: Callable, npz: Callable) -> None:
    text = cli("doctor", npz(time=None)).out
    assert "  time         not known\n" in text
    assert "  box          none: not periodic\n" in text


def test_long_times_are_written_out(cli: Callable, npz: Callable) -> None:
    text = cli("doctor", npz(time=20000.0 * np.arange(12))).out
    assert "  time         0 to 220000 ps, 20000 ps between analysed frames\n" in text


def test_unusable_frames_are_counted(cli: Callable, npz: Callable) -> None:
    with np.load(npz()) as stored:
        x = stored["positions"].copy()
    x[4] = np.inf
    text = cli("doctor", npz(positions=x)).out
    assert "     18.2 %  not measured: unusable data\n" in text


def test_what_a_run_would_stop_at_is_a_problem(cli: Callable, npz: Callable) -> None:
    ring = np.stack([np.arange(8) * 1.25, np.zeros(8), np.zeros(8)], axis=1)  # closes through a box of 10 Å
    path = npz(positions=np.stack([ring, ring]), closed=np.array([True]), time=None, cell=10.0 * np.eye(3))
    outcome = cli("doctor", path)
    assert outcome.code == Exit.BAD_INPUT
    assert "Problems: 'mdtopo monitor' would stop here" in outcome.out
    assert "winding" in outcome.out


def test_bad_input_is_one_sentence(cli: Callable, tmp_path: Path) -> None:
    outcome = cli("doctor", tmp_path / "none.npz")
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert outcome.err == f"mdtopo: {tmp_path / 'none.npz'} does not exist.\n"


def test_a_configuration_file_holds_here_too(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    path = tmp_path / "mdtopo.toml"
    path.write_text("frames = ':5'\nreference-frames = 2\n")
    found = findings(cli("doctor", npz(), "--config", path, "--json"))
    assert (found["sample"]["steps"], found["edge_frames"]) == (4, 2)


class Broken(ArraysReader):
    """Frame 3 cannot be read."""

    def frames(self, start: int | None = None, stop: int | None = None, step: int | None = None) -> object:
        for frame in super().frames(start, stop, step):
            if frame.index == 3:
                raise TrajectoryError("Frame 3 cannot be read.")
            yield frame


class Stream(ArraysReader):
    """Frames that can be read once."""

    n_frames = None  # type: ignore[assignment]
    readings = 0

    def frames(self, start: int | None = None, stop: int | None = None, step: int | None = None) -> object:
        Stream.readings += 1
        assert Stream.readings == 1
        return opened(ArraysReader).frames(start, stop, step)


def opened(kind: type[ArraysReader]) -> Reader:
    x = np.arange(8.0)[:, np.newaxis] * np.ones(3) + np.zeros((12, 1, 1))
    return kind.open(Source(object=x), ReaderRequest(strands=Strands.from_lengths([8])))


def test_a_frame_that_cannot_be_read_is_a_problem_and_the_others_are_measured() -> None:
    found = diagnose(opened(Broken), "x", slice(None), MonitorConfig())
    assert found.problems == ("Frame 3 cannot be read.",)
    assert found.sample is not None
    assert found.sample.steps == 2


def test_a_stream_is_read_once() -> None:
    found = diagnose(opened(Stream), "x", slice(None), MonitorConfig())
    assert found.n_frames is None
    assert found.sample is not None
    assert (found.sample.steps, found.edge_frames, found.problems) == (11, 10, ())


def test_neighbouring_strands_that_are_alike_are_one_line() -> None:
    strands = Strands.from_lengths([4, 4, 5, 4], closed=[True, True, True, False])
    assert [(g.count, g.n_vertices, g.is_closed, g.names, g.labels) for g in strand_groups(strands)] == [
        (2, 4, True, ("strand 0", "strand 1"), ("0", "7")),
        (1, 5, True, ("strand 2", "strand 2"), ("8", "12")),
        (1, 4, False, ("strand 3", "strand 3"), ("13", "16")),
    ]


def test_a_box_has_lengths_and_angles() -> None:
    box = Box.of(np.array([[2.0, 0.0, 0.0], [1.0, math.sqrt(3.0), 0.0], [0.0, 0.0, 5.0]]))
    assert box.lengths == pytest.approx((2.0, 2.0, 5.0))
    assert box.angles == pytest.approx((90.0, 90.0, 60.0))


@pytest.mark.parametrize(
    ("sample", "words"),
    [
        (None, "There is no step"),
        (replace(GOOD, pair_ratio=(math.nan, math.nan)), "No step could be measured"),
        (
            GOOD,
            "sample: each of these steps that could be measured is proved; about 4 times as long would still do.",
        ),
        (
            replace(GOOD, pair_ratio=(0.3, 0.5)),
            "is good in this sample: each of these steps that could be measured is proved.",
        ),
        (replace(GOOD, pair_ratio=(0.3, 0.79)), "is good"),
        (replace(GOOD, pair_ratio=(0.3, 0.8)), "just short enough: the greatest pair ratio is 0.80"),
        (
            replace(GOOD, unresolved=3, bad_data=1, pair_ratio=(0.9, 3.0)),
            "2 of 50 steps are not decided; save about 4 times as often.",
        ),
        (replace(GOOD, unresolved=3, bad_data=3), "is good"),
        (replace(GOOD, crossed=20), "20 of 50 steps are crossed (proven or resolved). That is not for want of frames"),
        (replace(GOOD, crossed=1, unresolved=2), "says where and when. 2 of 50 steps are not decided."),
        (
            replace(GOOD, crossed=1, undersampled=1, pair_ratio=(0.9, 3.0)),
            "1 of 50 steps is crossed, where a passage cannot be told from a detour; save about 4 times as often.",
        ),
        (replace(GOOD, places=1), "each of the first 50 steps"),
    ],
)
def test_advice(sample: Sample | None, words: str) -> None:
    assert words in advice(sample)


def test_a_long_run_is_sampled_from_its_beginning_to_its_end() -> None:
    """Only the last steps pass: the beginning alone would call the spacing good."""
    strands = Strands.from_lengths([2, 2])
    bars = np.array([[-5.0, 0, 0], [5, 0, 0], [0, -5, 3], [0, 5, 3]])
    x = np.repeat(bars[np.newaxis], 400, axis=0)
    x[-5:, 2:, 2] = -3.0
    with ArraysReader.open(Source(object=x), ReaderRequest(strands=strands)) as reader:
        found = diagnose(reader, "bars", slice(None), MonitorConfig())
    assert found.sample is not None
    assert (found.sample.steps, found.sample.places) == (50, 5)
    assert (found.sample.crossed, found.sample.unresolved, found.sample.rungs["BALL"]) == (1, 0, 49)
    assert "1 of 50 steps is crossed" in found.advice
