"""When a run is to put its work down before its end: a signal has come, or its time is up."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from mdtopo.errors import OptionError

SIGNALS = ("SIGTERM", "SIGINT", "SIGUSR1")
"""What batch systems send ahead of the end, and the keyboard."""


class StopRequest:
    """Says whether, and why, a run is to stop at the next block.

    Parameters
    ----------
    max_hours : float, optional
        How long it may go on from now; by default for ever.
    clock : callable
        Seconds, for tests.

    Raises
    ------
    OptionError
        If `max_hours` is below 0, or no number.
    """

    def __init__(self, max_hours: float | None = None, *, clock: Callable[[], float] = time.monotonic) -> None:
        if max_hours is not None and not max_hours >= 0.0:
            raise OptionError(f"max_hours is {max_hours:g}; it must be 0 or more.")
        self._clock = clock
        self._hours = max_hours
        self._end = None if max_hours is None else clock() + 3600.0 * max_hours
        self.signal = ""

    @property
    def reason(self) -> str:
        """Why to stop, in words; empty while there is no reason."""
        if self.signal:
            return f"{self.signal} was received"
        if self._end is not None and self._clock() >= self._end:
            return f"the {self._hours:g} hours of --max-hours are over"
        return ""

    def on_signal(self, number: int, _: FrameType | None) -> None:
        """Note a signal; a second one from the keyboard ends the process at once."""
        if number == signal.SIGINT and self.signal:
            with suppress(OSError):  # a log on a full disk
                sys.stderr.write("mdtopo: interrupted again; what was finished is kept.\n")
                sys.stderr.flush()
            os._exit(130)  # kernels in other threads cannot be interrupted, and finished parts are safe
        self.signal = signal.Signals(number).name


@contextmanager
def stopping_on_signals(request: StopRequest) -> Iterator[StopRequest]:
    """Let the signals set the request while the context lasts. For the main thread."""
    before: dict[int, Any] = {}
    for name in SIGNALS:
        if hasattr(signal, name):
            number = getattr(signal, name)
            before[number] = signal.signal(number, request.on_signal)
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
