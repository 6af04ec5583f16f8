"""An ``.npz`` archive read in pieces: whole arrays where they are small, row by row where they are not."""

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from mdtopo.errors import InputError, TrajectoryError

_HEADER_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}

# all that zipfile, zlib and numpy raise on damaged bytes; RuntimeError is an encrypted member, and
# NotImplementedError a way of compression that zipfile does not know
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    RuntimeError,
    NotImplementedError,
)


@dataclass(frozen=True, slots=True)
class _Header:
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran_order: bool
    start: int

    @property
    def n_bytes(self) -> int:
        """Size of the data, bytes."""
        return prod(self.shape) * self.dtype.itemsize


class NpzArchive:
    """An open ``.npz`` archive. Nothing in it is ever unpickled.

    Several passes of `rows` may run at the same time.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    TrajectoryError
        If the file cannot be read or is no zip archive, for instance because it was truncated.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._zip = zipfile.ZipFile(path)
        except _DAMAGE as error:
            raise TrajectoryError(
                f"{path} cannot be read as an .npz archive ({error}); it may be truncated. "
                "Write it again with numpy.savez."
            ) from error

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of the arrays."""
        return tuple(name.removesuffix(".npy") for name in self._zip.namelist() if name.endswith(".npy"))

    def describe(self, key: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
        """Return shape and dtype of an array without reading it.

        Raises
        ------
        InputError
            If the array holds Python objects.
        TrajectoryError
            If the archive is damaged.
        """
        with self._member(key) as (_, header):
            return header.shape, header.dtype

    def read(self, key: str) -> NDArray[Any]:
        """Return a whole array.

        Raises
        ------
        InputError
            If the array holds Python objects.
        TrajectoryError
            If the archive is damaged.
        """
        with self._member(key) as (member, header):
            values = np.frombuffer(_read_exactly(member, header.n_bytes), header.dtype)
            _check_sum(member)
            return values.reshape(header.shape, order="F" if header.fortran_order else "C")

    def rows(self, key: str, indices: range) -> Iterator[NDArray[Any]]:
        """Yield array[i] for each index; memory does not depend on the number of rows.

        An array in Fortran order has its rows scattered over the file and is read whole.

        Raises
        ------
        TrajectoryError
            If a row cannot be read; the message names it. The check sum is compared after the last row.
        """
        with self._member(key) as (member, header):
            if header.fortran_order:
                yield from (self.read(key)[index] for index in indices)
                return
            size = header.n_bytes // header.shape[0] if header.shape[0] else 0
            for index in indices:
                yield self._row(member, header, index, size)

    def _row(self, member: IO[bytes], header: _Header, index: int, size: int) -> NDArray[Any]:
        try:
            member.seek(header.start + index * size)
            values = np.frombuffer(_read_exactly(member, size), header.dtype)
            if index == header.shape[0] - 1:
                _check_sum(member)
        except _DAMAGE as error:
            raise TrajectoryError(f"Frame {index} of {self.path} cannot be read ({error}).") from error
        return values.reshape(header.shape[1:])

    @contextmanager
    def _member(self, key: str) -> Iterator[tuple[IO[bytes], _Header]]:
        try:
            with self._zip.open(f"{key}.npy") as member:
                yield member, self._header(key, member)
        except InputError:  # is a ValueError too, and says more than what stands below
            raise
        except _DAMAGE as error:
            raise TrajectoryError(f"The array '{key}' of {self.path} cannot be read ({error}).") from error

    def _header(self, key: str, member: IO[bytes]) -> _Header:
        version = npy.read_magic(member)
        if version not in _HEADER_READERS:
            raise ValueError(f"unknown version {version} of the .npy format")
        shape, fortran_order, dtype = _HEADER_READERS[version](member)
        if dtype.hasobject:
            raise InputError(
                f"The array '{key}' of {self.path} holds Python objects, which are never loaded; "
                "save plain numbers, and names as text with numpy.array(names, dtype=str)."
            )
        header = _Header(shape, dtype, fortran_order, member.tell())
        stored = self._zip.getinfo(f"{key}.npy").file_size - header.start
        if header.n_bytes != stored or min(shape, default=0) < 0:
            raise ValueError(f"its header says {header.n_bytes} bytes, but {stored} are stored")
        return header

    def close(self) -> None:
        """Close the file. Closing twice is no error."""
        self._zip.close()


def _read_exactly(member: IO[bytes], size: int) -> bytes:
    data = member.read(size)
    if len(data) != size:
        raise EOFError(f"{size} bytes were expected and {len(data)} found")
    return data


def _check_sum(member: IO[bytes]) -> None:
    # zipfile compares the check sum only when it is asked to read past the end
    if member.read(1):
        raise ValueError("there is data after the last value")
