"""The frames of a trajectory that another program is still writing, each as soon as it is whole."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from mdtopo.errors import MissingFileError, TrajectoryError
from mdtopo.readers import Reader
from mdtopo.records import Frame

POLL_SECONDS = 1.0
"""Time between two looks at the files."""

BUSY_SHARE = 4.0
"""A look that took long is followed by a pause of so many times its length: looking takes a fifth of a core at most."""

TAIL_BYTES = 4096
"""How much of a file's end is looked at to tell text from binary data."""

_State: TypeAlias = tuple[tuple[int, int, int], ...]


@dataclass(slots=True)
class GrowingTrajectory:
    """Looks at a trajectory again and again, and yields its new frames.

    The reader is opened anew whenever the files have changed, because most readers count frames once. A frame is
    yielded when another one follows it, or when nothing has changed between two looks; the last frame of a text file
    must end in a line feed besides, because half a number is a number too. A frame that cannot be read is taken for
    half-written and is tried again when the file has changed.

    Attributes
    ----------
    open_reader : callable
        Opens the input.
    paths : sequence of Path
        Its files; the last one grows, and need not exist yet.
    poll : float
        Seconds between two looks.
    idle_timeout : float or None
        Seconds without a change after which the trajectory counts as finished; None to wait for ever.
    is_stopped : callable
        Says whether to end.
    failure : str
        Why the frame after the last one yielded could not be read, in words; empty where all is well.
    """

    open_reader: Callable[[], Reader]
    paths: Sequence[Path]
    poll: float = POLL_SECONDS
    idle_timeout: float | None = None
    is_stopped: Callable[[], bool] = lambda: False
    failure: str = ""
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    _next: int = field(default=0, init=False)

    def batches(self, most: int) -> Iterator[list[Frame]]:
        """Yield lists of 1 to `most` consecutive frames, until the files stand still for too long or a stop is asked.

        Raises
        ------
        InputError
            If the input can never be read: a missing topology, a selection without atoms.
        TrajectoryError
            If the trajectory has become shorter.
        """
        before: _State | None = None
        done: tuple[_State, bool] | None = None
        changed = self.clock()
        while not self.is_stopped():
            started, state = self.clock(), self._state()
            is_settled = state == before
            if not is_settled:
                before, changed = state, started
            if (state, is_settled) != done:
                for batch in self._new_frames(state, is_settled, most):
                    changed = self.clock()
                    yield batch
                done = (state, is_settled)
            if self.idle_timeout is not None and self.clock() - changed >= self.idle_timeout:
                return
            self._pause(max(self.poll, BUSY_SHARE * (self.clock() - started)))

    def _pause(self, seconds: float) -> None:
        end = self.clock() + seconds
        while not self.is_stopped() and (left := end - self.clock()) > 0.0:
            self.sleep(min(left, self.poll))

    def _state(self) -> _State:
        for path in self.paths[:-1]:
            if not path.exists():
                raise MissingFileError(f"{path} does not exist.")
        return tuple(_file_state(path) for path in self.paths)

    def _new_frames(self, state: _State, is_settled: bool, most: int) -> Iterator[list[Frame]]:
        self.failure = ""
        if state[-1] == (-1, 0, 0):
            self.failure = f"{self.paths[-1]} does not exist."
            return
        try:
            reader = self.open_reader()
        except TrajectoryError as error:  # empty, or its first frame is half-written
            self.failure = str(error)
            return
        with reader:
            count = self._count(reader, is_settled and self._state() == state)
            while self._next < count and not self.failure and not self.is_stopped():
                batch = self._read(reader, min(count, self._next + most))
                self._next += len(batch)
                if batch:
                    yield batch

    def _count(self, reader: Reader, is_settled: bool) -> int:
        """Return how many frames can be taken."""
        if reader.n_frames is None:
            raise TrajectoryError(f"{self.paths[-1]} is a stream and cannot be looked at again; use 'mdtopo monitor'.")
        if reader.n_frames < self._next:
            raise TrajectoryError(
                f"{self.paths[-1]} holds {reader.n_frames} frames and held {self._next} before: another trajectory "
                "has taken its place. Start the watch again."
            )
        if is_settled and not _ends_within_line(self.paths[-1]):
            return reader.n_frames
        if is_settled and reader.n_frames == self._next + 1:
            self.failure = f"The last line of {self.paths[-1]} has no end."
        return reader.n_frames - 1

    def _read(self, reader: Reader, stop: int) -> list[Frame]:
        batch: list[Frame] = []
        try:
            batch.extend(reader.frames(self._next, stop))
        except TrajectoryError as error:
            self.failure = str(error)
        return batch


def _file_state(path: Path) -> tuple[int, int, int]:
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return (-1, 0, 0)
    return (found.st_size, found.st_mtime_ns, found.st_ino)


def _ends_within_line(path: Path) -> bool:
    """Return whether a file is text whose last line has no end."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - TAIL_BYTES, 0))
        tail = file.read()
    return b"\0" not in tail and tail.isascii() and not tail.endswith(b"\n")
