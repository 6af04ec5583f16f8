"""Where along the strands, and when, was it close? The profile of a run as a map of as many cells as a screen shows.

Windows and vertices are gathered until they fit, and a cell keeps the least of what it holds, with its step and vertex:
nothing is left out, so that no crossing can vanish.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.records import Profile
from mdtopo.report.rundata import RunData
from mdtopo.report.views import packed
from mdtopo.typing import Indices

MOST_COLUMNS, MOST_ROWS = 300, 200
"""Cells of a map: 60 000 of them take 0.8 MB of a page that stays below 8."""

MOST_LABELS, MOST_BOUNDARIES, MOST_CLOSEST = 10_000, 60, 8
"""Vertices that are called by their names in the map, strands whose ends are drawn, and places that are listed."""


@dataclass(frozen=True, slots=True, eq=False)
class HeatMap:
    """Least clearances by place and time.

    Attributes
    ----------
    edges : ndarray, shape (n_columns + 1,)
        Where the columns begin and end: times in ps, or steps where the trajectory holds no times.
    starts : ndarray of int, shape (n_rows,)
        The first vertex of each row.
    clearance : ndarray of float32, shape (n_rows, n_columns)
        The least of each cell, Å; NaN where nothing was measured, or no vertex has a pair.
    step, vertex : ndarray of int, shape (n_rows, n_columns)
        Where the least is; -1 where there is none.
    windows, vertices : int
        How many of them a column, and a row, holds; the last may hold fewer.
    window_steps : int
        Steps of a window.
    """

    edges: NDArray[np.float64]
    starts: Indices
    clearance: NDArray[np.float32]
    step: Indices
    vertex: Indices
    windows: int
    vertices: int
    window_steps: int

    def strip(self) -> tuple[NDArray[np.float32], Indices, Indices]:
        """Return the least clearance of each row over the run, its step and its vertex; NaN and -1 where none is."""
        filled = np.where(np.isnan(self.clearance), np.float32(np.inf), self.clearance)
        column, rows = filled.argmin(axis=1), np.arange(len(filled))
        return self.clearance[rows, column], self.step[rows, column], self.vertex[rows, column]


def heat_map(run: RunData) -> HeatMap | None:
    """Return the map of a run; None where its file holds no profile."""
    profile = run.results.profile
    if profile is None or not len(profile) or not run.n_steps:
        return None
    frames = run.columns["frame_t0"]
    windows = np.arange(frames[0] // profile.window_frames, frames[-1] // profile.window_frames + 1)
    begins = np.maximum(np.searchsorted(frames, windows * profile.window_frames), 0)
    per_column, per_row = -(-len(windows) // MOST_COLUMNS), -(-profile.clearance.shape[1] // MOST_ROWS)
    if run.has_times:
        edges = np.append(run.columns["time_t0"][begins[::per_column]], run.columns["time_t1"][-1])
    else:
        edges = run.results.first_step + np.append(begins[::per_column], run.n_steps).astype(np.float64)
    starts = np.arange(0, profile.clearance.shape[1], per_row)
    cells = _cells(profile, (profile.window - windows[0]) // per_column, len(edges) - 1, starts)
    stride = int(run.columns["frame_t1"][0] - frames[0])
    return HeatMap(edges, starts, *cells, per_column, per_row, profile.window_frames // stride)


def _cells(
    profile: Profile, column: Indices, n_columns: int, starts: Indices
) -> tuple[NDArray[np.float32], Indices, Indices]:
    """Return the least clearance, its step and its vertex in each cell; of equals the first vertex, then step."""
    shape = len(starts), n_columns
    least = np.full(shape, np.nan, dtype=np.float32)
    step, vertex = np.full(shape, -1, dtype=np.int64), np.full(shape, -1, dtype=np.int64)
    bounds = np.searchsorted(column, np.arange(n_columns + 1))
    n_vertices = profile.clearance.shape[1]
    ends = np.append(starts[1:], n_vertices)
    for k in np.flatnonzero(np.diff(bounds)):
        values = profile.clearance[bounds[k] : bounds[k + 1]]
        filled = np.where(np.isnan(values), np.float32(np.inf), values)
        row = filled.argmin(axis=0)
        best = filled[row, np.arange(n_vertices)]
        of_row = np.minimum.reduceat(best, starts)
        holds = np.flatnonzero(best == np.repeat(of_row, ends - starts))
        found = holds[np.searchsorted(holds, starts)]  # the first of each row
        known = np.isfinite(of_row)
        least[known, k] = of_row[known]
        vertex[known, k] = found[known]
        step[known, k] = profile.step[bounds[k] + row[found[known]]]
    return least, step, vertex


def closest_places(run: RunData) -> list[dict[str, Any]]:
    """Return where the run came closest: the vertices that share their least clearance and its step, closest first."""
    profile = run.results.profile
    if profile is None or not len(profile):
        return []
    filled = np.where(np.isnan(profile.clearance), np.float32(np.inf), profile.clearance)
    row = filled.argmin(axis=0)
    least, steps = filled[row, np.arange(len(row))], profile.step[row]
    strands, groups = run.results.strands, dict[tuple[float, int], list[int]]()
    for vertex in np.lexsort((np.arange(len(row)), steps, least)).tolist():
        key = float(least[vertex]), int(steps[vertex])
        if not np.isfinite(key[0]) or (key not in groups and len(groups) == MOST_CLOSEST):
            break
        groups.setdefault(key, []).append(vertex)
    return [
        {
            "labels": [strands.labels.text(vertex) for vertex in vertices[:MOST_CLOSEST]],
            "n_more": max(0, len(vertices) - MOST_CLOSEST),
            "strands": list(dict.fromkeys(strands.names[s] for s in strands.strand_of_vertex[vertices]))[:MOST_CLOSEST],
            "clearance": clearance,
            "step": step,
            "time": float(run.columns["time_t0"][run.row(step)]) if run.has_times else None,
        }
        for (clearance, step), vertices in groups.items()
    ]


def heat_data(run: RunData, heat: HeatMap | None, scale: float) -> dict[str, Any] | None:
    """Return what the script draws, ready for JSON; times are divided by `scale`."""
    if heat is None:
        return None
    strands = run.results.strands
    n, labels = strands.n_vertices, strands.labels
    clearance, step, vertex = heat.strip()
    return {
        "x": packed(heat.edges / (scale if run.has_times else 1.0), "<f8"),
        "y": packed(np.append(heat.starts, n), "<i4"),
        "clearance": packed(heat.clearance, "<f4"),
        "step": packed(heat.step, "<i4"),
        "offset": packed(np.where(heat.vertex < 0, 0, heat.vertex - heat.starts[:, np.newaxis]), "<u2"),
        "strip": {
            "clearance": packed(clearance, "<f4"),
            "step": packed(step, "<i4"),
            "vertex": packed(vertex, "<i4"),
        },
        "labels": [labels.text(v) for v in range(n)] if n <= MOST_LABELS else [],
        "strands": list(strands.names) if strands.n_strands <= MOST_BOUNDARIES else [],
        "offsets": strands.offsets.tolist() if strands.n_strands <= MOST_BOUNDARIES else [],
    }
