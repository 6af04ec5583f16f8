"""How far a run has come: a bar on a terminal, a plain line every half minute on anything else."""

import logging
import shutil
import sys
import time
from collections.abc import Callable
from typing import IO, TYPE_CHECKING

from mdtopo.cli.exits import say, write_log

if TYPE_CHECKING:
    from mdtopo.pipeline import Progress

LINE_SECONDS = 30.0
"""Time between two plain lines: a batch job's log stays readable."""

BAR_SECONDS = 0.1
"""Time between two drawings of the bar."""


class ProgressDisplay:
    """Says on a stream how far a run has come; a context manager that leaves no half line behind.

    Parameters
    ----------
    stream : text stream
        Standard error.
    bar : bool
        Whether to draw a bar in place; else whole lines are written.
    clock : callable
        Seconds, for tests.
    """

    def __init__(
        self, stream: IO[str] | None = None, *, bar: bool | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._stream = stream or sys.stderr
        self._bar = self._stream.isatty() if bar is None else bar
        self._clock = clock
        self._start = self._said = clock()
        self._first: tuple[float, int] | None = None
        self._width = 0

    def __enter__(self) -> "ProgressDisplay":
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def show(self, progress: "Progress") -> None:
        """Say how far the run has come, unless that was said a moment ago."""
        now = self._clock()
        if self._first is None:
            self._first = (now, progress.steps)  # the first block's time holds the compilation too
        if now - self._said < (BAR_SECONDS if self._bar else LINE_SECONDS):
            return
        self._said = now
        text = progress_text(progress, self._rate(now, progress.steps), now - self._start)
        if self._bar:
            self._draw(text, progress)
        else:
            write_log(self._stream, f"mdtopo: {text}\n")

    def clear(self) -> None:
        """Take the bar away."""
        if self._width:
            write_log(self._stream, "\r" + " " * self._width + "\r")
            self._width = 0

    def _rate(self, now: float, steps: int) -> float:
        """Return steps per second since the first block; 0 while there is only one."""
        since, done = self._first or (now, 0)
        return (steps - done) / (now - since) if now > since else 0.0

    def _draw(self, text: str, progress: "Progress") -> None:
        columns = shutil.get_terminal_size().columns - 1
        room = min(30, columns - len(text) - 4)
        if progress.total and room >= 5:
            filled = round(room * progress.steps / progress.total)
            text = f"[{'#' * filled}{'.' * (room - filled)}] {text}"
        text = text[:columns]
        write_log(self._stream, "\r" + text.ljust(self._width))
        self._width = len(text)


def progress_text(progress: "Progress", rate: float, elapsed: float) -> str:
    """Return how far a run has come in one line, such as ``128/500 steps (26 %), 42 per s, 0:09 left, 2 alerts``."""
    speed = f"{rate:.3g} per s, " if rate > 0.0 else ""
    alerts = f"{progress.alerts} {progress.noun}{'' if progress.alerts == 1 else 's'}"
    if progress.total is None:
        return f"{progress.steps} steps, {speed}{_clock_text(elapsed)} so far, {alerts}"
    left = f"{_clock_text((progress.total - progress.steps) / rate)} left, " if rate > 0.0 else ""
    share = 100.0 * progress.steps / max(progress.total, 1)
    return f"{progress.steps}/{progress.total} steps ({share:.0f} %), {speed}{left}{alerts}"


def _clock_text(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class StderrHandler(logging.Handler):
    """Writes log records of mdtopo to standard error, one line each; a progress bar makes way for them."""

    def __init__(self, display: ProgressDisplay | None = None) -> None:
        super().__init__()
        self._display = display

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        if self._display is not None:
            self._display.clear()
        say(record.getMessage())
