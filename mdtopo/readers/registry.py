"""Which readers are installed, and which of them opens an input."""

import inspect
import logging
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from importlib.metadata import EntryPoint
from pathlib import Path

from mdtopo.errors import (
    InputError,
    MdtopoError,
    MissingDependencyError,
    MissingFileError,
    OptionError,
    UnknownFormatError,
)
from mdtopo.readers.base import Reader, ReaderRequest, Source

GROUP = "mdtopo.readers.v1"
"""The entry-point group of reader plugins; the number rises when the contract changes."""

ASKED_FIRST = (EntryPoint("arrays", "mdtopo.readers.arrays:ArraysReader", GROUP),)
"""Built-in readers of narrow formats. They are named here too, so that a bare checkout finds them."""

ASKED_LAST = (EntryPoint("mdanalysis", "mdtopo.readers.mdanalysis:MDAnalysisReader", GROUP),)
"""The built-in reader that takes nearly every format, so everyone else is asked before it."""

# logging and not warnings: under -W error a broken plugin would stop a run that does not need it
_log = logging.getLogger(__name__)
_announced: set[str] = set()


@dataclass(frozen=True, slots=True)
class BrokenReader:
    """An installed reader that cannot be used.

    Attributes
    ----------
    name : str
        Its name in the entry-point group.
    distribution, version : str
        The distribution that installed it; a built-in reader has no version.
    reason : str
        What went wrong, in words.
    missing_dependency : bool
        Whether an import failed.
    """

    name: str
    distribution: str
    version: str
    reason: str
    missing_dependency: bool = False

    def __str__(self) -> str:
        return f"{self.name} (from {f'{self.distribution} {self.version}'.strip()}): {self.reason}"


@dataclass(frozen=True, slots=True)
class ReaderListing:
    """What is installed: the readers by name, in the order in which they are asked, and the broken ones."""

    readers: Mapping[str, type[Reader]]
    broken: tuple[BrokenReader, ...]


def installed_readers() -> ReaderListing:
    """Return every installed reader, loaded, and every one that cannot be loaded, with the reason.

    A broken plugin is logged once in a process, with the name of its distribution, and stops nobody else.
    """
    readers: dict[str, type[Reader]] = {}
    broken: list[BrokenReader] = []
    for point, loaded in _loaded():
        if isinstance(loaded, BrokenReader):
            broken.append(loaded)
        else:
            readers[point.name] = loaded
    return ReaderListing(readers, tuple(broken))


def open_reader(source: Source, request: ReaderRequest, *, reader: str | None = None) -> Reader:
    """Return a reader that has opened the source.

    Parameters
    ----------
    source : Source
        File paths or an object. A `Reader` that is open already is returned as it is.
    request : ReaderRequest
        What is wanted of the source.
    reader : str, optional
        Name of the reader; by default the first one whose `can_open` is true.

    Raises
    ------
    MissingFileError
        If a path does not exist.
    UnknownFormatError
        If no installed reader takes the source; the message lists those that are.
    MissingDependencyError
        If the chosen reader needs a package that is not installed.
    OptionError
        If no reader has that name, or the reader has no such option.
    InputError
        If a path is a directory or may not be read, or the reader refuses the source.
    """
    if isinstance(source.object, Reader):
        return _as_it_is(source.object, request, reader)
    if source.object is None and not source.paths:
        raise InputError("There is no input: neither a file nor an object was given.")
    for path in source.paths:
        _check_file(path)
    chosen = _first_taker(source) if reader is None else _named(reader)
    return open_with(chosen, source, request)


def open_with(reader: type[Reader], source: Source, request: ReaderRequest) -> Reader:
    """Return the source opened by one reader class; its options are checked against `option_help` first.

    Raises
    ------
    OptionError
        If the request has an option that the reader does not list.
    MissingDependencyError
        If the reader needs a package that is not installed.
    InputError
        If the reader refuses the source.
    """
    unknown = sorted(set(request.options) - set(reader.option_help))
    if unknown:
        raise OptionError(f"Unknown reader option {unknown[0]!r}: {_options_in_words(reader)}")
    try:
        return reader.open(source, request)
    except MdtopoError:
        raise
    except ImportError as error:
        raise MissingDependencyError(
            f"{reader.__name__} cannot open {source.title}, because an import failed ({error}). "
            "Install what is missing."
        ) from error


def _options_in_words(reader: type[Reader]) -> str:
    if not reader.option_help:
        return f"{reader.__name__} has no options."
    known = "; ".join(f"{name} ({text})" for name, text in reader.option_help.items())
    return f"{reader.__name__} has the options {known}."


def _as_it_is(opened: Reader, request: ReaderRequest, name: str | None) -> Reader:
    asked = {"reader": name, "select": request.select, "strands": request.strands, **request.options}
    refused = [key for key, value in asked.items() if value is not None]
    if refused:
        raise OptionError(
            f"{type(opened).__name__} is open already and cannot take {refused[0]!r}; give it when you open the reader."
        )
    return opened


def _check_file(path: Path) -> None:
    if not path.exists():
        seen_from = "" if path.is_absolute() else f" (seen from {Path.cwd()})"
        raise MissingFileError(f"{path} does not exist{seen_from}.")
    if path.is_dir():
        raise InputError(f"{path} is a directory; a file was expected.")
    if not os.access(path, os.R_OK):
        raise InputError(f"{path} may not be read by this user; change its permissions.")


def _named(name: str) -> type[Reader]:
    for point in _entry_points():
        if point.name == name:
            loaded = _load(point)
            if isinstance(loaded, BrokenReader):
                kind = MissingDependencyError if loaded.missing_dependency else InputError
                raise kind(f"The reader {loaded}.")
            return loaded
    names = ", ".join(dict.fromkeys(point.name for point in _entry_points()))
    raise OptionError(f"No installed reader is called {name!r}; there are: {names}.")


def _first_taker(source: Source) -> type[Reader]:
    # one at a time: a reader that is not reached is not imported either
    for point, loaded in _loaded():
        if not isinstance(loaded, BrokenReader) and _takes(point, loaded, source):
            return loaded
    raise UnknownFormatError(_nobody_takes(source))


def _takes(point: EntryPoint, reader: type[Reader], source: Source) -> bool:
    try:
        return bool(reader.can_open(source))
    except Exception as error:  # a plugin's fault must not keep the others from being asked
        _announce(_broken(point, f"can_open failed with {type(error).__name__}: {error}"))
        return False


def _nobody_takes(source: Source) -> str:
    listing = installed_readers()
    known = "; ".join(f"{name} ({reader.summary})" for name, reader in listing.readers.items())
    broken = "".join(f" Not usable: {one}." for one in listing.broken)
    return f"No installed reader takes {source.title}. Installed are: {known}.{broken}"


def _entry_points() -> list[EntryPoint]:
    """Return all readers in the order in which they are asked; plugins stand between the built-in ones."""
    built_in = {point.value for point in (*ASKED_FIRST, *ASKED_LAST)}
    plugins = [point for point in entry_points(group=GROUP) if point.value not in built_in]
    return [*ASKED_FIRST, *sorted(plugins, key=lambda point: (point.name, point.value)), *ASKED_LAST]


def entry_points(group: str) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group; the folders are searched anew if one of them has changed since."""
    return _searched(group, tuple((folder, _changed(folder)) for folder in sys.path))


@lru_cache(maxsize=4)
def _searched(group: str, _folders: tuple[tuple[str, int], ...]) -> tuple[EntryPoint, ...]:
    return tuple(metadata.entry_points(group=group))


def _changed(folder: str) -> int:
    try:
        return os.stat(folder or ".").st_mtime_ns
    except OSError:
        return -1


def _loaded() -> Iterator[tuple[EntryPoint, type[Reader] | BrokenReader]]:
    taken = {point.name: point.value for point in reversed((*ASKED_FIRST, *ASKED_LAST))}
    for point in _entry_points():
        if taken.setdefault(point.name, point.value) == point.value:
            yield point, _load(point)
        else:
            broken = _broken(point, f"the name is taken by {taken[point.name]}")
            _announce(broken)
            yield point, broken


def _load(point: EntryPoint) -> type[Reader] | BrokenReader:
    try:
        loaded = point.load()
    except Exception as error:  # a plugin's module can raise anything
        broken = _broken(point, f"{type(error).__name__}: {error}", isinstance(error, ImportError))
    else:
        fault = _fault(loaded)
        if fault is None:
            reader: type[Reader] = loaded
            return reader
        broken = _broken(point, fault)
    _announce(broken)
    return broken


def _fault(loaded: object) -> str | None:
    if not (inspect.isclass(loaded) and issubclass(loaded, Reader)):
        return f"{loaded!r} is not a subclass of mdtopo.readers.Reader"
    lacking = ", ".join(sorted(getattr(loaded, "__abstractmethods__", ())))
    return f"it does not define {lacking}" if lacking else None


def _broken(point: EntryPoint, reason: str, missing_dependency: bool = False) -> BrokenReader:
    # the built-in readers alone are made without a distribution
    name, version = (point.dist.name, point.dist.version) if point.dist else ("mdtopo", "")
    return BrokenReader(point.name, name, version, reason, missing_dependency)


def _announce(broken: BrokenReader) -> None:
    if str(broken) not in _announced:
        _announced.add(str(broken))
        _log.warning("The reader plugin %s. It is left out.", broken)
