"""Where results come from: versions, command, input files, host and time."""

import hashlib
import os
import platform
import socket
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from mdtopo.errors import InputError

PACKAGES = ("mdtopo", "numpy", "numba", "MDAnalysis", "h5py")
MEBIBYTE = 2**20


@dataclass(frozen=True, slots=True)
class InputFile:
    """Enough of an input file to notice that it was changed.

    Attributes
    ----------
    path : str
        Absolute path.
    size : int
        Bytes.
    modified : str
        Time of the last change, UTC, ISO 8601.
    sha256_of_size_and_first_and_last_mebibyte : str
        Hash of the size in decimal digits, the first and the last MiB: a trajectory of a terabyte is not read
        for it, so a change in its middle that keeps the size shows in `modified` alone.
    """

    path: str
    size: int
    modified: str
    sha256_of_size_and_first_and_last_mebibyte: str


@dataclass(frozen=True, slots=True)
class Provenance:
    """How a results file came to be.

    Attributes
    ----------
    versions : mapping of str to str or None
        Of Python and the packages that matter; None for one that is not installed.
    argv : tuple of str
        The command.
    inputs : tuple of InputFile
        The input files; empty where an object in memory was passed.
    host : str
        Name of the machine.
    threads : int
        Number of worker threads.
    started, ended : str or None
        UTC, ISO 8601; `ended` is None until the run is over.
    notes : tuple of str
        What the reader said of the input: what was selected, left out or assumed, and files that hold less than they
        declare.
    """

    versions: Mapping[str, str | None]
    argv: tuple[str, ...]
    inputs: tuple[InputFile, ...]
    host: str
    threads: int
    started: str
    ended: str | None = None
    notes: tuple[str, ...] = ()

    def ended_now(self) -> "Provenance":
        """Return the same with the present time as its end."""
        return replace(self, ended=_utc(datetime.now(UTC)))

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values, ready for JSON."""
        return asdict(self)


def collect_provenance(paths: Sequence[Path], *, argv: Sequence[str], threads: int = 1) -> Provenance:
    """Return the provenance of a run that starts now.

    Raises
    ------
    InputError
        If one of the files cannot be read.
    """
    return Provenance(
        versions={"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
        argv=tuple(argv),
        inputs=tuple(fingerprint(path) for path in paths),
        host=socket.gethostname(),
        threads=threads,
        started=_utc(datetime.now(UTC)),
    )


def fingerprint(path: Path) -> InputFile:
    """Return size, time of the last change and hash of a file; at most 2 MiB of it are read.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            digest = hashlib.sha256(str(status.st_size).encode())
            digest.update(file.read(MEBIBYTE))
            file.seek(max(0, status.st_size - MEBIBYTE))
            digest.update(file.read(MEBIBYTE))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}).") from error
    modified = datetime.fromtimestamp(status.st_mtime, UTC)
    return InputFile(str(path.absolute()), status.st_size, _utc(modified), digest.hexdigest())


@cache
def _version(package: str) -> str | None:
    # from the metadata: importing MDAnalysis takes seconds; once, because a process keeps what it has imported
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _utc(moment: datetime) -> str:
    return moment.isoformat(timespec="milliseconds")
