"""The alert stream as JSON Lines: a file, a pipe, or standard output."""

import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO, Self

from mdtopo.errors import OutputError
from mdtopo.records import Alert
from mdtopo.store.atomic import check_target


class AlertFile:
    """One object per line, one write per line, flushed at once.

    Parameters
    ----------
    target : path or None
        A file, a named pipe, ``-`` for standard output, or None for nowhere.
    overwrite : bool
        Whether an existing file may be replaced; a pipe or device is written to in any case.
    resume : bool
        Whether an existing file is the beginning of this stream, from a run that was stopped. Its lines are not written
        again: each is compared with the alert that belongs there, a line that was torn is written anew, and lines
        behind the last alert are removed. So it ends as if the run had never been stopped.

    Raises
    ------
    OutputError
        If the file exists already, cannot be written, or does not hold the beginning of this stream.
    """

    def __init__(self, target: str | os.PathLike[str] | None, *, overwrite: bool = False, resume: bool = False) -> None:
        self._target = target
        self._overwrite = overwrite
        self._resume = resume
        self._file: IO[bytes] | None = None
        self._is_regular = False
        self._reading = False

    def check(self) -> None:
        """Refuse a file that could not be written, before anything is done for it.

        Raises
        ------
        OutputError
            Says why.
        """
        if self._target is None or str(self._target) == "-":
            return
        path = Path(self._target)
        if path.is_dir() or not path.exists():
            check_target(path, overwrite=True)
        elif not os.access(path, os.W_OK):
            raise OutputError(f"The alert file {path} cannot be written: this user may not.")

    def __enter__(self) -> Self:
        if self._target is None:
            return self
        if str(self._target) == "-":
            self._file = sys.stdout.buffer
            return self
        path = Path(self._target)
        exists = path.is_file()
        self._is_regular = exists or not path.exists()
        self._reading = exists and self._resume
        if exists and not (self._overwrite or self._resume):
            raise OutputError(f"The alert file {path} exists already; choose another name, or pass --overwrite.")
        try:
            self._file = path.open("r+b" if self._reading else "wb")
        except OSError as error:
            raise OutputError(f"The alert file {path} cannot be written: {error.strerror}.") from error
        return self

    def write(self, alert: Alert, *, again: bool = False) -> None:
        """Write one line; `again` where an earlier run has raised the alert, so that only a file may still lack it."""
        if self._file is None or (again and not self._is_regular):
            return
        line = (json.dumps(alert.to_mapping(), ensure_ascii=False, allow_nan=False) + "\n").encode(
            "utf-8", "backslashreplace"
        )
        if self._reading and self._holds(line):
            return
        try:
            self._file.write(line)
            self._file.flush()
        except OSError as error:
            raise OutputError(f"An alert could not be written to {self._target}: {error.strerror}.") from error

    def _holds(self, line: bytes) -> bool:
        """Return whether the next line of the file is this one; else the file is cut before it."""
        assert self._file is not None
        start = self._file.tell()
        found = self._file.readline()
        if found == line:
            return True
        if found.endswith(b"\n") and not self._overwrite:
            raise OutputError(
                f"The alert file {self._target} does not hold the alerts of this run; remove it, or choose another "
                "name."
            )
        self._cut(start)
        return False

    def _cut(self, size: int) -> None:
        assert self._file is not None
        self._file.seek(size)
        self._file.truncate()
        self._reading = False

    def finish(self) -> None:
        """Remove what an earlier run left behind the last alert: a line that was torn."""
        if self._reading and self._file is not None:
            self._cut(self._file.tell())

    def __exit__(self, *_: object) -> None:
        if self._file is not None and str(self._target) != "-":
            with suppress(OSError):  # a full disk has been reported by the write that met it
                self._file.close()
