"""The shard before: with which broken bonds a run begins that goes on behind it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mdtopo.bonds import BondState
from mdtopo.errors import InputError
from mdtopo.readers import Reader
from mdtopo.store import Head
from mdtopo.store.bondstates import bonds_to_mapping
from mdtopo.store.identity import differences
from mdtopo.store.tiling import Shard, comparable, read_shard


def after_shard(path: Path, head: Head, reader: Reader, frames: slice) -> tuple[Head, BondState]:
    """Return the head of a run that begins where a shard ends, and the bonds that it begins with.

    Which bonds they are is kept with what was asked for, so that a run is not gone on with, nor merged, behind others.

    Parameters
    ----------
    path : Path
        Results file of the shard before.
    head : Head
        What the run's own file would begin with.
    reader : Reader
    frames : slice
        Which frames the run analyses.

    Raises
    ------
    InputError
        If the shard is not complete, is of another run, or does not end with the run's first frame.
    """
    shard = read_shard(path)
    _check_run(shard, head)
    _check_frames(shard, reader.n_frames, frames)
    bonds, found = shard.bonds[1], shard.results
    request = {**head.request, "broken_from": bonds_to_mapping(bonds)}
    broken = tuple(edge for edge in found.broken if bonds.broken[_index_of(edge.edge, head)])
    return replace(head, request=request, inherited=broken), bonds


def _index_of(edge: tuple[int, int], head: Head) -> int:
    return int(np.flatnonzero((head.strands.edges == edge).all(axis=1))[0])


def _check_run(shard: Shard, head: Head) -> None:
    found = list(differences(shard.identity(), comparable(head.identity())))
    if not found and not np.array_equal(shard.results.strands.edges, head.strands.edges):
        found.append("it has other strands")
    if found:
        raise InputError(f"{shard.path} of --broken-from is no shard of this run: {'; '.join(found)}.")


def _check_frames(shard: Shard, n_frames: int | None, frames: slice) -> None:
    """Refuse a shard whose last frame is not the first one now: other frames may break, or heal, a bond."""
    stride = frames.step or 1
    first = (frames.start or 0) if n_frames is None else range(n_frames)[frames][0]
    end = shard.frames[1]
    if first != end:
        raise InputError(
            f"{shard.path} of --broken-from ends with frame {end}, and this run begins with frame {first}; shards "
            f"share one frame: give --frames {end}:{'' if frames.stop is None else frames.stop}"
            f"{'' if stride == 1 else f':{stride}'}, or the shard that ends there."
        )
    if shard.stride != stride:
        raise InputError(
            f"{shard.path} of --broken-from has frames that are {shard.stride} apart, and this run has frames that are "
            f"{stride} apart; give --frames the step of the shard before."
        )
