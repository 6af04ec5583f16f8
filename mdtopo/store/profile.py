"""The group /profile of a results file: how close every vertex came, window by window."""

import math
from dataclasses import replace

import h5py
import numpy as np

from mdtopo.records import Profile
from mdtopo.records.profile import MOST_VALUES
from mdtopo.store.columns import create_column, extend
from mdtopo.store.schema import PROFILE

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

    def flush(self) -> None:
        """Write all rows, once."""
        self._gather()
        kept = self._kept
        self._group.attrs["window_frames"] = kept.window_frames
        for name, layout in PROFILE.items():
            values = np.asarray(getattr(kept, name), layout.dtype)
            width = values.shape[1:]
            rows = max(1, min(MOST_ROWS, CHUNK_VALUES // math.prod(width)))
            extend(create_column(self._group, name, replace(layout, row_shape=width), rows), values)


def stored_profile(group: h5py.Group) -> Profile:
    """Return the profile of a results file."""
    return Profile(int(group.attrs["window_frames"]), **{name: group[name][()] for name in PROFILE})
