"""Passages as rows of the table of crossings: in order of time, the edge with the lower first vertex first."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.records import Grade

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
CodeArray = NDArray[np.int8]

UNDERSAMPLED, RESOLVED = int(Grade.UNDERSAMPLED), int(Grade.RESOLVED)


class CrossingRows(NamedTuple):
    """The columns of `mdtopo.records.Crossings`, under the same names."""

    step: IntArray
    frame_t0: IntArray
    frame_t1: IntArray
    t: FloatArray
    edges: IntArray
    parameters: FloatArray
    point: FloatArray
    sign: IntArray
    image: IntArray
    grade: CodeArray
    object: CodeArray
    motion: FloatArray
    resolution: FloatArray

    @classmethod
    def empty(cls, n: int) -> "CrossingRows":
        """Return n rows that are yet to be written."""

        def number(*width: int) -> FloatArray:
            return np.empty((n, *width))

        def count(*width: int) -> IntArray:
            return np.empty((n, *width), dtype=np.int64)

        return cls(
            step=count(),
            frame_t0=count(),
            frame_t1=count(),
            t=number(),
            edges=count(2, 2),
            parameters=number(2),
            point=number(3),
            sign=count(),
            image=count(3),
            grade=np.empty(n, dtype=np.int8),
            object=np.empty(n, dtype=np.int8),
            motion=number(),
            resolution=number(),
        )


def in_order_of_time(passages: FloatArray, edges: IntArray) -> FloatArray:
    """Return the rows of `mdtopo.contacts.Found` in order of time, and of equal times by the first vertices."""
    low, high = first_vertices(passages, edges)
    ordered: FloatArray = passages[np.lexsort((high, low, passages[:, 5]))]
    return ordered


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
    out: CrossingRows,
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
    out : CrossingRows
        Of n rows.
    """
    for k in range(len(passages)):
        row, first, second, direction = passages[k], 0, 1, 1
        if is_swapped(passages, k, edges):
            first, second, direction = 1, 0, -1
        i, j = int(row[first]), int(row[second])
        out.step[k], out.frame_t0[k], out.frame_t1[k], out.object[k] = step, frame_t0, frame_t1, shape
        out.t[k], out.sign[k], out.motion[k] = row[5], int(row[11]), row[12]
        out.edges[k, 0, 0], out.edges[k, 0, 1] = edges[i, 0], edges[i, 1]
        out.edges[k, 1, 0], out.edges[k, 1, 1] = edges[j, 0], edges[j, 1]
        out.parameters[k, 0], out.parameters[k, 1] = row[6 + first], row[6 + second]
        for axis in range(3):
            out.image[k, axis], out.point[k, axis] = direction * int(row[2 + axis]), row[8 + axis]
        out.resolution[k] = row[13] if np.isnan(resolution) else resolution
        out.grade[k] = RESOLVED if row[12] < out.resolution[k] else UNDERSAMPLED
