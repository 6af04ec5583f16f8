"""Ends runs at random moments, goes on with them, and compares what comes out with an uninterrupted run.

``python kill_runs.py FOLDER HOW COUNT SEED [INPUT ...]`` prints what it did as JSON. HOW is ``kill`` (SIGKILL),
``term`` (SIGTERM) or ``full`` (no file may grow beyond a random size). Children are forked from a process that has
everything loaded, so that the moments fall into the run and not into its imports.
"""

import hashlib
import json
import os
import random
import resource
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from mdtopo.cli import main


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


def command(inputs: list[str], out: Path) -> list[str]:
    alerts = str(out.with_suffix(".jsonl"))
    short = ["--threads", "2", "--block-steps", "4", "--part-steps", "20"]
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
        self.lost = 0
        self._before: dict[str, str] = {}

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


def run(folder: Path, how: str, count: int, seed: int, inputs: list[str]) -> dict[str, Any]:
    rng = random.Random(seed)
    reference = folder / "reference" / "run.h5"
    reference.parent.mkdir(parents=True)
    assert main(command(inputs, reference)) == 0
    shutil.rmtree(reference.parent)
    reference.parent.mkdir()
    began = time.perf_counter()
    assert main(command(inputs, reference)) == 0
    duration, size = time.perf_counter() - began, reference.stat().st_size
    done: dict[str, Any] = {"ended": 0, "codes": {}, "chains": 0, "equal": 0, "lost_parts": 0, "failed": []}
    while done["ended"] < count:
        place = folder / f"chain{done['chains']}"
        place.mkdir()
        chain = Chain(place, inputs, reference)
        while True:
            last = done["ended"] >= count
            limit = rng.randrange(2_000, size) if how == "full" and not last else None
            child = start(chain.words, limit)
            if how != "full" and not last:
                time.sleep(rng.uniform(0.0, duration))
                os.kill(child, signal.SIGKILL if how == "kill" else signal.SIGTERM)
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            done["codes"][str(code)] = done["codes"].get(str(code), 0) + 1
            done["ended"] += code != 0
            if code == 0 or (code < 0 and chain.out.exists() and not chain.parts.exists()):
                chain.look()
                break
            if code not in (-9, -15, 75, 4):
                done["failed"].append(code)
                break
            chain.look()
        done["chains"] += 1
        done["equal"] += chain.is_equal() if chain.out.exists() else 0
        done["lost_parts"] += chain.lost
        shutil.rmtree(place)
    return done


if __name__ == "__main__":
    target, method, number, start_seed, *given = sys.argv[1:]
    work = Path(target)
    work.mkdir(parents=True, exist_ok=True)
    files = given or [str(write_input(work / "input.npz"))]
    sys.stdout.write(json.dumps(run(work, method, int(number), int(start_seed), files)) + "\n")
