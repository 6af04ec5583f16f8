"""Files that appear whole or not at all, and what to say where they cannot."""

import os
import secrets
from contextlib import suppress
from pathlib import Path

from mdtopo.errors import OutputError


def check_target(path: Path, *, overwrite: bool) -> None:
    """Refuse a file that exists and is to be kept, or a directory that is missing or closed to this user.

    Raises
    ------
    OutputError
        Says which, and the cure.
    """
    if path.is_dir():
        raise OutputError(f"{path} is a directory; give the name of a file.")
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists already; give --overwrite to replace it, or another name.")
    if not path.parent.is_dir():
        raise OutputError(f"{path} cannot be written, because the directory {path.parent} does not exist.")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OutputError(f"{path} cannot be written, because {path.parent} does not allow it to this user.")


def failed(path: Path, error: OSError) -> OutputError:
    """Return the error that says that a file cannot be written, and why."""
    return OutputError(f"{path} cannot be written ({error.strerror or error}).")


def partial_name(path: Path, folder: Path | None = None) -> Path:
    """Return a temporary name for a file: in its own directory, or in another one of the same file system."""
    # random, because in containers a killed run and its successor often have the same process id
    return (folder or path.parent) / f".{path.name}.{os.getpid()}.{secrets.token_hex(4)}.partial"


def write_text(path: Path, text: str) -> None:
    """Write a small file under a temporary name, bring it to the disk, and give it its name.

    Raises
    ------
    OutputError
        If it cannot be written; the file is then as it was.
    """
    partial = partial_name(path)
    try:
        # a file name may hold bytes that are no UTF-8
        with partial.open("w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise failed(path, error) from error
    sync_directory(path.parent)


def sync_directory(directory: Path) -> None:
    """Bring the names of a directory to the disk."""
    # some file systems cannot; the file itself is on the disk all the same
    with suppress(OSError):
        descriptor = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
