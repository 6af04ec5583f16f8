"""Strands as VTKHDF 2: a PolyData with one line for each trace and a time step for each snapshot."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from mdtopo.export.snapshots import Snapshot
from mdtopo.records import Strands, Traces

VERSION = (2, 2)
CELLS = ("Vertices", "Lines", "Polygons", "Strips")


def write_vtkhdf(
    path: Path, strands: Strands, traces: Traces, snapshots: Iterable[Snapshot], remarks: list[str]
) -> int:
    """Write a VTKHDF file, a snapshot at a time, and return their number.

    Notes
    -----
    VTKHDF file format, version 2.2, PolyData with steps: the lines are stored once, and every step points at them;
    points and point data are stored step after step. Point data: ``clearance`` (Å, proved for the step that begins
    there, hence for each vertex; NaN where none is), ``closest`` (1 at the pair that holds it), ``strand``,
    ``verdict`` (-1 where no step begins), ``proved`` (0 for a moment of a step that is not certified).
    Where the trajectory holds no time, the value of a step is its number.
    """
    with h5py.File(path, "w", track_order=True) as file:
        root = file.create_group("VTKHDF", track_order=True)
        root.attrs["Version"] = np.array(VERSION, dtype=np.int64)
        root.attrs.create("Type", np.bytes_("PolyData"))
        file.attrs["mdtopo"] = "\n".join(remarks)
        n = strands.n_vertices
        _write_lines(root, traces)
        points = _growing(root, "Points", (3,), np.float64)
        data = {
            name: _growing(root.require_group("PointData"), name, (), dtype)
            for name, dtype in (
                ("clearance", np.float64), ("closest", np.uint8), ("strand", np.int64), ("verdict", np.int8),
                ("proved", np.uint8),
            )
        }  # fmt: skip
        times: list[float] = []
        for snapshot in snapshots:
            _extend(points, snapshot.positions)
            values: dict[str, Any] = {
                "clearance": snapshot.clearance,
                "closest": snapshot.closest,
                "strand": strands.strand_of_vertex,
                "verdict": snapshot.verdict,
                "proved": snapshot.is_proved,
            }
            for name, dataset in data.items():
                _extend(dataset, np.broadcast_to(values[name], (n,)))
            times.append(snapshot.time if np.isfinite(snapshot.time) else float(len(times)))
        root["NumberOfPoints"] = np.full(len(times), n, dtype=np.int64)
        _write_steps(root, times, n, tuple(data))
    return len(times)


def _write_lines(root: h5py.Group, traces: Traces) -> None:
    """Write one line for each trace; a ring comes back to its first vertex."""
    lines = []
    for k, ring in enumerate(traces.closed):
        vertices = traces.vertices[traces.offsets[k] : traces.offsets[k + 1]]
        lines.append(np.append(vertices, vertices[0]) if ring else vertices)
    for kind in CELLS:
        group = root.create_group(kind)
        cells = lines if kind == "Lines" else []
        group["Connectivity"] = np.concatenate([np.empty(0, dtype=np.int64), *cells])
        group["Offsets"] = np.concatenate([[0], np.cumsum([len(cell) for cell in cells])]).astype(np.int64)
        group["NumberOfCells"] = np.array([len(cells)], dtype=np.int64)
        group["NumberOfConnectivityIds"] = np.array([sum(map(len, cells))], dtype=np.int64)


def _write_steps(root: h5py.Group, times: list[float], n: int, names: tuple[str, ...]) -> None:
    steps, count = root.create_group("Steps"), len(times)
    steps.attrs["NSteps"] = np.int64(count)
    steps["Values"] = np.array(times)
    steps["PartOffsets"] = np.zeros(count, dtype=np.int64)
    steps["NumberOfParts"] = np.ones(count, dtype=np.int64)
    offsets = n * np.arange(count, dtype=np.int64)
    steps["PointOffsets"] = offsets
    still = np.zeros((count, len(CELLS)), dtype=np.int64)
    steps["CellOffsets"], steps["ConnectivityIdOffsets"] = still, still
    for name in names:
        steps[f"PointDataOffsets/{name}"] = offsets


def _growing(group: h5py.Group, name: str, row: tuple[int, ...], dtype: type[np.generic]) -> h5py.Dataset:
    shape = (0, *row)
    return group.create_dataset(
        name, shape, maxshape=(None, *row), chunks=(4096, *row), dtype=dtype, compression="gzip"
    )


def _extend(dataset: h5py.Dataset, rows: NDArray[Any]) -> None:
    start = len(dataset)
    dataset.resize(start + len(rows), axis=0)
    dataset[start:] = rows
