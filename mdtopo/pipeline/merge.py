"""Shards of one run, made one: what comes out is what one run over all frames would have written."""

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from mdtopo.errors import InputError
from mdtopo.pipeline.alertfile import AlertFile
from mdtopo.pipeline.assembly import assemble
from mdtopo.records import BrokenEdge, MonitorConfig, RunSummary, StepTable
from mdtopo.store import Head, InputFile, Provenance, collect_provenance, stored_tables
from mdtopo.store.atomic import check_target
from mdtopo.store.tiling import Shard, in_order, read_shard, same_bonds


def merge(
    *shards: str | os.PathLike[str],
    out: str | os.PathLike[str],
    alerts: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    argv: Sequence[str] = (),
) -> RunSummary:
    """Join the results files of ranges of frames to one, and return what the whole run comes to.

    Steps are numbered through, and alerts are raised again from the joined columns, so that an event at a seam is one
    event. Nothing is measured.

    Parameters
    ----------
    *shards : path
        Complete results files, in any order. Neighbours share one frame.
    out : path
        The joined results file.
    alerts : path, optional
        Where the alerts go beside it, as JSON Lines.
    overwrite : bool
        Whether existing files may be replaced.
    argv : sequence of str
        The command line, for the provenance.

    Raises
    ------
    InputError
        If the files are of different runs, do not hold every step exactly once, or if bonds were broken or breaking at
        the end of one that the next one did not know of: says how to redo it.
    OutputError
        If an output exists already, or cannot be written.

    Guarantee
    ---------
    Every column equals that of a single run over the same frames, bit for bit.
    """
    if not shards:
        raise InputError("There is no shard to merge; name the results files.")
    ordered = in_order([read_shard(Path(path)) for path in shards])
    _refuse_unknown_breaks(ordered)
    check_target(Path(out), overwrite=overwrite)
    with ExitStack() as stack:
        alert_file = stack.enter_context(AlertFile(alerts, overwrite=overwrite))
        return joined(ordered, Path(out), _head(ordered, argv), overwrite=overwrite, alert_file=alert_file)


def joined(
    ordered: Sequence[Shard], out: Path, head: Head, *, overwrite: bool, alert_file: AlertFile | None
) -> RunSummary:
    """Write the results file of shards that are in order and know of each other's bonds, and return its summary."""
    bonds = ordered[0].bonds[0], ordered[-1].bonds[1]
    first = ordered[0].results
    inherited = tuple(edge for edge in first.broken if edge.step < 0)
    whole = replace(head, reference=first.reference, inherited=inherited)
    return assemble(out, whole, _tables(ordered), bonds, overwrite=overwrite, alert_file=alert_file)


def _refuse_unknown_breaks(ordered: Sequence[Shard]) -> None:
    for before, after in pairwise(ordered):
        if same_bonds(before.bonds[1], after.bonds[0]):
            continue
        strands, frame = before.results.strands, before.frames[1]
        differing = (before.bonds[1].broken != after.bonds[0].broken) | (
            before.bonds[1].streak != after.bonds[0].streak
        )
        edge = strands.describe_edge(strands.edges[int(np.flatnonzero(differing)[0])])
        raise InputError(
            f"At frame {frame} the edge {edge} is broken, or too long for some frames, which {after.path} did not know "
            f"when it began; what it measured is not what one run would have. Measure it again with --broken-from "
            f"{before.path}."
        )


def _head(ordered: Sequence[Shard], argv: Sequence[str]) -> Head:
    first, last = ordered[0].results, ordered[-1].results
    start, _, step = first.request["frames"]
    request = {**first.request, "frames": [start, last.request["frames"][1], step]}
    now = collect_provenance([], argv=argv, threads=first.provenance["threads"])
    origin: Provenance = replace(
        now,
        inputs=tuple(InputFile(**entry) for entry in first.provenance["inputs"]),
        notes=tuple(first.provenance.get("notes", ())),
        started=min(shard.results.provenance["started"] for shard in ordered),
    )
    return Head(first.strands, MonitorConfig.from_mapping(first.config), origin, request)


def _tables(ordered: Sequence[Shard]) -> Iterator[StepTable]:
    first_step = 0
    for position, shard in enumerate(ordered):
        start = first_step
        for table in stored_tables(shard.path):
            moved = table.moved_to(start + table.first_step)
            yield replace(moved, broken=_own(shard, moved.broken)) if position else moved
            first_step += len(table)


def _own(shard: Shard, broken: Sequence[BrokenEdge]) -> tuple[BrokenEdge, ...]:
    """Leave out edges that were broken at the shard's first frame: the shard before has said so."""
    edges = shard.results.strands.edges[np.flatnonzero(shard.bonds[0].broken)].tolist()
    return tuple(edge for edge in broken if list(edge.edge) not in edges)
