"""How far the run of an output has come, as anybody can see who looks at its files: begun, running, ended and how."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import zip_longest
from pathlib import Path

import h5py

from mdtopo.errors import InputError, MissingFileError
from mdtopo.records import StepTable
from mdtopo.store.lock import is_held
from mdtopo.store.parts import folder_of, read_state
from mdtopo.store.reader import Results, opened_results, read_results
from mdtopo.store.tables import stored_tables


class Stage(Enum):
    """What a run is doing, or how it has ended."""

    NOT_BEGUN = "not begun"
    RUNNING = "running"
    COMPLETE = "complete"
    STOPPED_EARLY = "stopped early"
    PUT_DOWN = "put down"
    FAILED = "failed"
    KILLED = "killed"


@dataclass(frozen=True, slots=True)
class Look:
    """What one look at an output has found.

    Attributes
    ----------
    stage : Stage
        Complete and stopped early are those whose results file is there.
    started : str
        When the run was first begun: tells it from others of the same output. Empty where there is none.
    n_steps : int
        How many steps are safe in finished parts, as the state file says; 0 where there is a results file instead.
    reason : str
        Why it was put down or has failed, in words; empty where nobody has written that down.
    """

    stage: Stage
    started: str = ""
    n_steps: int = 0
    reason: str = ""

    @property
    def has_results(self) -> bool:
        """Whether the results file is there, and nothing more will come."""
        return self.stage in (Stage.COMPLETE, Stage.STOPPED_EARLY)

    @property
    def has_ended(self) -> bool:
        """Whether nobody is writing any more."""
        return self.stage not in (Stage.NOT_BEGUN, Stage.RUNNING)


def is_output(path: Path) -> bool:
    """Return whether a name is that of a run's output, finished or not; by its ending where nothing else tells."""
    if folder_of(path).is_dir() or path.suffix in (".h5", ".hdf5"):
        return True
    try:
        with opened_results(path):
            return True
    except InputError:
        return False


def look_at(out: Path) -> Look:
    """Return what the files of an output say of its run.

    Raises
    ------
    InputError
        If the results file is there and cannot be read.
    OutputError
        If the state file cannot be understood.
    """
    lock = folder_of(out) / "lock"
    held = is_held(lock)  # first: whoever ends now has left all behind that is read below
    state = read_state(out)
    found = _finished(out)
    if found is not None and (state is None or state["started"] == found.started):
        return found
    if state is None:
        return Look(Stage.NOT_BEGUN)
    silent = Stage.KILLED if lock.exists() else Stage.FAILED  # a full disk may have taken the words, not the way out
    ended = state.get("ended") or {"kind": silent.value, "reason": ""}
    stage = Stage.RUNNING if held else Stage(ended["kind"])
    return Look(stage, state["started"], state["next_step"], "" if held else ended["reason"])


def _finished(out: Path) -> Look | None:
    try:
        with opened_results(out) as file:
            return _look_into(file)
    except MissingFileError:
        return None


def _look_into(file: h5py.File) -> Look:
    started = json.loads(file.attrs["provenance"])["started"]
    if file.attrs["complete"]:
        return Look(Stage.COMPLETE, started)
    return Look(
        Stage.STOPPED_EARLY, started, reason=str(json.loads(file.attrs.get("summary", "{}")).get("stopped", ""))
    )


def tables_behind(out: Path, step: int, look: Look) -> Iterator[StepTable]:
    """Yield what has been made safe of the steps from `step` on, in order.

    Raises
    ------
    InputError
        If a file is missing or damaged; also where the run ends at this moment, and its parts go: look again then.
    """
    if look.has_results:
        yield from stored_tables(out, first_step=step)
        return
    paths = sorted(folder_of(out).glob("part-*.h5"))
    for path, following in zip_longest(paths, paths[1:]):
        if following is not None and _first_step(following) <= step:
            continue
        for table in stored_tables(path, first_step=step):
            if table.first_step != step:
                raise InputError(f"{path} begins with step {table.first_step} where step {step} belongs.")
            step += len(table)
            yield table


def _first_step(part: Path) -> int:
    return int(part.stem.removeprefix("part-"))


def head_of(out: Path, look: Look) -> Results | None:
    """Return settings and strands of a run; None where no part is finished yet. Raises as `tables_behind`."""
    if look.has_results:
        return read_results(out, columns=())
    part = next(iter(sorted(folder_of(out).glob("part-*.h5"))), None)
    return None if part is None else read_results(part, columns=())
