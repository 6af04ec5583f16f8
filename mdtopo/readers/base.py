"""The contract that every reader keeps."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

from mdtopo.records import Frame, Strands


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """What the user passed as input: file paths, or one Python object.

    Attributes
    ----------
    paths : tuple of Path
        Topology first, then the trajectory parts in order; empty where an object was passed.
    object : object or None
        An MDAnalysis Universe or AtomGroup, or an array; None where paths were passed.
    """

    paths: tuple[Path, ...] = ()
    object: Any = None

    @property
    def title(self) -> str:
        """What to call this input in a message."""
        if self.paths:
            return " + ".join(str(path) for path in self.paths)
        return f"a {type(self.object).__module__.split('.')[0]} {type(self.object).__name__}"


@dataclass(frozen=True, slots=True)
class ReaderRequest:
    """What the user wants of the input, beside the input itself.

    Attributes
    ----------
    select : str or None
        Selection of the backbone atoms in the reader's own language; None for the reader's default.
    options : mapping of str to str or object
        Reader options by name, as from ``--reader-option NAME=VALUE``.
    strands : Strands or None
        Strands given by the caller, where the input itself holds none (arrays).
    """

    select: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    strands: Strands | None = None


class Reader(ABC):
    """A source of frames. Plugins register a subclass in the entry-point group ``mdtopo.readers.v1``.

    A reader is open once it exists; `close` may be called twice. Every yielded frame owns its arrays.
    `mdtopo.testing.ReaderContract` is the test class that a plugin author inherits.

    Attributes
    ----------
    option_help : mapping of str to str
        Every option that `open` takes, with one line of help; any other name is refused.
    summary : str
        One line for ``mdtopo readers``.
    """

    option_help: ClassVar[Mapping[str, str]] = {}
    summary: ClassVar[str] = ""

    @classmethod
    @abstractmethod
    def can_open(cls, source: Source) -> bool:
        """Return whether this reader takes the source, judged by type and file name alone (nothing is read)."""

    @classmethod
    @abstractmethod
    def open(cls, source: Source, request: ReaderRequest) -> Self:
        """Open the source.

        Raises
        ------
        InputError
            One of its subclasses, with a sentence that names the file and the cure.
        """

    @property
    @abstractmethod
    def n_frames(self) -> int | None:
        """Number of frames; None for a stream, which can be read once and forward only."""

    @property
    @abstractmethod
    def strands(self) -> Strands:
        """The strands of the selected vertices, constant over the run."""

    @property
    @abstractmethod
    def coordinate_error(self) -> float:
        """η: how far a stored coordinate may be from the one the engine had, Å; 0 where nothing is known."""

    @property
    def notes(self) -> Sequence[str]:
        """What a user should know of how the input was understood, one sentence each."""
        return ()

    @abstractmethod
    def frames(self, start: int | None = None, stop: int | None = None, step: int | None = None) -> Iterator[Frame]:
        """Yield the frames of a Python slice, in order.

        Raises
        ------
        TrajectoryError
            When a frame cannot be read; the message names it.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the files. Closing twice is no error."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
