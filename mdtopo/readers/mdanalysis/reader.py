"""The reader itself: strands once, then frames by index."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np

from mdtopo.errors import InputError, MdtopoError, SelectionError, TrajectoryError
from mdtopo.readers.base import Reader, ReaderRequest, Source
from mdtopo.readers.mdanalysis.atoms import atom_table, default_trace
from mdtopo.readers.mdanalysis.calls import mdanalysis_call, one_line
from mdtopo.readers.mdanalysis.cells import cell_of
from mdtopo.readers.mdanalysis.extensions import has_known_extension
from mdtopo.readers.mdanalysis.opening import Opened, open_files, open_object
from mdtopo.readers.mdanalysis.options import OPTION_HELP, Options
from mdtopo.readers.mdanalysis.precision import coordinate_error
from mdtopo.readers.mdanalysis.xtc import xtc_frames
from mdtopo.records import Frame, Strands
from mdtopo.strands import Traces, strands_from_atoms
from mdtopo.typing import Indices

SHOWN_NAMES = 8
"""Names of atoms in one sentence."""


class MDAnalysisReader(Reader):
    """Frames and strands of whatever MDAnalysis opens.

    A Universe or AtomGroup is read where it is: its current frame moves while frames are read, and is put
    back when the reading ends. An AtomGroup that is not the whole Universe is the selection, unless another
    one is asked of it.

    Notes
    -----
    Frames are read by index and never by iteration, which ends silently at a frame that cannot be read; those
    of an XTC file below the Universe, see `mdtopo.readers.mdanalysis.xtc`. One thread may read at a time.
    """

    option_help: ClassVar[Mapping[str, str]] = OPTION_HELP
    summary: ClassVar[str] = "PSF, PDB, GRO, TPR, DATA, DCD, XTC, TRR, NC and more; Universe, AtomGroup"

    def __init__(self, opened: Opened, indices: Indices, traces: Traces, error: float, notes: Sequence[str]) -> None:
        self._opened = opened
        self._rows = _rows(indices)
        self._strands = traces.strands
        self._error = error
        self._notes = tuple(notes)
        self._is_closed = False

    @classmethod
    def can_open(cls, source: Source) -> bool:
        """Return whether the source is files or an object of MDAnalysis; files are judged by extension."""
        if source.object is None:
            return any(has_known_extension(path) for path in source.paths)
        mdanalysis = sys.modules.get("MDAnalysis")  # who passes its object has imported it
        return mdanalysis is not None and isinstance(source.object, (mdanalysis.Universe, mdanalysis.AtomGroup))

    @classmethod
    def open(cls, source: Source, request: ReaderRequest) -> Self:
        """Open the source and find its strands.

        Raises
        ------
        InputError
            As one of its subclasses: `OptionError`, `MissingFileError`, `MissingDependencyError`,
            `UnknownFormatError`, `TrajectoryError`, `SelectionError` or `StrandError`.
        """
        options = Options.from_mapping(request.options, is_file=source.object is None)
        if request.strands is not None:
            raise InputError(f"{source.title} tells its strands itself; use `select` to choose among them.")
        opened = open_files(source, options) if source.object is None else open_object(source)
        try:
            return cls._traced(opened, request, options)
        except MdtopoError:
            _release(opened)
            raise

    @classmethod
    def _traced(cls, opened: Opened, request: ReaderRequest, options: Options) -> Self:
        group, notes = _selected(opened, request.select)
        table = atom_table(group)
        with _Position(opened.universe.trajectory, opened.is_ours):
            first = read_frame(opened, 0, group.ix)
            size = np.abs(first.positions)
            error = coordinate_error(opened.universe.trajectory, float(size.max(initial=0.0, where=np.isfinite(size))))
        traces = strands_from_atoms(
            table,
            first.positions,
            first.cell,
            cut=options.cut,
            use_bonds=options.use_bonds,
            close_ends=options.close_ends,
        )
        if first.cell is None:
            notes.append("There is no periodic box in the first frame.")
        if math.isnan(first.time) and opened.n_frames > 1:
            notes.append("The trajectory holds no times; pass --reader-option dt=..., the time between frames in ps.")
        indices = group.ix[traces.order].astype(np.int64)
        return cls(opened, indices, traces, error, [*opened.notes, *notes, *traces.notes])

    @property
    def n_frames(self) -> int:
        """Number of frames; the one counts too within which a file that was cut off ends."""
        return self._opened.n_frames

    @property
    def strands(self) -> Strands:
        """The strands of the selected atoms."""
        return self._strands

    @property
    def coordinate_error(self) -> float:
        """η by the trajectory's format, Å; the share of float32 from the first frame's largest coordinate."""
        return self._error

    @property
    def notes(self) -> Sequence[str]:
        """What was selected, left out or assumed."""
        return self._notes

    def frames(self, start: int | None = None, stop: int | None = None, step: int | None = None) -> Iterator[Frame]:
        """Yield the frames of a Python slice, in order; every frame owns its arrays.

        Raises
        ------
        TrajectoryError
            When a frame cannot be read, or the reader is closed; after the frames, where the slice reaches to the end
            of the file and steps over its last frame, which cannot be read because the file was cut off.
        """
        if self._is_closed:
            raise TrajectoryError(f"{self._opened.title} is closed; open it again.")
        chosen = range(self.n_frames)[start:stop:step]
        with _Position(self._opened.universe.trajectory, self._opened.is_ours):
            direct = xtc_frames(self._opened, self._rows)
            for index in chosen:
                frame = None if direct is None else direct.frame(index)
                yield read_frame(self._opened, index, self._rows) if frame is None else frame
            last = self.n_frames - 1
            if chosen and chosen[-1] != last and _asks_for_end(chosen, stop, last):
                read_frame(self._opened, last, self._rows)

    def current_frame(self) -> Frame:
        """Return the frame at which the trajectory stands, for those who iterate over it themselves."""
        trajectory = self._opened.universe.trajectory
        return _frame(trajectory.ts, trajectory, self._rows)

    def close(self) -> None:
        """Close the files; those of a Universe that was passed stay open."""
        if not self._is_closed:
            self._is_closed = True
            _release(self._opened)


class _Position:
    """Puts a trajectory that belongs to somebody else back to its frame."""

    def __init__(self, trajectory: Any, is_ours: bool) -> None:
        self._trajectory, self._frame = trajectory, None if is_ours else int(trajectory.frame)

    def __enter__(self) -> None:
        return

    def __exit__(self, *_: object) -> None:
        if self._frame is not None:
            with mdanalysis_call("the Universe"):
                self._trajectory[self._frame]


def _release(opened: Opened) -> None:
    if opened.is_ours:
        with mdanalysis_call(opened.title):
            opened.universe.trajectory.close()


def _selected(opened: Opened, select: str | None) -> tuple[Any, list[str]]:
    """Return the selected atoms in file order, and in words what was taken where nothing was asked for."""
    if select is None:
        if opened.group is not None:
            return opened.group, []
        group, words = default_trace(opened.universe)
        if not len(group):
            raise SelectionError(f"{opened.title} has none of the default trace atoms ({words}); pass a selection.")
        return group, [f"The trace is the default one: {words}."]
    within = opened.universe.atoms if opened.group is None else opened.group
    try:
        with mdanalysis_call(opened.title):
            group = _select(within, select, opened)
    except Exception as error:
        raise SelectionError(
            f"The selection {select!r} is malformed, or asks for what the topology does not hold: "
            f"{one_line(error).rstrip('.')}."
        ) from error
    if not len(group):
        raise SelectionError(
            f"The selection {select!r} matches none of the {len(within)} atoms{_names_there(within)}; leave it out for "
            "the default trace, which 'mdtopo doctor' shows."
        )
    return group, []


def _names_there(within: Any) -> str:
    """Return what atoms are called there, in words; nothing where the topology does not name them."""
    names = sorted({name for name in getattr(within, "names", ()) if name and name.isprintable()})
    if not names:
        return ""
    return f", which are called {', '.join(names[:SHOWN_NAMES])}{', ...' if len(names) > SHOWN_NAMES else ''}"


def _select(within: Any, select: str, opened: Opened) -> Any:
    """Return the selected atoms; types and masses are guessed only if the selection asks for them."""
    try:
        return within.select_atoms(select)
    except Exception:  # MDAnalysis has several words for an attribute that the topology lacks
        if not opened.is_ours or hasattr(opened.universe.atoms, "masses"):
            raise
        opened.universe.guess_TopologyAttrs(to_guess=["types", "masses"])
        return within.select_atoms(select)


def read_frame(opened: Opened, index: int, atoms: slice | Indices) -> Frame:
    """Return one frame of the given atoms.

    Raises
    ------
    TrajectoryError
        If the frame cannot be read; names the file and the frame.
    """
    trajectory = opened.universe.trajectory
    held = int(trajectory.n_frames)
    if index >= held:
        raise TrajectoryError(
            f"{opened.title} ends within frame {index}: the file was cut off. "
            f"Read the {held} frames before with the frame range :{held}."
        )
    try:
        with mdanalysis_call(opened.title):
            return _frame(trajectory[index], trajectory, atoms)
    except Exception as error:
        raise TrajectoryError(
            f"Frame {index} of {opened.title} cannot be read: {one_line(error).rstrip('.')}. "
            f"The file is damaged or cut off; read the frames before it with the frame range :{index}."
        ) from error


def _asks_for_end(chosen: range, stop: int | None, last: int) -> bool:
    """Return whether a slice would take frames behind the last one, if the file held more.

    A stride can step over the frame within which a file was cut off. Where the slice ends with the file, or is counted
    from its end, it asks for whatever is missing.
    """
    if chosen.step < 0:
        return False
    if stop is None or stop < 0:
        return True
    asked = range(chosen.start, stop, chosen.step)
    return len(asked) > 0 and asked[-1] >= last


def _frame(step: Any, trajectory: Any, atoms: slice | Indices) -> Frame:
    """Return the given atoms of a timestep; the copy is ours, whatever the next frame overwrites."""
    chosen = step.positions[atoms] if isinstance(atoms, slice) else np.take(step.positions, atoms, axis=0)
    positions = np.array(chosen, dtype=np.float64, order="C")
    return Frame(int(step.frame), _time(step, trajectory), positions, cell_of(step.dimensions))


def _rows(indices: Indices) -> slice | Indices:
    """Return a slice where the atoms follow each other: an index of numbers costs fifteen times as much."""
    first = int(indices[0])
    if np.array_equal(indices, np.arange(first, first + len(indices))):
        return slice(first, first + len(indices))
    return indices


def _time(step: Any, trajectory: Any) -> float:
    """Return the time of a frame, ps; NaN where the file holds none (MDAnalysis then counts 1 ps a frame)."""
    if "time" in step.data or "dt" in step.data or hasattr(trajectory, "_get_dt"):
        return float(step.time)
    return float("nan")
