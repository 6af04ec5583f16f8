"""Strands, and the polylines of their curves, as VTKHDF 2: a line for each trace, a time step for each snapshot."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import h5py
import numpy as np

from mdtopo.export.curves import CurveSnapshot
from mdtopo.export.polydata import Columns, Moment, write_polydata
from mdtopo.export.snapshots import Snapshot
from mdtopo.records import Strands, Traces
from mdtopo.typing import Flags, Indices

STRAND_COLUMNS: Columns = {
    "clearance": np.float64,
    "closest": np.uint8,
    "strand": np.int64,
    "verdict": np.int8,
    "proved": np.uint8,
}

CURVE_COLUMNS: Columns = {
    "strand": np.int64,
    "parameter": np.float64,
    "isotopic": np.uint8,
    "chord_error": np.float64,
    "polyline_clearance": np.float64,
}


def write_vtkhdf(
    path: Path, strands: Strands, traces: Traces, snapshots: Iterable[Snapshot], remarks: list[str]
) -> int:
    """Write a VTKHDF file of strands, a snapshot at a time, and return their number.

    Notes
    -----
    Point data: ``clearance`` (Å, how close the edges of the vertex come to any other in the step that begins there, at
    least; 0 where they cross or nothing is proved, NaN where the step was not measured or there is no pair),
    ``closest`` (1 at the pair that holds it), ``strand``, ``verdict`` (-1 where no step begins), ``proved`` (0 for a
    moment of a step that is not certified). Where the trajectory holds no time, the value of a step is its number.
    """
    lines = closed_lines(traces.vertices, traces.offsets, traces.closed)

    def moments() -> Iterator[Moment]:
        """Yield what is written of each snapshot."""
        for snapshot in snapshots:
            data = {
                "clearance": snapshot.clearance,
                "closest": snapshot.closest,
                "strand": strands.strand_of_vertex,
                "verdict": snapshot.verdict,
                "proved": snapshot.is_proved,
            }
            yield Moment(snapshot.time, snapshot.positions, lines, data)

    with h5py.File(path, "w", track_order=True) as file:
        file.attrs["mdtopo"] = "\n".join(remarks)
        return write_polydata(file, moments(), STRAND_COLUMNS)


def write_curve_vtkhdf(path: Path, snapshots: Iterable[CurveSnapshot], remarks: list[str]) -> int:
    """Write a VTKHDF file of curves, a snapshot at a time, and return their number.

    Notes
    -----
    Point data: ``strand``, ``parameter`` (where on the curve the point lies, from 0 to 1; a spline gives every edge an
    equal share), ``isotopic`` (1 where the polyline of that time is proved to be isotopic to its curve, 0
    where this is not known), ``chord_error`` (Å, how far the curve is from the polyline at most), and
    ``polyline_clearance`` (Å, the ``clearance`` of the strands' vertices, the lower of the two between which the point
    lies: proved for straight edges in the step that begins there, not for the curve).
    """

    def moments() -> Iterator[Moment]:
        """Yield what is written of each snapshot."""
        for snapshot in snapshots:
            everything = np.arange(len(snapshot.positions), dtype=np.int64)
            data = {
                "strand": snapshot.strand,
                "parameter": snapshot.parameter,
                "isotopic": snapshot.is_isotopic,
                "chord_error": snapshot.chord_error,
                "polyline_clearance": snapshot.polyline_clearance,
            }
            lines = closed_lines(everything, snapshot.offsets, snapshot.closed)
            yield Moment(snapshot.time, snapshot.positions, lines, data)

    with h5py.File(path, "w", track_order=True) as file:
        file.attrs["mdtopo"] = "\n".join(remarks)
        return write_polydata(file, moments(), CURVE_COLUMNS)


def closed_lines(vertices: Indices, offsets: Indices, closed: Flags) -> tuple[Indices, ...]:
    """Return the vertices that each trace visits; a ring comes back to its first one."""
    lines = []
    for k, ring in enumerate(closed):
        visited = vertices[offsets[k] : offsets[k + 1]]
        lines.append(np.append(visited, visited[0]) if ring else visited)
    return tuple(lines)
