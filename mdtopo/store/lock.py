"""One writer for one output: a lock that dies with its process."""

import errno
import fcntl
import json
import os
import socket
import struct
import time
from pathlib import Path
from typing import Self

from mdtopo.errors import OutputError
from mdtopo.store.atomic import failed

HELD: set[Path] = set()
"""Locks of this process: to the system a process never stands in its own way."""

SETTLE_SECONDS = 0.1
"""Where there are no locks, how far apart two processes must look and write at the same moment to go unnoticed."""

FLOCK = "hhqqi4x"
"""``struct flock`` of Linux on machines of 64 bits: type, whence, start, length, process."""

UNSUPPORTED = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EINVAL)
"""What file systems answer that have no locks."""


class OutputLock:
    """Held from its making until `release`, or until the process ends.

    The system's record lock, which shared file systems know too, decides; the file says who holds it. Where there are
    no locks, only a writer on the same machine that is still alive is noticed.

    Parameters
    ----------
    path : Path
        The lock file; made where it is missing.
    output : Path
        What is locked, for the message.

    Raises
    ------
    OutputError
        If somebody else holds it: says who.
    """

    def __init__(self, path: Path, output: Path) -> None:
        self._path = path.resolve()
        if self._path in HELD:
            raise OutputError(f"{output} is being written by another run of this process; wait for it.")
        self._file, has_lock = _locked(self._path, output)
        while not _is_named(self._file, self._path):  # its holder removed it between our opening and our locking
            os.close(self._file)
            self._file, has_lock = _locked(self._path, output)
        os.ftruncate(self._file, 0)
        text = json.dumps({"host": socket.gethostname(), "pid": os.getpid()})
        os.pwrite(self._file, text.encode(), 0)
        if not has_lock:
            _refuse_overwritten(self._file, output)
        HELD.add(self._path)

    def release(self) -> None:
        """Let go of it, and remove the file. A second time it does nothing."""
        if self._path in HELD:
            HELD.discard(self._path)
            self._path.unlink(missing_ok=True)
            os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def is_held(path: Path) -> bool:
    """Return whether somebody holds a lock; it is asked for, not tried, so that nobody is refused because of it.

    Where there are no locks, a holder on another machine counts as one that lives.
    """
    if path.resolve() in HELD:  # and to close the file once would let go of the lock
        return True
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        asked = struct.pack(FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
        found, *_ = struct.unpack(FLOCK, fcntl.fcntl(descriptor, fcntl.F_GETLK, asked))
        return bool(found != fcntl.F_UNLCK)
    except OSError:
        holder = _holder(descriptor)
        return _lives_here(holder) or holder[0] not in ("", socket.gethostname())
    finally:
        os.close(descriptor)


def _locked(path: Path, output: Path) -> tuple[int, bool]:
    """Return the open file, and whether it is locked; without locks, nobody lives who has written into it."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise failed(path, error) from error
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        holder = _holder(descriptor)
        if error.errno not in UNSUPPORTED or _lives_here(holder):
            os.close(descriptor)
            raise _refusal(output, holder) from error
        return descriptor, False
    return descriptor, True


def _refuse_overwritten(descriptor: int, output: Path) -> None:
    """Without locks, leave the output to another one that has begun at the same moment: the last name written stays."""
    time.sleep(SETTLE_SECONDS)
    holder = _holder(descriptor)
    if _lives_here(holder):
        os.close(descriptor)
        raise _refusal(output, holder)


def _is_named(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _holder(descriptor: int) -> tuple[str, int]:
    try:
        found = json.loads(os.pread(descriptor, 4096, 0))
        return str(found["host"]), int(found["pid"])
    except (ValueError, KeyError, TypeError, OSError):
        return "", 0


def _lives_here(holder: tuple[str, int]) -> bool:
    host, pid = holder
    if host != socket.gethostname() or pid in (0, os.getpid()):
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _refusal(output: Path, holder: tuple[str, int]) -> OutputError:
    host, pid = holder
    who = f"process {pid} on {host}" if pid else "another process"
    return OutputError(f"{output} is being written by {who}; wait for it, stop it, or choose another output.")
