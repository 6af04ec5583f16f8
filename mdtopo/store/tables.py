"""Step tables out of a results file, a piece at a time: what was measured once need not be measured again."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import InputError
from mdtopo.records import BrokenEdge, Crossings, Profile, Shape, StepTable, Strands, Stretches
from mdtopo.store.profile import stored_profile
from mdtopo.store.reader import broken_edges, opened_results, plain_values, stored_strands
from mdtopo.store.schema import CHUNK_ROWS, CROSSINGS, STRETCHES


def stored_tables(
    path: str | os.PathLike[str], *, rows: int = CHUNK_ROWS, first_step: int | None = None
) -> Iterator[StepTable]:
    """Yield the steps of a results file in order, as they were measured, bit for bit.

    Memory does not grow with the file, but for its crossings, stretched edges and problems; a profile is bounded.

    Parameters
    ----------
    path : path
        The file.
    rows : int
        Steps of a table.
    first_step : int, optional
        The step to begin with; by default the file's first one.

    Raises
    ------
    InputError
        If it is no results file, is damaged, or was written by a version that did not store all of a table.
    """
    with opened_results(Path(path)) as file:
        if not {"stretches", "problems", "crossings"} <= set(file) or not _has_all_columns(file["steps"]):
            raise InputError(f"{path} was written by another version of mdtopo, and lacks what this one stores.")
        strands = stored_strands(file["strands"])
        first, n_rows = int(file["steps"].attrs["first_step"]), len(file["steps/verdict"])
        lists = _Lists(file, strands)
        skipped = 0 if first_step is None else max(first_step - first, 0)
        for start in range(skipped, n_rows, rows):
            stop = min(start + rows, n_rows)
            values: dict[str, Any] = lists.between(first + start, first + stop)
            for column in StepTable.columns():
                values[column.name] = plain_values(file["steps"][column.name], slice(start, stop))
            yield StepTable(first_step=first + start, **values)


def _has_all_columns(group: h5py.Group) -> bool:
    return {column.name for column in StepTable.columns()} <= set(group)


class _Lists:
    """What a file holds beside its columns: rows that name their step."""

    def __init__(self, file: h5py.File, strands: Strands) -> None:
        self._strands = strands
        self._crossings = {name: plain_values(file["crossings"][name]) for name in CROSSINGS}
        self._stretches = {name: plain_values(file["stretches"][name]) for name in STRETCHES}
        texts = file["problems/text"].asstr()[()].tolist()
        self._problems = dict(zip(file["problems/step"][()].tolist(), texts, strict=True))
        self._broken: tuple[BrokenEdge, ...] = broken_edges(file["strands"])
        self._profile = stored_profile(file["profile"]) if "profile" in file else Profile.none(strands.n_vertices)

    def between(self, start: int, stop: int) -> dict[str, Any]:
        """Return the fields of a table of the steps from `start` up to `stop`."""
        crossings = Crossings(strands=self._strands, **_rows(self._crossings, start, stop))
        return {
            "stretches": Stretches(**_rows(self._stretches, start, stop)),
            "broken": tuple(edge for edge in self._broken if start <= edge.step < stop),
            "problems": tuple(self._problems.get(step, "") for step in range(start, stop)),
            "crossings": crossings.of(Shape.POLYLINE),
            "curve_crossings": crossings.of(Shape.CURVE),
            "profile": self._profile.between(start, stop),
        }


def _rows(columns: dict[str, NDArray[Any]], start: int, stop: int) -> dict[str, NDArray[Any]]:
    low, high = np.searchsorted(columns["step"], [start, stop])
    return {name: values[low:high] for name, values in columns.items()}
