"""Reading an output that is still being written: its finished parts, as if they were one results file."""

import os
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from mdtopo.errors import InputError, MissingFileError
from mdtopo.records import Crossings, Profile
from mdtopo.store.parts import folder_of
from mdtopo.store.reader import Results, read_results


def read_so_far(
    out: str | os.PathLike[str],
    *,
    columns: Collection[str] | None = None,
    optional: Collection[str] = (),
    steps: range | None = None,
    profile: bool | None = None,
) -> Results:
    """Return what a results file holds, or, where the run has not ended and there is none, its finished parts.

    Parameters
    ----------
    out : path
        The output.
    columns, optional, steps, profile
        As for `read_results`.

    Raises
    ------
    MissingFileError
        If there is neither.
    InputError
        As `read_results` and `read_running`.
    """
    try:
        return read_results(out, columns=columns, optional=optional, steps=steps, profile=profile)
    except MissingFileError:
        if not folder_of(Path(out)).is_dir():
            raise
    try:
        return read_running(out, columns=columns, optional=optional, steps=steps, profile=profile)
    except InputError:
        if not Path(out).exists():
            raise
    # the run has ended meanwhile, and its parts are gone
    return read_results(out, columns=columns, optional=optional, steps=steps, profile=profile)


def read_running(
    out: str | os.PathLike[str],
    *,
    columns: Collection[str] | None = None,
    optional: Collection[str] = (),
    steps: range | None = None,
    profile: bool | None = None,
) -> Results:
    """Return what the finished parts of an unfinished output hold, marked as `in_progress`.

    Parameters
    ----------
    out : path
        The output, as it was named to the run that writes it, or wrote it until it was stopped.
    columns, optional, steps, profile
        As for `read_results`.

    Raises
    ------
    InputError
        If no part is finished, or one is missing or damaged.
    """
    paths = sorted(folder_of(Path(out)).glob("part-*.h5"))
    if not paths:
        raise InputError(f"{out} has no finished part yet; wait for the run, or start it.")
    parts = [read_results(path, columns=columns, optional=optional, steps=steps, profile=profile) for path in paths]
    step = 0
    for path, part in zip(paths, parts, strict=True):
        if part.stored.start != step:  # rows would be taken for other steps
            begins = f"{path} begins with step {part.stored.start}"
            raise InputError(f"{begins} where step {step} belongs; a part is missing.")
        step = part.stored.stop
    first, last = parts[0], parts[-1]
    bonds = None if first.bonds is None or last.bonds is None else (first.bonds[0], last.bonds[1])
    profiles = [part.profile for part in parts if part.profile is not None]
    return replace(
        first,
        complete=False,
        first_step=next((part.first_step for part in parts if part.n_steps), first.first_step),
        steps={name: np.concatenate([part.steps[name] for part in parts]) for name in first.steps},
        crossings=Crossings.joined([part.crossings for part in parts]),
        curve_crossings=Crossings.joined([part.curve_crossings for part in parts]),
        alerts=tuple(alert for part in parts for alert in part.alerts),
        broken=tuple(edge for k, part in enumerate(parts) for edge in part.broken if k == 0 or edge.step >= 0),
        bonds=bonds,
        in_progress=True,
        stored=range(step),
        profile=Profile.joined(profiles).within() if len(profiles) == len(parts) else None,
    )
