"""Ends runs at random moments, goes on with them, and compares what comes out with an uninterrupted run.

``python kill_runs.py FOLDER HOW COUNT SEED [INPUT ...]`` prints what it did as JSON. HOW is ``kill`` (SIGKILL),
``term`` (SIGTERM), ``full`` (no file may grow beyond a random size) or ``tmpfs`` (the folder, which is a small file
system of its own, has a random number of bytes left). Children are forked from a process that has everything loaded,
so that the moments fall into the run and not into its imports.

In what is printed, ``ended`` counts runs that were ended before they were done, ``late`` signals that found theirs
done, ``equal`` the outputs that in the end were those of the uninterrupted run, of ``chains``. ``parts_safe`` says how
many parts were finished when runs were ended, and how often.
"""

import hashlib
import json
import os
import random
import resource
import select
import shutil
import signal
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from mdtopo.cli import main

PART_STEPS = 20
MOST_ENDS = 6
"""How often one output is ended; else most ends would find it all but done."""

ENDED = {"kill": (-9,), "term": (75, -15), "full": (4,), "tmpfs": (4,)}
"""Exit codes of a run that was ended; SIGTERM before the first block has its own."""


def write_input(path: Path, n_frames: int = 240) -> Path:
    """Write strands that jiggle, come near each other and cross, an edge that breaks, and a damaged frame."""
    rng = np.random.default_rng(3)
    rest = np.zeros((19, 3))
    rest[:8, 0] = 1.5 * np.arange(8)
    angle = np.arange(6) * np.pi / 3
    rest[8:14] = np.stack([5 + 1.5 * np.cos(angle), 1.5 * np.sin(angle), 3 + 0 * angle], axis=1)
    rest[14:, 1], rest[14:, 2] = 1.5 * np.arange(5), -0.8
    frames = rest + np.cumsum(rng.normal(0, 0.03, (n_frames, 19, 3)), axis=0)
    frames[:, 14:, 2] += 1.6 * np.sin(np.arange(n_frames) / 15.0)[:, np.newaxis]
    frames[:, 4:8, 0] += 1.2 * np.clip(np.arange(n_frames) - 100, 0, 4)[:, np.newaxis]
    frames[30, 2, 1] = np.nan
    offsets, closed = np.array([0, 8, 14, 19]), np.array([False, True, False])
    np.savez(path, positions=frames, offsets=offsets, closed=closed, time=0.5 * np.arange(n_frames))
    return path


def leave_free(folder: Path, free: int | None) -> None:
    """Fill the file system of a folder up to a number of bytes; None empties it again."""
    filler = folder / "filler"
    filler.unlink(missing_ok=True)
    if free is not None:
        left = os.statvfs(folder)
        filler.write_bytes(bytes(max(left.f_bavail * left.f_frsize - free, 0)))


def command(inputs: list[str], out: Path) -> list[str]:
    alerts = str(out.with_suffix(".jsonl"))
    short = ["--threads", "2", "--block-steps", "4", "--part-steps", str(PART_STEPS)]
    return ["monitor", *inputs, "-o", str(out), "--alerts", alerts, "-q", *short]


def start(words: list[str], limit: int | None = None) -> int:
    """Run the command in a child, and return its process id."""
    child = os.fork()
    if child:
        return child
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    if limit is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    os._exit(main(words))


def contents(path: Path) -> dict[str, Any]:
    """Return every dataset and attribute of a file, but the times of its provenance."""
    found: dict[str, Any] = {}

    def note(name: str, item: Any) -> None:
        for key, value in item.attrs.items():
            found[f"{name}@{key}"] = value if isinstance(value, str) else np.asarray(value).tobytes()
        if isinstance(item, h5py.Dataset):
            values = item[()]
            data = values.tolist() if item.dtype.kind == "O" else values.tobytes()
            found[name] = (str(item.dtype), item.shape, data)

    with h5py.File(path, "r", locking=False) as file:
        note("", file)
        file.visititems(note)
    provenance = json.loads(found["@provenance"])
    del provenance["started"], provenance["ended"]
    provenance["argv"] = []
    found["@provenance"] = json.dumps(provenance)
    return found


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("part-*.h5")}


class Chain:
    """One output: begun, ended, gone on with, until it is finished."""

    def __init__(self, folder: Path, inputs: list[str], reference: Path) -> None:
        self.out = folder / "run.h5"
        self.parts = folder / "run.h5.parts"
        self.words = command(inputs, self.out)
        self.reference = reference
        self.lost = self.n_ended = 0
        self._before: dict[str, str] = {}

    @property
    def n_parts(self) -> int:
        """How many parts are finished."""
        return len(self._before)

    def look(self) -> bool:
        """Count parts that were lost; return whether the run is finished."""
        finished = self.out.exists()
        now = digests(self.parts) if self.parts.exists() else {}
        if not finished:
            self.lost += sum(now.get(name) != digest for name, digest in self._before.items())
        self._before = now
        return finished

    def is_equal(self) -> bool:
        alerts, expected = self.out.with_suffix(".jsonl"), self.reference.with_suffix(".jsonl")
        same = contents(self.out) == contents(self.reference) and alerts.read_bytes() == expected.read_bytes()
        ids = [json.loads(line)["id"] for line in alerts.read_text().splitlines()]
        return same and len(ids) == len(set(ids)) and not self.parts.exists()


def ends_within(child: int, seconds: float) -> bool:
    """Wait so long, or until the child has ended; return whether it has."""
    descriptor = os.pidfd_open(child)
    try:
        return bool(select.select([descriptor], [], [], seconds)[0])
    finally:
        os.close(descriptor)


class Ender:
    """Starts a run, and ends it at a random moment or with a random amount of room."""

    def __init__(self, folder: Path, how: str, seed: int, reference: Path, duration: float) -> None:
        self.folder = folder
        self.how = how
        self.random = random.Random(seed)
        self.duration = duration
        self.size = reference.stat().st_size
        self.n_parts = -(-(len(h5py.File(reference)["steps/verdict"])) // PART_STEPS)

    def run(self, chain: Chain, *, may_end: bool) -> tuple[int, bool]:
        """Return the exit code, and whether a signal was sent."""
        by_signal = may_end and self.how in ("kill", "term")
        limit = self.random.randrange(2_000, self.size) if self.how == "full" and may_end else None
        if self.how == "tmpfs":
            leave_free(self.folder, self.random.randrange(2_000, self._room(chain)) if may_end else None)
        child = start(chain.words, limit)
        if by_signal:
            is_late = ends_within(child, self.random.uniform(0.0, self.duration))
            os.kill(child, signal.SIGKILL if self.how == "kill" else signal.SIGTERM)
            if not chain.n_ended:  # how long a run takes depends on what else the machine does
                self.duration *= 0.8 if is_late else 1.05
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), by_signal

    def _room(self, chain: Chain) -> int:
        """Return what is left to be written: parts, and the results file."""
        return (2 + self.n_parts - chain.n_parts) * self.size


def uninterrupted(folder: Path, inputs: list[str]) -> tuple[Path, float]:
    """Return the results of a run that nobody ends, and how long it took once all was loaded."""
    reference = folder / "reference" / "run.h5"
    for _ in range(2):
        shutil.rmtree(reference.parent, ignore_errors=True)
        reference.parent.mkdir(parents=True)
        began = time.perf_counter()
        assert main(command(inputs, reference)) == 0
    return reference, time.perf_counter() - began


def run(folder: Path, how: str, count: int, seed: int, inputs: list[str]) -> dict[str, Any]:
    reference, duration = uninterrupted(folder, inputs)
    ender = Ender(folder, how, seed, reference, duration)
    done: dict[str, Any] = {"ended": 0, "late": 0, "chains": 0, "equal": 0, "lost_parts": 0, "failed": []}
    codes, safe = Counter[str](), Counter[int]()
    while done["ended"] < count:
        place = folder / f"chain{done['chains']}"
        place.mkdir()
        chain = Chain(place, inputs, reference)
        while True:
            code, was_signalled = ender.run(chain, may_end=done["ended"] < count and chain.n_ended < MOST_ENDS)
            codes[str(code)] += 1
            done["ended"] += code != 0
            done["late"] += code == 0 and was_signalled
            if code not in (0, *ENDED[how]):
                done["failed"].append(code)
                break
            if chain.look() and not chain.parts.exists():
                break
            safe[chain.n_parts] += 1
            chain.n_ended += 1
        done["chains"] += 1
        done["equal"] += chain.is_equal() if chain.out.exists() else 0
        done["lost_parts"] += chain.lost
        shutil.rmtree(place)
    shown = {str(parts): times for parts, times in sorted(safe.items())}
    return {**done, "codes": dict(codes), "parts_safe": shown, "seconds_of_a_run": round(duration, 2)}


if __name__ == "__main__":
    target, method, number, start_seed, *given = sys.argv[1:]
    work = Path(target)
    work.mkdir(parents=True, exist_ok=True)
    files = given or [str(write_input(work / "input.npz"))]
    sys.stdout.write(json.dumps(run(work, method, int(number), int(start_seed), files)) + "\n")
