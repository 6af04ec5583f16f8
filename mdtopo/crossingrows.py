"""Passages as rows of the table of crossings: in order of time, the edge with the lower first vertex first."""

from typing import Any, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.records import Grade

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

UNDERSAMPLED, RESOLVED = int(Grade.UNDERSAMPLED), int(Grade.RESOLVED)


CrossingRows: TypeAlias = NDArray[Any]
"""Records of type `ROW`, one for each passage."""

ROW = np.dtype(
    [
        ("step", np.int64),
        ("frame_t0", np.int64),
        ("frame_t1", np.int64),
        ("t", np.float64),
        ("edges", np.int64, (2, 2)),
        ("parameters", np.float64, (2,)),
        ("point", np.float64, (3,)),
        ("sign", np.int64),
        ("image", np.int64, (3,)),
        ("grade", np.int8),
        ("object", np.int8),
        ("motion", np.float64),
        ("resolution", np.float64),
    ],
    align=True,
)
"""The columns of `mdtopo.records.Crossings`, under the same names."""


def columns_of(rows: CrossingRows) -> dict[str, NDArray[Any]]:
    """Return the columns of a table that the rows hold, as views of them."""
    return {name: rows[name] for name in ROW.fields or ()}


def in_order_of_time(passages: FloatArray, edges: IntArray) -> FloatArray:
    """Return the rows of `mdtopo.contacts.Found` in order of time, and of equal times by the first vertices."""
    low, high = first_vertices(passages, edges)
    return passages.take(np.lexsort((high, low, passages[:, 5])), axis=0)


@njit(cache=True, nogil=True)
def first_vertices(passages: FloatArray, edges: IntArray) -> tuple[IntArray, IntArray]:
    """Return the lower and the higher one of the first vertices of the two edges of each passage."""
    low, high = np.empty(len(passages), dtype=np.int64), np.empty(len(passages), dtype=np.int64)
    for k in range(len(passages)):
        a, b = edges[int(passages[k, 0]), 0], edges[int(passages[k, 1]), 0]
        low[k], high[k] = min(a, b), max(a, b)
    return low, high


@njit(cache=True, nogil=True)
def is_swapped(passages: FloatArray, k: int, edges: IntArray) -> bool:
    """Return whether the two edges of passage k change places in the table."""
    return edges[int(passages[k, 1]), 0] < edges[int(passages[k, 0]), 0]


@njit(cache=True, nogil=True)
def write_rows(
    passages: FloatArray,
    edges: IntArray,
    step: int,
    frame_t0: int,
    frame_t1: int,
    shape: int,
    resolution: float,
    rows: CrossingRows,
) -> None:
    """Write passages as rows of the table.

    Parameters
    ----------
    passages : ndarray, shape (n, 14)
        As in `mdtopo.contacts.Found`, in order.
    edges : ndarray of int, shape (m, 2)
        Of the traces.
    step, frame_t0, frame_t1, shape : int
        Of all of them.
    resolution : float
        Resolution length, Å; NaN for the length of the shorter edge.
    rows : CrossingRows
        n of them, to be written to.
    """
    for k in range(len(passages)):
        found, row, first, second, direction = passages[k], rows[k], 0, 1, 1
        if is_swapped(passages, k, edges):
            first, second, direction = 1, 0, -1
        i, j = int(found[first]), int(found[second])
        row["step"], row["frame_t0"], row["frame_t1"], row["object"] = step, frame_t0, frame_t1, shape
        row["t"], row["sign"], row["motion"] = found[5], int(found[11]), found[12]
        for end in range(2):
            row["edges"][0, end], row["edges"][1, end] = edges[i, end], edges[j, end]
        row["parameters"][0], row["parameters"][1] = found[6 + first], found[6 + second]
        for axis in range(3):
            row["image"][axis], row["point"][axis] = direction * int(found[2 + axis]), found[8 + axis]
        row["resolution"] = found[13] if np.isnan(resolution) else resolution
        row["grade"] = RESOLVED if found[12] < row["resolution"] else UNDERSAMPLED
