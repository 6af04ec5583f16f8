import errno
import io
import logging

import pytest

from mdtopo.cli.progress import ProgressDisplay, StderrHandler, progress_text
from mdtopo.pipeline import Progress


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_line_says_steps_share_rate_time_left_and_alerts() -> None:
    assert progress_text(Progress(128, 500, 2), 42.0, 3.0) == ("128/500 steps (26 %), 42 per s, 0:09 left, 2 alerts")


def test_a_stream_has_no_total() -> None:
    assert progress_text(Progress(128, None, 1), 2.0, 3723.0) == "128 steps, 2 per s, 1:02:03 so far, 1 alert"


def test_without_a_rate_no_time_is_promised() -> None:
    assert progress_text(Progress(64, 500, 0), 0.0, 30.0) == "64/500 steps (13 %), 0 alerts"


@pytest.mark.parametrize(("seconds", "lines"), [(29.9, 0), (30.0, 1), (59.9, 1), (60.0, 2)])
def test_elsewhere_than_on_a_terminal_there_is_one_line_every_half_minute(seconds: float, lines: int) -> None:
    stream, clock = io.StringIO(), Clock()
    with ProgressDisplay(stream, bar=False, clock=clock) as display:
        for tenth in range(round(seconds * 10) + 1):
            clock.now = tenth / 10
            display.show(Progress(tenth, 1000, 0))
    written = stream.getvalue()
    assert written.count("\n") == lines
    assert "\r" not in written
    assert all(line.startswith("mdtopo: ") for line in written.splitlines())


def test_the_rate_leaves_out_the_first_block_which_holds_the_compilation() -> None:
    stream, clock = io.StringIO(), Clock()
    display = ProgressDisplay(stream, bar=False, clock=clock)
    clock.now = 40.0
    display.show(Progress(10, 100, 0))
    clock.now = 70.0
    display.show(Progress(70, 100, 0))
    assert stream.getvalue().splitlines() == [
        "mdtopo: 10/100 steps (10 %), 0 alerts",
        "mdtopo: 70/100 steps (70 %), 2 per s, 0:15 left, 0 alerts",
    ]


class FullDisk(io.StringIO):
    def write(self, _: str) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("bar", [False, True])
def test_a_log_that_cannot_be_written_ends_nothing(bar: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr("sys.stderr", FullDisk())
    with ProgressDisplay(FullDisk(), bar=bar, clock=clock) as display:
        clock.now = 40.0
        display.show(Progress(50, 100, 0))
        StderrHandler(display).emit(logging.makeLogRecord({"msg": "a note"}))


def test_a_bar_is_drawn_in_place_and_taken_away() -> None:
    stream, clock = io.StringIO(), Clock()
    with ProgressDisplay(stream, bar=True, clock=clock) as display:
        clock.now = 1.0
        display.show(Progress(50, 100, 0))
    written = stream.getvalue()
    assert "\n" not in written
    assert "50/100 steps (50 %)" in written
    assert "#" in written
    assert written.endswith(" \r")
    assert len(written.split("\r")[1]) < 80


def test_a_bar_makes_way_for_a_log_line(capsys: pytest.CaptureFixture[str]) -> None:
    stream, clock = io.StringIO(), Clock()
    display = ProgressDisplay(stream, bar=True, clock=clock)
    clock.now = 1.0
    display.show(Progress(50, 100, 0))
    StderrHandler(display).emit(logging.LogRecord("mdtopo", logging.INFO, "", 0, "A note.", None, None))
    assert stream.getvalue().endswith(" \r")
    assert capsys.readouterr().err == "mdtopo: A note.\n"


def test_whether_it_is_a_terminal_is_asked_of_the_stream() -> None:
    stream, clock = io.StringIO(), Clock()
    display = ProgressDisplay(stream, clock=clock)
    clock.now = 31.0
    display.show(Progress(1, 2, 0))
    assert stream.getvalue().endswith("\n")
