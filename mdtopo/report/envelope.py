"""A million steps on a page: least and greatest of every bin, so that no single step can vanish.

Striding or LTTB would drop a step between two that are kept. A bin keeps its extremes and which steps hold them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mdtopo.typing import Codes, Indices

MOST_BINS = 10_000
"""Bins of a page: up to this many steps each step is one, and a screen is at most 4000 pixels wide."""


class Envelope(NamedTuple):
    """Least and greatest of each bin, and the rows that hold them; NaN and -1 where a bin has no value."""

    least: NDArray[np.float64]
    least_row: Indices
    greatest: NDArray[np.float64]
    greatest_row: Indices


def bin_starts(n_rows: int, most: int = MOST_BINS) -> Indices:
    """Return the first row of each bin, shape (n_bins,): bins of equal size, the last may be shorter.

    Examples
    --------
    >>> bin_starts(7, most=3).tolist()
    [0, 3, 6]
    """
    return np.arange(0, n_rows, max(1, -(-n_rows // most)), dtype=np.int64)


def envelope(values: NDArray[np.float64], starts: Indices) -> Envelope:
    """Return the envelope of the values in bins.

    Parameters
    ----------
    values : ndarray, shape (n,)
        NaN where there is none.
    starts : ndarray of int
        First row of each bin, as `bin_starts` returns them.

    Examples
    --------
    >>> envelope(np.array([3.0, np.nan, 1.0, 2.0]), bin_starts(4, most=2)).least.tolist()
    [3.0, 1.0]
    """
    least, least_row = _least(values, starts)
    greatest, greatest_row = _least(-values, starts)
    return Envelope(least, least_row, -greatest, greatest_row)


def _least(values: NDArray[np.float64], starts: Indices) -> tuple[NDArray[np.float64], Indices]:
    if not len(values):
        return np.empty(0), np.empty(0, dtype=np.int64)
    least = np.fmin.reduceat(values, starts)
    sizes = np.diff(np.append(starts, len(values)))
    holds = np.flatnonzero(values == np.repeat(least, sizes))
    rows = np.full(len(starts), -1, dtype=np.int64)
    bins = np.searchsorted(starts, holds, side="right") - 1
    rows[bins[::-1]] = holds[::-1]  # the first of equals is written last
    return least, rows


def worst_states(states: Codes, starts: Indices) -> Codes:
    """Return the state of greatest concern in each bin."""
    return np.maximum.reduceat(states, starts) if len(states) else states
