"""An output that is being written: immutable parts beside it, and a small file that says how far they go.

``<out>.parts`` holds ``part-<first step>.h5``, each a results file of its own, ``state.json`` and a lock. A part is
written to a temporary name, closed, brought to the disk and renamed; then the state file likewise. So whatever happens,
a part that has its name is whole.
"""

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from mdtopo.bonds import BondState
from mdtopo.errors import InputError, OutputError
from mdtopo.records import Alert, BrokenEdge, MonitorConfig, ReferenceLengths, StepTable, Strands
from mdtopo.store.atomic import failed, write_text
from mdtopo.store.provenance import Provenance
from mdtopo.store.reader import read_results
from mdtopo.store.tables import stored_tables
from mdtopo.store.writer import ResultsWriter
from mdtopo.typing import JsonObject

STATE_SCHEMA = "mdtopo.state/1"
STATE_KEYS = frozenset({"version", "config", "request", "inputs", "started", "next_step", "parts"})

EndKind: TypeAlias = Literal["put down", "failed"]
"""How a run ends that does not come to its last step: on request, or by an error."""


class DamagedStateError(OutputError):
    """A state file says nothing that can be relied on; the parts know all of it."""


@dataclass(frozen=True, slots=True)
class Head:
    """What all parts of a run, and its results file, begin with.

    Attributes
    ----------
    strands, config, provenance, request
        As for `ResultsWriter.create`.
    reference : ReferenceLengths or None
        Reference lengths of the edges.
    inherited : tuple of BrokenEdge
        Edges that had broken before the run's first step.
    """

    strands: Strands
    config: MonitorConfig
    provenance: Provenance
    request: Mapping[str, Any]
    reference: ReferenceLengths | None = None
    inherited: tuple[BrokenEdge, ...] = ()

    def identity(self) -> dict[str, Any]:
        """Return what must be the same for a run to go on, as JSON gives it back."""
        values = {
            "version": self.provenance.versions.get("mdtopo"),
            "config": self.config.to_mapping(),
            "request": dict(self.request),
            "inputs": self.provenance.to_mapping()["inputs"],
        }
        plain: dict[str, Any] = json.loads(json.dumps(values, default=str))
        return plain

    def writer(self, path: Path, *, overwrite: bool = False, folder: Path | None = None) -> ResultsWriter:
        """Return a writer for a file that begins so."""
        writer = ResultsWriter.create(
            path,
            self.strands,
            self.config,
            self.provenance,
            request=self.request,
            overwrite=overwrite,
            folder=folder,
        )
        writer.inherit(self.inherited)
        if self.reference is not None:
            writer.add_reference(self.reference)
        return writer


@dataclass(frozen=True, slots=True)
class Part:
    """A finished part: its file, its first step, how many steps it holds, and the last frame of the last one."""

    path: Path
    first_step: int
    n_steps: int
    last_frame: int
    bonds: tuple[BondState, BondState]

    @property
    def next_step(self) -> int:
        """The step behind it."""
        return self.first_step + self.n_steps


def folder_of(out: Path) -> Path:
    """Return the directory of an output's parts."""
    return out.with_name(f"{out.name}.parts")


def read_state(out: Path) -> dict[str, Any] | None:
    """Return what the state file of an unfinished output says, None where there is none.

    Raises
    ------
    DamagedStateError
        If it is damaged.
    OutputError
        If it is of another version of its format.
    """
    path = folder_of(out) / "state.json"
    try:
        state: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise DamagedStateError(f"{path} cannot be read ({error}).") from error
    if not isinstance(state, dict) or not isinstance(state.get("schema"), str):
        raise DamagedStateError(f"{path} is no state file of mdtopo.")
    if state["schema"] != STATE_SCHEMA:
        raise OutputError(
            f"{path} has the format {state['schema']}, and this mdtopo knows {STATE_SCHEMA}; use the mdtopo that began "
            "the run, or give --overwrite to begin again."
        )
    missing = STATE_KEYS - set(state)
    if missing:
        raise DamagedStateError(f"{path} lacks {sorted(missing)[0]!r}.")
    return state


def finished_parts(out: Path) -> list[Part]:
    """Return the finished parts of an output, in order.

    Raises
    ------
    OutputError
        If one is missing or damaged.
    """
    return list(_parts_in_order(out))


def sound_parts(out: Path) -> list[Part]:
    """Return the finished parts of an output in front of the first one that is missing or damaged."""
    parts: list[Part] = []
    with suppress(OutputError):
        for part in _parts_in_order(out):
            parts.append(part)
    return parts


def _parts_in_order(out: Path) -> Iterator[Part]:
    expected = 0
    for path in sorted(folder_of(out).glob("part-*.h5")):
        try:
            found = read_results(path, columns=("frame_t1",))
        except InputError as error:
            raise OutputError(f"{error} Restore it, or give --overwrite to go on in front of it.") from error
        frames = found.steps["frame_t1"]
        if found.first_step != expected or found.bonds is None or not len(frames):
            raise OutputError(
                f"{path} begins with step {found.first_step} where step {expected} belongs; a part is missing. "
                "Restore it, or give --overwrite to go on in front of it."
            )
        part = Part(path, found.first_step, len(frames), int(frames[-1]), found.bonds)
        expected = part.next_step
        yield part


def state_of_parts(out: Path) -> dict[str, Any] | None:
    """Return what a state file would say of the parts that are there, worked out from them; None where there are none.

    That a part is missing behind the last one cannot be told from them.
    """
    parts = sound_parts(out)
    if not parts:
        return None
    found = read_results(parts[0].path, columns=())
    identity = {
        "version": found.provenance["versions"].get("mdtopo"),
        "config": found.config,
        "request": found.request,
        "inputs": found.provenance["inputs"],
    }
    return _state(identity, found.provenance["started"], parts)


def _state(identity: JsonObject, started: str, parts: list[Part]) -> dict[str, Any]:
    return {
        "schema": STATE_SCHEMA,
        **identity,
        "started": started,
        "next_step": parts[-1].next_step if parts else 0,
        "last_frame": parts[-1].last_frame if parts else None,
        "parts": [{"name": p.path.name, "first_step": p.first_step, "n_steps": p.n_steps} for p in parts],
    }


def part_tables(out: Path) -> Iterator[StepTable]:
    """Yield the steps of the finished parts of an output, in order; see `stored_tables`."""
    for path in sorted(folder_of(out).glob("part-*.h5")):
        yield from stored_tables(path)


def discard(out: Path) -> None:
    """Remove all that is in the directory of an output's parts but the lock, the state file last."""
    folder = folder_of(out)
    for path in sorted(folder.iterdir(), key=lambda path: (path.name == "state.json", path.name)):
        if path.name != "lock":
            with suppress(OSError):
                path.unlink()


def remove_folder(out: Path) -> None:
    """Remove the directory of an output's parts."""
    discard(out)
    shutil.rmtree(folder_of(out), ignore_errors=True)


@dataclass(slots=True)
class PartsWriter:
    """Writes the parts of one output; whoever makes it holds the lock.

    Attributes
    ----------
    out : Path
        The output.
    head : Head
    started : str
        When the run was first begun, UTC.
    parts : list of Part
        Those that are finished.
    is_measuring : bool
        Whether steps are being measured, and not only what is needed for that looked at.
    """

    out: Path
    head: Head
    started: str
    parts: list[Part] = field(default_factory=list)
    is_measuring: bool = False
    _writer: ResultsWriter | None = None
    _first_step: int = 0
    _n_steps: int = 0
    _last_frame: int = -1
    _start: BondState | None = None
    _end: BondState | None = None
    _early: list[Alert] = field(default_factory=list)

    def begin(self) -> None:
        """Make the state file, and remove what a killed writer left behind."""
        for path in folder_of(self.out).glob(".*.partial"):
            with suppress(OSError):
                path.unlink()
        self._write_state()

    @property
    def n_open(self) -> int:
        """Steps of the part that is being written."""
        return self._n_steps

    def append(self, table: StepTable, start: BondState, end: BondState) -> None:
        """Add the steps of a table; `start` and `end` are the bonds at their first and last frame."""
        if self._writer is None:
            self._first_step, self._n_steps, self._start = table.first_step, 0, start
            self._writer = self.head.writer(self._open_path)
            for alert in self._early:
                self._writer.append_alert(alert)
            self._early = []
        self._writer.append(table)
        self._n_steps += len(table)
        self._last_frame, self._end = int(table.frame_t1[-1]), end

    def append_alert(self, alert: Alert) -> None:
        """Add an alert to the part that is being written, if there is one: readers of a running output see it there.

        What is said before the first step goes into the first part.
        """
        if self._writer is not None:
            self._writer.append_alert(alert)
        elif not self.parts:
            self._early.append(alert)

    def close_part(self) -> None:
        """Finish the part that is being written, if there is one, then the state file."""
        if self._writer is None or self._start is None or self._end is None:
            return
        writer, self._writer = self._writer, None
        writer.add_bonds(self._start, self._end)
        writer.finish({}, complete=False)
        self._note_part(self._start, self._end)

    @property
    def has_only_part_open(self) -> bool:
        """Whether all steps that there are lie in the part that is being written."""
        return self._writer is not None and self._writer.is_open and not self.parts

    def publish(self, summary: Mapping[str, Any], *, complete: bool, overwrite: bool) -> None:
        """Finish the only part, which is being written, as the results file itself.

        Raises
        ------
        OutputError
            If it cannot be written, or cannot have its name. In the latter case it is a finished part then.
        """
        assert self._writer is not None
        assert self._start is not None
        assert self._end is not None
        self._writer.rename(self.out, overwrite=overwrite)
        writer, self._writer = self._writer, None
        writer.add_bonds(self._start, self._end)
        try:
            writer.finish(summary, complete=complete)
        except OutputError as error:
            if not writer.partial.exists():
                raise
            path = self._open_path
            writer.partial.replace(path)
            self._note_part(self._start, self._end)
            raise OutputError(str(error).replace(str(writer.partial), str(path))) from error

    @property
    def _open_path(self) -> Path:
        return folder_of(self.out) / f"part-{self._first_step:010d}.h5"

    def _note_part(self, start: BondState, end: BondState) -> None:
        part = Part(self._open_path, self._first_step, self._n_steps, self._last_frame, (start, end))
        self.parts.append(part)
        self._n_steps = 0
        self._write_state()

    def abandon_part(self) -> None:
        """Throw away the part that is being written: the disk is full, or its steps cannot be relied on."""
        if self._writer is not None:
            self._writer.abort()
            self._writer = None

    def note_end(self, kind: EndKind, reason: str) -> None:
        """Write into the state file how the run ended before its last step, for those who watch it.

        Raises
        ------
        OutputError
            If it cannot be written; the state file is then as it was.
        """
        self._write_state({"ended": {"kind": kind, "reason": reason}})

    def _write_state(self, more: Mapping[str, Any] | None = None) -> None:
        state = {**_state(self.head.identity(), self.started, self.parts), **(more or {})}
        write_text(folder_of(self.out) / "state.json", json.dumps(state, indent=1))


def make_folder(out: Path) -> None:
    """Make the directory of an output's parts, where it is missing.

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    folder = folder_of(out)
    if folder.exists() and not folder.is_dir():
        raise OutputError(
            f"{folder} is no directory, and parts of {out} belong there; remove it, or name another output."
        )
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise failed(out, error) from error
