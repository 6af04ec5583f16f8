"""A VTKHDF 2 file of one PolyData with time steps, written a step at a time."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import h5py
import numpy as np
from numpy.typing import NDArray

from mdtopo.typing import Indices, Points

VERSION = (2, 2)
Columns: TypeAlias = Mapping[str, type[np.generic]]
"""The type of each point datum by its name."""

CELLS = ("Vertices", "Lines", "Polygons", "Strips")


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Points, lines and point data at one time.

    Attributes
    ----------
    time : float
        ps; where it is not finite, the number of the step stands for it.
    points : ndarray, shape (n, 3)
        Å.
    lines : tuple of ndarray of int
        The points that each line visits. The same tuple as at the time before is not stored again.
    data : mapping of str to array
        Point data: shape (n,), or one value for all points.
    """

    time: float
    points: Points
    lines: tuple[Indices, ...]
    data: Mapping[str, Any]


def write_polydata(file: h5py.File, moments: Iterable[Moment], columns: Columns) -> int:
    """Write the group VTKHDF and return the number of time steps.

    Parameters
    ----------
    file : h5py.File
        Open for writing.
    moments : iterable of Moment
        In the order of their times.
    columns : Columns
        The point data that every moment holds.

    Notes
    -----
    VTKHDF file format, version 2.2. A part is one set of lines; time steps whose lines are the same share it.
    """
    root = file.create_group("VTKHDF", track_order=True)
    root.attrs["Version"] = np.array(VERSION, dtype=np.int64)
    root.attrs.create("Type", np.bytes_("PolyData"))
    points = _growing(root, "Points", (3,), np.float64)
    held = {name: _growing(root.require_group("PointData"), name, (), dtype) for name, dtype in columns.items()}
    times: list[float] = []
    starts: list[int] = []
    parts: list[int] = []
    topology = _Lines(root)
    for moment in moments:
        n = len(moment.points)
        parts.append(topology.part_of(moment.lines, n))
        starts.append(len(points))
        times.append(moment.time if np.isfinite(moment.time) else float(len(times)))
        _extend(points, moment.points)
        for name, dataset in held.items():
            _extend(dataset, np.broadcast_to(moment.data[name], (n,)))
    steps = topology.finish(parts)
    steps.attrs["NSteps"] = np.int64(len(times))
    steps["Values"] = np.array(times)
    steps["PointOffsets"] = np.array(starts, dtype=np.int64)
    for name in columns:
        steps[f"PointDataOffsets/{name}"] = np.array(starts, dtype=np.int64)
    return len(times)


class _Lines:
    """The lines of a file: each new set of them is a part."""

    def __init__(self, root: h5py.Group) -> None:
        self._root = root
        self._groups = {kind: root.create_group(kind) for kind in CELLS}
        for group in self._groups.values():
            _growing(group, "Connectivity", (), np.int64)
            _growing(group, "Offsets", (), np.int64)
        self._latest: tuple[Indices, ...] | None = None
        self._n_points: list[int] = []
        self._n_cells: list[int] = []
        self._n_ids: list[int] = []

    def part_of(self, lines: tuple[Indices, ...], n_points: int) -> int:
        """Return the part that holds these lines; it is written if it is new."""
        if lines is not self._latest:
            self._latest = lines
            ends = np.concatenate([[0], np.cumsum([len(line) for line in lines])]).astype(np.int64)
            for kind, group in self._groups.items():
                _extend(group["Offsets"], ends if kind == "Lines" else ends[:1])
            _extend(self._groups["Lines"]["Connectivity"], np.concatenate([ends[:0], *lines]))
            self._n_points.append(n_points)
            self._n_cells.append(len(lines))
            self._n_ids.append(int(ends[-1]))
        return len(self._n_points) - 1

    def finish(self, parts: list[int]) -> h5py.Group:
        """Write how many there are, and the group Steps with the part of each time step; return that group."""
        n_parts = len(self._n_points)
        part_of_step = np.array(parts, dtype=np.int64)
        steps = self._root.create_group("Steps")
        steps["PartOffsets"] = part_of_step
        steps["NumberOfParts"] = np.ones(len(parts), dtype=np.int64)
        self._root["NumberOfPoints"] = np.array(self._n_points, dtype=np.int64)
        column = CELLS.index("Lines")
        for name, counts, per_step in (
            ("NumberOfCells", self._n_cells, "CellOffsets"),
            ("NumberOfConnectivityIds", self._n_ids, "ConnectivityIdOffsets"),
        ):
            for kind, group in self._groups.items():
                group[name] = np.array(counts if kind == "Lines" else [0] * n_parts, dtype=np.int64)
            before = np.concatenate([[0], np.cumsum(counts)])[:-1].astype(np.int64)
            offsets = np.zeros((len(parts), len(CELLS)), dtype=np.int64)
            offsets[:, column] = before[part_of_step] if len(parts) else 0
            steps[per_step] = offsets
        return steps


def _growing(group: h5py.Group, name: str, row: tuple[int, ...], dtype: type[np.generic]) -> h5py.Dataset:
    shape = (0, *row)
    return group.create_dataset(
        name, shape, maxshape=(None, *row), chunks=(4096, *row), dtype=dtype, compression="gzip"
    )


def _extend(dataset: h5py.Dataset, rows: NDArray[Any]) -> None:
    start = len(dataset)
    dataset.resize(start + len(rows), axis=0)
    dataset[start:] = rows
