"""How close every vertex came, window by window: small enough for a heat map of a run of any length."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mdtopo.typing import Indices, Lengths

MOST_VALUES = 8_000_000
"""Values of a stored profile, 32 MB before compression. A larger one gets windows twice as long, until it fits."""


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """The clearance of every vertex in one step of each window: the step in which the run came closest there.

    Attributes
    ----------
    window_frames : int
        Frames of a window; window w begins with frame ``w * window_frames`` of the trajectory. 0 where there is no row.
    window : ndarray of int, shape (m,)
        The windows, rising. A window without a step that could be measured has no row.
    step : ndarray of int, shape (m,)
        The window's step of least clearance; of equals the first.
    least : ndarray, shape (m,)
        The clearance of that step, Å.
    clearance : ndarray of float32, shape (m, n_vertices)
        A lower bound of the distance, during that step, of every pair of edges of which one ends in the vertex, Å;
        NaN where there is no such pair.

    Guarantee
    ---------
    Proven, rounding to float32 included. Joined in any order and from any pieces, a profile is the same bit for bit.
    """

    window_frames: int
    window: Indices
    step: Indices
    least: Lengths
    clearance: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.window)

    @classmethod
    @lru_cache(maxsize=8)
    def none(cls, n_vertices: int = 0) -> "Profile":
        """Return a profile without rows, the same one every time."""
        empty = np.empty(0, dtype=np.int64)
        return cls(0, empty, empty, np.empty(0), np.empty((0, n_vertices), dtype=np.float32))

    @classmethod
    def joined(cls, profiles: Sequence["Profile"]) -> "Profile":
        """Return several as one: of a window that is in more than one, the row with the lower (clearance, step).

        Where the lengths of their windows differ, the result has the least common multiple.
        """
        kept = [profile for profile in profiles if len(profile)]
        if not kept:
            return profiles[0] if profiles else cls.none()
        length = int(np.lcm.reduce([profile.window_frames for profile in kept]))
        window = np.concatenate([profile.window // (length // profile.window_frames) for profile in kept])
        step = np.concatenate([profile.step for profile in kept])
        least = np.concatenate([profile.least for profile in kept])
        order = np.lexsort((step, least, window))
        _, first = np.unique(window[order], return_index=True)
        rows = order[first]
        starts = np.cumsum([0, *(len(profile) for profile in kept)])
        clearance = np.empty((len(rows), kept[0].clearance.shape[1]), dtype=np.float32)
        for start, profile in zip(starts.tolist(), kept, strict=False):  # row by row would hold everything twice
            own = (rows >= start) & (rows < start + len(profile))
            clearance[own] = profile.clearance[rows[own] - start]
        return cls(length, window[rows], step[rows], least[rows], clearance)

    def within(self, most: int = MOST_VALUES) -> "Profile":
        """Return the profile with windows twice as long, and twice again, until it has at most `most` values.

        One row stays in any case. It does not matter what it is cut into before: a piece never needs longer windows
        than the whole.
        """
        found = self
        while len(found) > 1 and found.clearance.size > most:
            doubled = replace(found, window_frames=2 * found.window_frames, window=found.window // 2)
            found = Profile.joined([doubled])
        return found

    def moved_by(self, steps: int) -> "Profile":
        """Return the same rows under other step numbers."""
        return replace(self, step=self.step + steps)

    def between(self, start: int, stop: int) -> "Profile":
        """Return the rows of the steps from `start` up to `stop`."""
        low, high = np.searchsorted(self.step, [start, stop])
        return replace(
            self,
            window=self.window[low:high],
            step=self.step[low:high],
            least=self.least[low:high],
            clearance=self.clearance[low:high],
        )


def rounded_down(values: Lengths) -> NDArray[np.float32]:
    """Return the values as float32, none above what it was: a lower bound stays one.

    Examples
    --------
    >>> float(np.float32(0.1)) > 0.1 > float(rounded_down(np.array([0.1]))[0])
    True
    """
    nearest = values.astype(np.float32)
    return np.where(nearest > values, np.nextafter(nearest, np.float32(-np.inf)), nearest)
