"""The alert stream as JSON Lines: a file, a pipe, or standard output."""

import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO, Self

from mdtopo.errors import OutputError
from mdtopo.records import Alert


class AlertFile:
    """One object per line, one write per line, flushed at once.

    Parameters
    ----------
    target : path or None
        A file, a named pipe, ``-`` for standard output, or None for nowhere.
    overwrite : bool
        Whether an existing file may be replaced; a pipe or device is written to in any case.

    Raises
    ------
    OutputError
        If the file exists already, or cannot be written.
    """

    def __init__(self, target: str | os.PathLike[str] | None, *, overwrite: bool = False) -> None:
        self._target = target
        self._overwrite = overwrite
        self._file: IO[str] | None = None

    def __enter__(self) -> Self:
        if self._target is None:
            return self
        if str(self._target) == "-":
            self._file = sys.stdout
            return self
        path = Path(self._target)
        if path.is_file() and not self._overwrite:
            raise OutputError(f"The alert file {path} exists already; choose another name, or pass --overwrite.")
        try:
            self._file = path.open("w", encoding="utf-8")
        except OSError as error:
            raise OutputError(f"The alert file {path} cannot be written: {error.strerror}.") from error
        return self

    def write(self, alert: Alert) -> None:
        """Write one line."""
        if self._file is None:
            return
        try:
            self._file.write(json.dumps(alert.to_mapping(), ensure_ascii=False, allow_nan=False) + "\n")
            self._file.flush()
        except OSError as error:
            raise OutputError(f"An alert could not be written to {self._target}: {error.strerror}.") from error

    def __exit__(self, *_: object) -> None:
        if self._file is not None and self._file is not sys.stdout:
            with suppress(OSError):  # a full disk has been reported by the write that met it
                self._file.close()
