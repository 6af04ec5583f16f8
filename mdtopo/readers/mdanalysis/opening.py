"""Opens files with MDAnalysis, or says in one sentence why it cannot."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from mdtopo.errors import (
    InputError,
    MissingDependencyError,
    MissingFileError,
    TrajectoryError,
    UnknownFormatError,
)
from mdtopo.readers.base import Source
from mdtopo.readers.mdanalysis.calls import mdanalysis_call, one_line
from mdtopo.readers.mdanalysis.extensions import COMPRESSIONS, FRAMES_ONLY, NAMING_ATOMS, extension
from mdtopo.readers.mdanalysis.options import Options
from mdtopo.readers.mdanalysis.truncation import dcd_size, spare_xdr_bytes, spare_xyz_lines

LACKING = re.compile(r"please install|not installed|no module named|requires the .* package", re.IGNORECASE)
"""How MDAnalysis says that a package is missing, where it does not raise an ImportError."""


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A Universe with coordinates.

    Attributes
    ----------
    universe : MDAnalysis.Universe
        The Universe.
    group : MDAnalysis.AtomGroup or None
        The atoms that the caller passed; None for all of them.
    title : str
        What to call the trajectory in a message.
    n_frames : int
        Number of frames; the one counts too within which a file that was cut off ends.
    is_ours : bool
        Whether the files were opened here, and have to be closed here.
    notes : tuple of str
        What a user should know of the files.
    is_plain : bool
        Whether the files were opened here, and times and units are those that they hold.
    """

    universe: Any
    group: Any
    title: str
    n_frames: int
    is_ours: bool
    notes: tuple[str, ...] = ()
    is_plain: bool = False


def open_object(source: Source) -> Opened:
    """Return a Universe or AtomGroup, ready to be read where it is.

    Raises
    ------
    InputError
        If it has no coordinates.
    """
    universe = source.object.universe
    trajectory = getattr(universe, "trajectory", None)
    if trajectory is None:
        raise InputError(f"{source.title} has no coordinates; load a trajectory into its Universe first.")
    is_group = source.object is not universe and len(source.object) < len(universe.atoms)
    notes: tuple[str, ...] = ()
    if type(source.object).__name__.startswith("Updating"):
        notes = ("The group updates itself: the atoms that it holds now are taken for the whole run.",)
    group = source.object.unique if is_group else None
    return Opened(universe, group, source.title, int(trajectory.n_frames), False, notes)


def open_files(source: Source, options: Options) -> Opened:
    """Return the Universe of a topology file and trajectory parts.

    Raises
    ------
    UnknownFormatError
        If MDAnalysis knows no format of that name or extension.
    MissingDependencyError
        If a format needs a package that is not installed.
    TrajectoryError
        If a trajectory cannot be read, is empty, or has another number of atoms than the topology.
    InputError
        If the topology cannot be read, or holds no coordinates and no trajectory was given, or if topology and
        trajectory seem to be swapped.
    """
    topology, parts = source.paths[0], source.paths[1:]
    for path in source.paths:
        _refuse_unusable(path)
    if options.topology_format is None and options.format is None:
        _refuse_swapped(topology, parts)
    _refuse_unknown(topology, options.topology_format, is_topology=True)
    for path in parts:
        _refuse_unknown(path, options.format, is_topology=False)
    universe = _loaded_topology(topology, parts, options)
    if parts:
        _load_trajectory(universe, topology, parts, options)
    elif getattr(universe, "trajectory", None) is None:
        raise InputError(f"{topology} holds no coordinates; pass a trajectory file after it.")
    if options.guess_bonds:
        _guess_bonds(universe, topology)
    n_frames, notes = _length(universe.trajectory)
    title = " + ".join(str(path) for path in parts or (topology,))
    if n_frames < 1:
        raise TrajectoryError(f"{title} holds no frames.")
    notes += _unit_notes(topology, parts, options)
    is_plain = options.dt is None and options.time_offset is None and options.convert_units
    return Opened(universe, None, title, n_frames, True, notes, is_plain)


def _refuse_unusable(path: Path) -> None:
    if not path.exists():
        raise MissingFileError(f"{path} does not exist.")
    if path.is_file() and path.stat().st_size == 0:
        raise TrajectoryError(f"{path} is empty.")


def _refuse_swapped(topology: Path, parts: Sequence[Path]) -> None:
    for path in parts:
        if extension(topology) in FRAMES_ONLY and extension(path) in NAMING_ATOMS:
            raise InputError(
                f"{topology} stands for the topology, but holds frames only, and {path} for the trajectory, but names "
                "atoms: are the two files swapped? The topology comes first."
            )


def _refuse_unknown(path: Path, name: str | None, *, is_topology: bool) -> None:
    from MDAnalysis.core._get_readers import get_parser_for, get_reader_for

    find, option = (get_parser_for, "topology_format") if is_topology else (get_reader_for, "format")
    kind = "topology" if is_topology else "trajectory"
    try:
        with mdanalysis_call(str(path)):
            find(str(path), format=name)
    except (ValueError, TypeError, KeyError) as error:
        found = f"the format {name!r}" if name else f"the extension {path.suffix!r} of {path}"
        raise UnknownFormatError(
            f"MDAnalysis knows no {kind} format for {found}; name one with the reader option {option}."
        ) from error


def _loaded_topology(topology: Path, parts: Sequence[Path], options: Options) -> Any:
    import MDAnalysis
    from MDAnalysis.core._get_readers import get_parser_for

    try:
        with mdanalysis_call(str(topology)):
            if not parts:  # the topology file is the trajectory as well
                chosen = options.chosen("topology_format", "atom_style", "format")
                return MDAnalysis.Universe(str(topology), **chosen, **_trajectory_options(options))
            # parsed apart, because a Universe would read the coordinates of the file too
            parser = get_parser_for(str(topology), format=options.topology_format)
            with parser(str(topology)) as file:
                # types and masses are guessed when a selection asks for them: that takes as long as reading the file
                return MDAnalysis.Universe(file.parse(**options.chosen("atom_style")), to_guess=())
    except Exception as error:
        _refuse(error, f"{topology} cannot be read as a topology", InputError)


def _load_trajectory(universe: Any, topology: Path, parts: Sequence[Path], options: Options) -> None:
    chosen = _trajectory_options(options)
    names = [str(path) for path in parts]
    several: Any = [(name, options.format) for name in names] if options.format else names
    if options.continuous:
        chosen["continuous"] = True
    title = " + ".join(names)
    try:
        with mdanalysis_call(title):
            if len(names) > 1 or options.continuous:
                universe.load_new(several, **chosen)
            else:
                universe.load_new(names[0], format=options.format, **chosen)
    except Exception as error:
        _refuse_counts(error, len(universe.atoms), topology, parts, options.format)
        _refuse(error, f"{title} cannot be read as a trajectory", TrajectoryError)


def _guess_bonds(universe: Any, topology: Path) -> None:
    try:
        with mdanalysis_call(str(topology)):
            universe.guess_TopologyAttrs(to_guess=["types", "bonds"])
    except Exception as error:
        _refuse(error, f"The bonds of {topology} cannot be guessed", InputError)


def _trajectory_options(options: Options) -> dict[str, Any]:
    chosen = options.chosen("dt", "time_offset", "lengthunit", "timeunit")
    return chosen if options.convert_units else {**chosen, "convert_units": False}


def _refuse_counts(error: Exception, expected: int, topology: Path, parts: Sequence[Path], name: str | None) -> None:
    """Raise with both numbers of atoms if a part's differs from the topology's."""
    for path in parts:
        found = _count_atoms(path, name)
        if found not in (None, expected):
            raise TrajectoryError(
                f"{path} has {found} atoms, but the topology {topology} has {expected}; "
                "pass the topology that the trajectory was written with."
            ) from error


def _count_atoms(path: Path, name: str | None) -> int | None:
    """Return the number of atoms of a trajectory file; None where it does not say or is damaged."""
    import MDAnalysis
    from MDAnalysis.core._get_readers import get_reader_for

    try:
        with mdanalysis_call(str(path)):
            return int(get_reader_for(str(path), format=name).parse_n_atoms(str(path)))
    except Exception:
        try:
            with mdanalysis_call(str(path)):
                return len(MDAnalysis.Universe(str(path)).atoms)
        except Exception:
            return None


def _refuse(error: Exception, what: str, kind: type[InputError]) -> NoReturn:
    if isinstance(error, ImportError) or LACKING.search(str(error)):
        raise MissingDependencyError(f"{what}: {one_line(error)}. Install what is missing.") from error
    raise kind(f"{what}: {one_line(error).rstrip('.')}.") from error


def _length(trajectory: Any) -> tuple[int, tuple[str, ...]]:
    """Return the number of frames, and notes where a DCD is shorter than its header declares.

    The frame within which a file ends counts too: reading then ends with an error there, and not silently.
    """
    held, notes = int(trajectory.n_frames), []
    readers = getattr(trajectory, "readers", [trajectory])
    for reader in readers:
        path, whole = Path(str(reader.filename)), int(reader.n_frames)
        if not path.is_file():
            continue
        size = dcd_size(path)
        if size is not None and size.declared > whole and not size.spare_bytes:
            notes.append(f"The header of {path} declares {size.declared} frames, but the file holds {whole}.")
        if _ends_within_frame(reader, path):
            if reader is not readers[-1]:
                raise TrajectoryError(f"{path}, which is not the last part, is cut off within frame {whole}.")
            held += 1
    return held, tuple(notes)


def _ends_within_frame(reader: Any, path: Path) -> bool:
    """Return whether a file ends within a frame that MDAnalysis does not count (DCD, XTC, TRR, plain XYZ)."""
    if reader.format == "XYZ" and path.suffix.lower() not in COMPRESSIONS:
        return spare_xyz_lines(path, int(reader.n_atoms)) > 0
    if reader.format in ("XTC", "TRR"):
        offsets = getattr(getattr(reader, "_xdr", None), "offsets", None)  # where it has them is MDAnalysis' own affair
        return offsets is not None and len(offsets) > 0 and spare_xdr_bytes(path, int(offsets[-1])) > 0
    size = dcd_size(path)
    return size is not None and size.spare_bytes > 0


def _unit_notes(topology: Path, parts: Sequence[Path], options: Options) -> tuple[str, ...]:
    """Return what units a LAMMPS model has in other programs' formats."""
    if (options.topology_format or topology.suffix[1:]).upper() != "DATA":
        return ()
    formats = {(options.format or path.suffix[1:]).upper() for path in parts}
    notes = []
    if "DCD" in formats and options.dt is None:
        notes.append(
            "A DCD of LAMMPS does not say its units: lengths are taken as stored, and times mean nothing; "
            "pass --reader-option dt=..., or format=LAMMPS and timeunit=... likewise."
        )
    if formats & {"XTC", "TRR"} and options.convert_units:
        notes.append(
            "An XTC or TRR file counts in nm: lengths are ten times those of the LAMMPS model, "
            "unless --reader-option convert_units=no is passed."
        )
    return tuple(notes)
