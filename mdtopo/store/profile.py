"""The group /profile of a results file: how close every vertex came, window by window."""

import math
from dataclasses import replace
from typing import NamedTuple

import h5py
import numpy as np

from mdtopo.records import Profile
from mdtopo.records.profile import MOST_VALUES
from mdtopo.store.columns import create_column, extend_packed
from mdtopo.store.packing import packed_chunks
from mdtopo.store.schema import PROFILE, Layout

CHUNK_VALUES = 262_144
"""Values of a chunk, 1 MiB: whole windows, as many as fit."""

MOST_ROWS = 4096


class ProfileColumns:
    """The datasets of /profile, and the rows, which are written at the end: only then is known how long a window is."""

    def __init__(self, group: h5py.Group, n_vertices: int) -> None:
        self._group = group
        self._kept = Profile.none(n_vertices)
        self._held: list[Profile] = []
        self._n_held = 0
        self._packed: dict[str, _Packed] = {}

    def append(self, profile: Profile) -> None:
        """Take some rows."""
        if not len(profile):
            return
        self._held.append(profile)
        self._n_held += profile.clearance.size + len(profile)
        if self._n_held > max(CHUNK_VALUES, self._kept.clearance.size):
            self._gather()

    def _gather(self) -> None:
        self._kept = Profile.joined([self._kept, *self._held]).within(MOST_VALUES)
        self._held, self._n_held = [], 0

    def pack(self) -> None:
        """Compress all rows, which touches no file: another thread may do it while other columns are written."""
        self._gather()
        for name, layout in PROFILE.items():
            values = np.ascontiguousarray(getattr(self._kept, name), layout.dtype)
            width = values.shape[1:]
            chunk_rows = max(1, min(MOST_ROWS, CHUNK_VALUES // math.prod(width)))
            chunks = packed_chunks(values, chunk_rows)
            self._packed[name] = _Packed(replace(layout, row_shape=width), chunk_rows, len(values), chunks)

    def flush(self) -> None:
        """Write all rows, once; they have been packed."""
        self._group.attrs["window_frames"] = self._kept.window_frames
        for name, p in self._packed.items():
            extend_packed(create_column(self._group, name, p.layout, p.chunk_rows), p.n_rows, p.chunks)


class _Packed(NamedTuple):
    """A column that is ready to be written."""

    layout: Layout
    chunk_rows: int
    n_rows: int
    chunks: list[bytes]


def stored_profile(group: h5py.Group) -> Profile:
    """Return the profile of a results file."""
    return Profile(int(group.attrs["window_frames"]), **{name: group[name][()] for name in PROFILE})
