"""The neutral input of other codes: ``.npz`` files, and NumPy arrays in memory."""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import InputError, OptionError, StrandError, TrajectoryError, UnknownFormatError
from mdtopo.readers.base import Reader, ReaderRequest, Source
from mdtopo.readers.npz import NpzArchive
from mdtopo.records import Frame, Strands
from mdtopo.typing import Cell, PointSeries, Times

STRAND_KEYS = ("offsets", "closed")
KEYS = ("positions", *STRAND_KEYS, "time", "cell", "names")


class _Positions(Protocol):
    """Positions of all frames, wherever they lie; `rows` yields them one frame at a time."""

    title: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def rows(self, indices: range) -> Iterator[NDArray[Any]]:
        """Yield some of the rows, one at a time."""

    def close(self) -> None:
        """Let go of what is open."""


class _InMemory:
    title = "the array"

    def __init__(self, array: NDArray[Any]) -> None:
        self.shape, self.dtype = array.shape, array.dtype
        self._array = array

    def rows(self, indices: range) -> Iterator[NDArray[Any]]:
        """Yield the rows of the array."""
        return (self._array[index] for index in indices)

    def close(self) -> None:
        """Nothing is held open."""


class _InArchive:
    def __init__(self, archive: NpzArchive) -> None:
        self.title = str(archive.path)
        self.shape, self.dtype = archive.describe("positions")
        self._archive = archive

    def rows(self, indices: range) -> Iterator[NDArray[Any]]:
        """Yield the rows of the member, read one at a time."""
        return self._archive.rows("positions", indices)

    def close(self) -> None:
        """Close the archive."""
        self._archive.close()


class ArraysReader(Reader):
    """Reads ``.npz`` files and arrays in memory.

    A file holds ``positions`` (n_frames, n, 3) in Å, ``offsets`` (n_strands + 1,) and ``closed``
    (n_strands,), and may hold ``time`` (n_frames,) in ps, ``cell`` (3, 3) or (n_frames, 3, 3) in Å with the
    lattice vectors as rows, and ``names`` (n_strands,). It is read frame by frame: only ``time`` and ``cell``
    are kept. An array in memory comes with `ReaderRequest.strands`, and with the options ``time`` and
    ``cell`` where it has them.

    Coordinates that are not finite are passed on; who measures the frame decides. A cell of zeros, or one
    with a value that is not finite, means that the frame is not periodic; `notes` says so.

    Examples
    --------
    >>> source = Source(object=np.zeros((2, 3, 3)))
    >>> with ArraysReader.open(source, ReaderRequest(strands=Strands.from_lengths([3]))) as reader:
    ...     reader.n_frames
    2
    """

    option_help: ClassVar = {
        "time": "times of an array in memory, shape (n_frames,), ps",
        "cell": "lattice vectors of an array in memory as rows, shape (3, 3) or (n_frames, 3, 3), Å",
    }
    summary: ClassVar[str] = "NumPy arrays, as .npz files or in memory"

    def __init__(
        self,
        positions: _Positions,
        strands: Strands,
        *,
        times: Times | None = None,
        cells: PointSeries | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        self._positions = positions
        self._strands = strands
        self._times = times
        self._cells = cells
        self._notes = tuple(notes)

    @classmethod
    def can_open(cls, source: Source) -> bool:
        """Return whether the source is an array, or its first path ends in ``.npz``."""
        if source.paths:
            return source.paths[0].suffix.lower() == ".npz"
        return isinstance(source.object, np.ndarray)

    @classmethod
    def open(cls, source: Source, request: ReaderRequest) -> Self:
        """Open an ``.npz`` file, or take an array in memory (which is not copied until a frame is asked for).

        Raises
        ------
        InputError
            If an array has a wrong shape or dtype, or a key is missing.
        StrandError
            If the strands do not fit the positions, or are missing.
        TrajectoryError
            If the file is damaged or holds no frames.
        OptionError
            If a selection is given: every vertex of an array is read.
        """
        if request.select is not None:
            raise OptionError(
                f"The arrays reader takes no selection, and {request.select!r} was given; "
                "store only the vertices you want."
            )
        if isinstance(source.object, np.ndarray):
            return cls._open_array(source.object, request)
        if len(source.paths) != 1:
            raise UnknownFormatError(f"The arrays reader takes one .npz file or one array, not {source.title}.")
        return cls._open_file(source.paths[0], request)

    @classmethod
    def _open_array(cls, array: NDArray[Any], request: ReaderRequest) -> Self:
        positions = _InMemory(array)
        _check_positions(positions)
        if request.strands is None:
            raise StrandError(
                "An array does not say which vertices form a strand; pass strands=mdtopo.Strands.from_lengths([...])."
            )
        _check_vertices(request.strands, positions)
        times = _times(request.options.get("time"), positions)
        cells = _cells(request.options.get("cell"), positions)
        return cls(positions, request.strands, times=times, cells=cells, notes=_cell_notes(cells))

    @classmethod
    def _open_file(cls, path: Path, request: ReaderRequest) -> Self:
        for name in request.options:
            raise OptionError(f"The reader option {name!r} is for arrays in memory; store '{name}' in {path} instead.")
        archive = NpzArchive(path)
        try:
            return cls._from_archive(archive, request.strands)
        except BaseException:
            archive.close()
            raise

    @classmethod
    def _from_archive(cls, archive: NpzArchive, given: Strands | None) -> Self:
        _check_keys(archive, given)
        positions = _InArchive(archive)
        _check_positions(positions)
        strands = given if given is not None else _stored_strands(archive)
        _check_vertices(strands, positions)
        times = _times(_optional(archive, "time"), positions)
        cells = _cells(_optional(archive, "cell"), positions)
        notes = [*_unread_notes(archive), *_cell_notes(cells)]
        return cls(positions, strands, times=times, cells=cells, notes=notes)

    @property
    def n_frames(self) -> int:
        """Number of frames, at least one."""
        return self._positions.shape[0]

    @property
    def strands(self) -> Strands:
        """The strands, as stored or as given."""
        return self._strands

    @cached_property
    def _coordinate_error(self) -> float:
        dtype = self._positions.dtype
        if dtype.kind != "f" or dtype.itemsize >= np.dtype(np.float64).itemsize:
            return 0.0
        spacing = float(np.spacing(dtype.type(_greatest_coordinate(self._positions))))
        return math.sqrt(3.0) * spacing / 2.0

    @property
    def coordinate_error(self) -> float:
        """η in Å: √3/2 times the stored dtype's spacing at the greatest coordinate; 0 for float64, integers.

        Rounding moves each of a vertex's three coordinates by at most half a spacing, and the spacing grows
        with the coordinate. The first access reads all frames once unless they are float64; those that cannot
        be read do not count.
        """
        return self._coordinate_error

    @property
    def notes(self) -> Sequence[str]:
        """What was left out, and which frames are not periodic although there is a cell."""
        return self._notes

    def frames(self, start: int | None = None, stop: int | None = None, step: int | None = None) -> Iterator[Frame]:
        """Yield the frames of a Python slice, in order; a negative step re-reads a file for every frame.

        Raises
        ------
        TrajectoryError
            When a frame cannot be read; the message names it.
        """
        wanted = range(self.n_frames)[slice(start, stop, step)]
        for index, stored in zip(wanted, self._positions.rows(wanted), strict=True):
            time = math.nan if self._times is None else float(self._times[index])
            yield Frame(index, time, np.array(stored, dtype=np.float64, order="C"), self._cell(index))

    def _cell(self, index: int) -> Cell | None:
        if self._cells is None:
            return None
        cell = self._cells[index] if self._cells.ndim == 3 else self._cells
        return cell.copy() if _is_periodic(cell) else None

    def close(self) -> None:
        """Close the file. Closing twice is no error."""
        self._positions.close()


def _greatest_coordinate(positions: _Positions) -> float:
    greatest = 0.0
    try:
        for stored in positions.rows(range(positions.shape[0])):
            greatest = max(greatest, float(np.max(np.abs(stored), where=np.isfinite(stored), initial=0.0)))
    except TrajectoryError:
        # whoever asks for this frame is told; the frames before it can still be measured
        return greatest
    return greatest


def _is_number(dtype: np.dtype[Any]) -> bool:
    """Whether float64 holds such values: integers, and floating point of 16, 32 or 64 bits."""
    return dtype.kind in "iuf" and dtype.itemsize <= np.dtype(np.float64).itemsize


def _check_positions(positions: _Positions) -> None:
    shape, dtype = positions.shape, positions.dtype
    if len(shape) != 3 or shape[2] != 3:
        raise InputError(f"The positions in {positions.title} have shape {shape}; expected (n_frames, n, 3).")
    if not _is_number(dtype):
        raise InputError(f"The positions in {positions.title} are of dtype {dtype}; expected float64 or float32.")
    if shape[0] == 0:
        raise TrajectoryError(f"The positions in {positions.title} hold no frames: their shape is {shape}.")


def _check_keys(archive: NpzArchive, given: Strands | None) -> None:
    needed = ("positions",) if given is not None else ("positions", *STRAND_KEYS)
    for key in needed:
        if key not in archive.keys:
            found = ", ".join(archive.keys) or "nothing"
            raise InputError(f"{archive.path} has no array '{key}'; it holds {found}.")
    if given is not None and any(key in archive.keys for key in STRAND_KEYS):
        raise StrandError(f"{archive.path} holds strands of its own, and others were given; leave one of them out.")


def _check_vertices(strands: Strands, positions: _Positions) -> None:
    if strands.n_vertices != positions.shape[1]:
        raise StrandError(
            f"The strands end at vertex {strands.n_vertices}, but each frame of {positions.title} holds "
            f"{positions.shape[1]} vertices; the last offset must equal that number."
        )


def _stored_strands(archive: NpzArchive) -> Strands:
    offsets = archive.read("offsets")
    if offsets.ndim != 1 or offsets.dtype.kind not in "iu" or len(offsets) < 2:
        raise StrandError(
            f"The offsets in {archive.path} have shape {offsets.shape} and dtype {offsets.dtype}; "
            "expected integers of shape (n_strands + 1,)."
        )
    offsets = offsets.astype(np.int64)
    if offsets[0] != 0 or (np.diff(offsets) < 0).any():
        raise StrandError(f"The offsets in {archive.path} must rise from 0 to the number of vertices.")
    n_strands = len(offsets) - 1
    closed, names = _closed(archive, n_strands), _names(archive, n_strands)
    return Strands.from_lengths(np.diff(offsets).tolist(), closed=closed, names=names)


def _closed(archive: NpzArchive, n_strands: int) -> list[bool]:
    closed = archive.read("closed")
    if closed.shape not in {(), (n_strands,)}:
        raise StrandError(f"'closed' in {archive.path} has shape {closed.shape}; expected ({n_strands},).")
    if closed.dtype.kind not in "biu" or not np.isin(closed, (0, 1)).all():
        raise StrandError(f"'closed' in {archive.path} is of dtype {closed.dtype}; expected booleans, or 0 and 1.")
    return [bool(ring) for ring in np.broadcast_to(closed, (n_strands,))]


def _names(archive: NpzArchive, n_strands: int) -> list[str] | None:
    names = _optional(archive, "names")
    if names is None:
        return None
    if names.shape != (n_strands,) or names.dtype.kind not in "US":
        raise StrandError(
            f"The names in {archive.path} have shape {names.shape} and dtype {names.dtype}; "
            f"expected text of shape ({n_strands},)."
        )
    try:
        return [name.decode() if isinstance(name, bytes) else str(name) for name in names.tolist()]
    except UnicodeDecodeError as error:
        raise StrandError(f"The names in {archive.path} are not UTF-8 ({error}).") from error


def _optional(archive: NpzArchive, key: str) -> NDArray[Any] | None:
    return archive.read(key) if key in archive.keys else None


def _as_numbers(values: Any, name: str, title: str) -> NDArray[np.float64]:
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"'{name}' of {title} is not an array of numbers ({error}).") from error
    if not _is_number(array.dtype):
        raise InputError(f"'{name}' of {title} is of dtype {array.dtype}; expected numbers.")
    return array.astype(np.float64)


def _times(values: Any, positions: _Positions) -> Times | None:
    if values is None:
        return None
    times = _as_numbers(values, "time", positions.title)
    if times.shape != positions.shape[:1]:
        raise InputError(f"'time' of {positions.title} has shape {times.shape}; expected {positions.shape[:1]}.")
    return times


def _cells(values: Any, positions: _Positions) -> PointSeries | None:
    if values is None:
        return None
    cells = _as_numbers(values, "cell", positions.title)
    per_frame = (positions.shape[0], 3, 3)
    if cells.shape not in {(3, 3), per_frame}:
        raise InputError(
            f"'cell' of {positions.title} has shape {cells.shape}; expected (3, 3) or {per_frame}, "
            "the lattice vectors as rows."
        )
    return cells


def _is_periodic(cell: Cell) -> bool:
    return bool(np.isfinite(cell).all() and cell.any())


def _cell_notes(cells: PointSeries | None) -> list[str]:
    if cells is None:
        return []
    unusable = [index for index, cell in enumerate(cells.reshape(-1, 3, 3)) if not _is_periodic(cell)]
    if not unusable:
        return []
    which = "The cell" if cells.ndim == 2 else f"The cell of {len(unusable)} frames, the first being {unusable[0]},"
    return [f"{which} is zero or not finite, and is taken as not periodic."]


def _unread_notes(archive: NpzArchive) -> list[str]:
    # said aloud, because a cell stored under another name would make a periodic run look like an open one
    unread = [key for key in archive.keys if key not in KEYS]
    return [f"These arrays of {archive.path} are not read: {', '.join(unread)}."] if unread else []
