"""Whether results files are shards of one run: the same input and settings, and every step exactly once."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mdtopo.bonds import BondState
from mdtopo.errors import InputError
from mdtopo.store.identity import HASH, differences
from mdtopo.store.reader import Results, read_results
from mdtopo.typing import JsonObject

OWN = ("frames", "broken_from")
"""What each shard of a run asks for itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Shard:
    """One results file of a range of frames.

    Attributes
    ----------
    path : Path
    results : Results
        With the columns ``frame_t0`` and ``frame_t1`` alone.
    bonds : tuple of BondState
        After its first frame, and after its last one.
    """

    path: Path
    results: Results
    bonds: tuple[BondState, BondState]

    @property
    def frames(self) -> tuple[int, int]:
        """Its first and its last frame."""
        return int(self.results.steps["frame_t0"][0]), int(self.results.steps["frame_t1"][-1])

    @property
    def n_steps(self) -> int:
        """Number of steps."""
        return len(self.results.steps["frame_t0"])

    @property
    def stride(self) -> int:
        """How far apart its analysed frames are."""
        return int(self.results.steps["frame_t1"][0] - self.results.steps["frame_t0"][0])

    def identity(self) -> dict[str, Any]:
        """Return what must be the same in all shards."""
        return comparable(
            {
                "version": self.results.provenance["versions"].get("mdtopo"),
                "config": self.results.config,
                "request": self.results.request,
                "inputs": self.results.provenance["inputs"],
            }
        )


def comparable(identity: JsonObject) -> dict[str, Any]:
    """Return of the identity of a run what its shards have in common: not their frames, nor how they begin."""
    request = {name: value for name, value in identity["request"].items() if name not in OWN}
    return {**identity, "request": request}


def read_shard(path: Path) -> Shard:
    """Return a shard.

    Raises
    ------
    InputError
        If it is no complete results file with steps, or was written by a version that kept no bonds.
    """
    found = read_results(path, columns=("frame_t0", "frame_t1"))
    if not found.complete:
        raise InputError(f"{path} is not complete; run its command again before it is merged.")
    if not len(found.steps["frame_t0"]):
        raise InputError(f"{path} holds no step; leave it out.")
    if found.bonds is None:
        raise InputError(f"{path} was written by an older mdtopo, which did not say which bonds break; redo it.")
    return Shard(path, found, found.bonds)


def in_order(shards: Sequence[Shard]) -> list[Shard]:
    """Return the shards of one run in order.

    Raises
    ------
    InputError
        If they are of different runs (says what differs), or do not hold every step from the first to the last exactly
        once (says which frames are missing or doubled).
    """
    ordered = sorted(shards, key=lambda shard: shard.frames)
    first = ordered[0]
    for shard in ordered[1:]:
        _refuse_other_files(first, shard)
        found = list(differences(first.identity(), shard.identity()))
        if found:
            raise InputError(f"{shard.path} is no shard of the run that {first.path} is of: {'; '.join(found)}.")
    strides = {shard.stride for shard in ordered}
    if len(strides) > 1:
        words = " and ".join(map(str, sorted(strides)))
        raise InputError(f"The shards have frames that are {words} apart; merge those of one kind.")
    for before, after in pairwise(ordered):
        end, start = before.frames[1], after.frames[0]
        if end < start:
            raise InputError(
                f"The steps between the frames {end} and {start} are missing: {before.path} ends with the one, and "
                f"{after.path} begins with the other. Shards share one frame; make the shard --frames "
                f"{end}:{start + 1}."
            )
        if end > start:
            last = min(end, after.frames[1])
            raise InputError(
                f"The steps between the frames {start} and {last} are doubled: they are in {before.path} and in "
                f"{after.path}. Leave one out, or cut them so that they share one frame."
            )
    return ordered


def _refuse_other_files(first: Shard, shard: Shard) -> None:
    """Refuse shards whose files have other names and other content: those are two trajectories, not a changed one.

    Files of one content may lie elsewhere; files of one name that differ are said by `differences`.
    """
    one, other = first.results.provenance["inputs"], shard.results.provenance["inputs"]
    for its, own in zip(one, other, strict=False):
        if its["path"] != own["path"] and (its["size"], its[HASH]) != (own["size"], own[HASH]):
            raise InputError(
                f"{shard.path} is no shard of the run that {first.path} is of: {first.path} is of {its['path']}, and "
                f"{shard.path} of {own['path']}, which is another file."
            )


def same_bonds(one: BondState, other: BondState) -> bool:
    """Return whether two states are equal: who goes on from one goes on from the other."""
    return bool(np.array_equal(one.broken, other.broken) and np.array_equal(one.streak, other.streak))
