"""Reading an output that is still being written: its finished parts, as if they were one results file."""

import os
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from mdtopo.errors import InputError
from mdtopo.records import Crossings
from mdtopo.store.parts import folder_of
from mdtopo.store.reader import Results, read_results


def read_running(out: str | os.PathLike[str], *, columns: Collection[str] | None = None) -> Results:
    """Return what the finished parts of an unfinished output hold, marked as `in_progress`.

    Parameters
    ----------
    out : path
        The output, as it was named to the run that writes it, or wrote it until it was stopped.
    columns : collection of str, optional
        As for `read_results`.

    Raises
    ------
    InputError
        If no part is finished, or one is damaged.
    """
    paths = sorted(folder_of(Path(out)).glob("part-*.h5"))
    if not paths:
        raise InputError(f"{out} has no finished part yet; wait for the run, or start it.")
    parts = [read_results(path, columns=columns) for path in paths]
    first, last = parts[0], parts[-1]
    bonds = None if first.bonds is None or last.bonds is None else (first.bonds[0], last.bonds[1])
    return replace(
        first,
        complete=False,
        steps={name: np.concatenate([part.steps[name] for part in parts]) for name in first.steps},
        crossings=Crossings.joined([part.crossings for part in parts]),
        alerts=tuple(alert for part in parts for alert in part.alerts),
        broken=tuple(edge for k, part in enumerate(parts) for edge in part.broken if k == 0 or edge.step >= 0),
        bonds=bonds,
        in_progress=True,
    )
