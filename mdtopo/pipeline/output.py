"""The output of a run: new, gone on with, or finished already."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdtopo.bonds import BondState
from mdtopo.errors import InputError, OutputError
from mdtopo.pipeline.tables import Restart
from mdtopo.records import ReferenceLengths, StepTable
from mdtopo.store import (
    Head,
    OutputLock,
    PartsWriter,
    differences,
    discard,
    finished_parts,
    folder_of,
    make_folder,
    part_tables,
    read_results,
    read_state,
    remove_folder,
    stored_tables,
)
from mdtopo.store.atomic import check_target
from mdtopo.store.parts import DamagedStateError, Part, sound_parts, state_of_parts

log = logging.getLogger("mdtopo")


@dataclass(slots=True)
class Output:
    """An output that this run may write, and what earlier runs have left of it.

    Attributes
    ----------
    path : Path
        The results file.
    head : Head
        What it begins with.
    parts : PartsWriter or None
        None where the results file is finished already.
    resumed : bool
        Whether an earlier run was begun with the same input and settings.
    start : BondState
        The bonds at the first frame, unless that frame is itself the first to be held against their limits.
    """

    path: Path
    head: Head
    parts: PartsWriter | None
    resumed: bool
    overwrite: bool
    start: BondState

    @property
    def is_finished(self) -> bool:
        """Whether the results file holds this run already."""
        return self.parts is None

    def restart(self) -> Restart | None:
        """Return where to go on behind the finished parts; None at the beginning."""
        if self.parts is None or not self.parts.parts:
            return None
        last = self.parts.parts[-1]
        return Restart(last.next_step, last.last_frame, last.bonds[1])

    def tables(self) -> Iterator[StepTable]:
        """Yield what has been measured already."""
        return stored_tables(self.path) if self.is_finished else part_tables(self.path)

    def bonds(self) -> tuple[BondState, BondState]:
        """Return the bonds at the first and at the last frame of the finished parts."""
        parts = self.parts.parts if self.parts is not None else []
        if not parts:
            return self.start, self.start
        return parts[0].bonds[0], parts[-1].bonds[1]

    def note_reference(self, reference: ReferenceLengths) -> None:
        """Keep the reference lengths for the files to come; refuse to go on behind parts that have others.

        Raises
        ------
        OutputError
            If they differ: the beginning of the trajectory is not what it was.
        """
        self.head = replace(self.head, reference=reference)
        if self.parts is None:
            return
        self.parts.head, self.parts.is_measuring = self.head, True
        if self.parts.parts:
            stored = read_results(self.parts.parts[0].path, columns=()).reference
            if stored is None or stored.lengths.tobytes() != reference.lengths.tobytes():
                raise OutputError(
                    f"{self.path} was begun with a trajectory whose first frames were others; give --overwrite to "
                    "begin again."
                )


def open_output(stack: ExitStack, path: Path, head: Head, start: BondState, *, overwrite: bool) -> Output:
    """Return the output, locked until the stack unwinds; `start` are the bonds that its run begins with.

    Raises
    ------
    OutputError
        If it exists and is of another run, another process is writing it, or nothing can be written there.
    """
    check_target(path, overwrite=True)
    if path.exists() and not overwrite and not _has_parts(path) and not _holds(path, head):
        check_target(path, overwrite=False)
    make_folder(path)
    lock = OutputLock(folder_of(path) / "lock", path)
    leaving = _Leaving(path, lock)
    stack.push(leaving)
    state = _known_state(path, overwrite=overwrite)
    if state is not None and _is_of(path, state):  # killed while it tidied up
        discard(path)
        state = None
    if path.exists() and not overwrite:
        if state is None and _holds(path, head):
            log.info("%s holds this run already, and is complete; nothing is measured.", path)
            return Output(path, head, None, resumed=True, overwrite=overwrite, start=start)
        check_target(path, overwrite=False)
    resumed = state is not None and _may_go_on(path, state, head, overwrite=overwrite)
    if not resumed:
        _clear(path, overwrite=overwrite)
    started = head.provenance.started
    if state is not None and resumed:
        started = state["started"]
        head = replace(head, provenance=replace(head.provenance, started=started))
    finished = _usable_parts(path, state, overwrite=overwrite) if state is not None and resumed else []
    parts = PartsWriter(path, head, started, finished)
    parts.begin()
    leaving.parts = parts
    if resumed and parts.parts:
        log.info("%s: going on behind step %d, which an earlier run has reached.", path, parts.parts[-1].next_step - 1)
    return Output(path, head, parts, resumed, overwrite, start)


@dataclass(slots=True)
class _Leaving:
    """Lets go of an output; where nothing is left to go on with, the directory of its parts goes too."""

    path: Path
    lock: OutputLock
    parts: PartsWriter | None = None

    def __enter__(self) -> None:
        return

    def __exit__(self, _: type[BaseException] | None, error: BaseException | None, __: object) -> None:
        folder = folder_of(self.path)
        has_state, has_parts = (folder / "state.json").exists(), any(folder.glob("part-*.h5"))
        if has_state and self.parts is not None and error is not None:
            with suppress(OutputError):  # often it is the error: the disk is full
                self.parts.note_end("failed", str(error) or type(error).__name__)
            has_state = self.parts.is_measuring
        if not has_parts and not has_state:
            remove_folder(self.path)  # with the lock in it
        self.lock.release()


def _may_go_on(path: Path, state: dict[str, object], head: Head, *, overwrite: bool) -> bool:
    """Return whether an unfinished run is this one; False where it may be replaced.

    Raises
    ------
    OutputError
        If it is another one, and may not be replaced: names what differs.
    """
    found = list(differences(state, head.identity()))
    if not head.provenance.inputs:
        found.append("it is read from an object in memory, which cannot be recognised")
    if not found:
        return True
    if overwrite:
        return False
    raise OutputError(
        f"{folder_of(path)} holds an unfinished run that is not this one: {'; '.join(found)}. Give the earlier values "
        "to go on with it, --overwrite to begin again, or another output."
    )


def _clear(path: Path, *, overwrite: bool) -> None:
    if not overwrite and any(folder_of(path).glob("part-*.h5")):
        raise OutputError(
            f"{folder_of(path)} holds parts of a run that cannot be read; restore them, or give --overwrite to begin "
            "again."
        )
    discard(path)


def _has_parts(path: Path) -> bool:
    """Return whether something is left of a run that has not ended."""
    folder = folder_of(path)
    return (folder / "state.json").exists() or any(folder.glob("part-*.h5"))


def _known_state(path: Path, *, overwrite: bool) -> dict[str, Any] | None:
    """Return what is known of an unfinished run: from its state file, or where that is lost or damaged from its parts.

    Raises
    ------
    OutputError
        If the state file is of another version of its format, and may not be replaced.
    """
    try:
        state = read_state(path)
    except DamagedStateError as error:
        state = state_of_parts(path)
        log.warning(
            "%s %s", error, "The parts say what it said." if state else "There are no parts; the run begins again."
        )
        return state
    except OutputError:
        if overwrite:
            return None
        raise
    return state_of_parts(path) if state is None else state


def _usable_parts(path: Path, state: dict[str, Any], *, overwrite: bool) -> list[Part]:
    """Return the parts to go on behind: all of them, or with `overwrite` those in front of one that is lost or damaged.

    Raises
    ------
    OutputError
        If one is lost or damaged, and may not be replaced.
    """
    try:
        parts = finished_parts(path)
        _check_all_there(path, state, parts)
        return parts
    except OutputError as error:
        if not overwrite:
            raise
        parts = sound_parts(path)
        begin = f"The run goes on behind step {parts[-1].next_step - 1}." if parts else "The run begins again."
        log.warning("%s %s", error, begin)
    sound = {part.path for part in parts}
    for other in folder_of(path).glob("part-*.h5"):
        if other not in sound:
            other.unlink()
    return parts


def _check_all_there(path: Path, state: dict[str, Any], parts: list[Part]) -> None:
    there = {part.path.name for part in parts}
    for entry in state["parts"]:
        if entry["name"] not in there:
            raise OutputError(
                f"{folder_of(path) / entry['name']} is missing; restore it, or give --overwrite to go on in front of "
                "it."
            )


def _identity_of(path: Path) -> dict[str, object] | None:
    """Return what a complete results file was made from; None where it is none."""
    try:
        found = read_results(path, columns=())
    except InputError:
        return None
    if not found.complete:
        return None
    inputs, version = found.provenance["inputs"], found.provenance["versions"].get("mdtopo")
    return {"version": version, "config": found.config, "request": found.request, "inputs": inputs}


def _holds(path: Path, head: Head) -> bool:
    """Return whether a results file is complete and is of this very run."""
    stored = _identity_of(path)
    return stored is not None and bool(stored["inputs"]) and _same(stored, head.identity())


def _is_of(path: Path, state: dict[str, object]) -> bool:
    """Return whether a results file is of the very run that a state file is of, not of one before that it replaces."""
    if not path.exists():
        return False
    try:
        found = read_results(path, columns=())
    except InputError:
        return False
    return found.complete and bool(found.provenance["started"] == state["started"])


def _same(stored: dict[str, object], asked: dict[str, object]) -> bool:
    return not any(differences({**stored, "version": asked["version"]}, asked))
