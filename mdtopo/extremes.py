"""The extremes of a step over its pairs: ν, the greatest ratio, the least clearances, each with the pair that holds it.

Ties go to the pair that comes first in the strands, so that no number depends on the order of the search.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

N_RUNGS = len(Rung)
NU0, NU1, NU0_PROVEN, NU1_PROVEN, RATIO = 0, 1, 2, 3, 4


class Extremes(NamedTuple):
    """The best values so far; every array is written in place.

    `values` holds ν0, ν1 (upper bounds by closest points), proven ν0, proven ν1, greatest ratio; `least` the least
    clearance of each class.
    """

    values: FloatArray
    nu_witness: IntArray
    nu_class: IntArray
    ratio_witness: IntArray
    least: FloatArray
    witness: IntArray
    rung_pairs: IntArray


@njit(cache=True, nogil=True)
def fresh_extremes() -> Extremes:
    """Return extremes that any pair will improve."""
    values = np.full(5, np.inf)
    values[RATIO] = -1.0
    return Extremes(
        values,
        np.full(4, -1, dtype=np.int64),
        np.full(1, -1, dtype=np.int64),
        np.full(4, -1, dtype=np.int64),
        np.full(3, np.inf),
        np.full((3, 4), -1, dtype=np.int64),
        np.zeros(N_RUNGS, dtype=np.int64),
    )


@njit(cache=True, nogil=True)
def copy_extremes(best: Extremes) -> Extremes:
    """Return an independent copy."""
    return Extremes(
        best.values.copy(),
        best.nu_witness.copy(),
        best.nu_class.copy(),
        best.ratio_witness.copy(),
        best.least.copy(),
        best.witness.copy(),
        best.rung_pairs.copy(),
    )


@njit(cache=True, nogil=True, inline="always")
def write_pair(witness: IntArray, edges: IntArray, i: int, j: int) -> None:
    """Write the four vertices of a pair of edges, the edge with the lower vertex first."""
    first, second = (i, j) if edges[i, 0] <= edges[j, 0] else (j, i)
    witness[0], witness[1] = edges[first, 0], edges[first, 1]
    witness[2], witness[3] = edges[second, 0], edges[second, 1]


@njit(cache=True, nogil=True, inline="always")
def comes_first(edges: IntArray, i: int, j: int, witness: IntArray) -> bool:
    """Return whether a pair comes before the witness; so a tie is settled by the pairs, not by the order of search."""
    low, high = min(edges[i, 0], edges[j, 0]), max(edges[i, 0], edges[j, 0])
    return low < witness[0] or (low == witness[0] and high < witness[2])


@njit(cache=True, nogil=True)
def keep_nu(
    edges: IntArray,
    i: int,
    j: int,
    kind: int,
    near0: float,
    near1: float,
    low0: float,
    low1: float,
    best: Extremes,
) -> None:
    """Update ν at both ends with one pair of edges."""
    best.values[NU0_PROVEN] = min(best.values[NU0_PROVEN], low0)
    best.values[NU1_PROVEN] = min(best.values[NU1_PROVEN], low1)
    best.values[NU1] = min(best.values[NU1], near1)
    if near0 < best.values[NU0] or (near0 == best.values[NU0] and comes_first(edges, i, j, best.nu_witness)):
        best.values[NU0] = near0
        best.nu_class[0] = kind
        write_pair(best.nu_witness, edges, i, j)


@njit(cache=True, nogil=True)
def keep_ratio(edges: IntArray, i: int, j: int, rho: float, low0: float, low1: float, best: Extremes) -> None:
    """Update the greatest ρ/(d0 + d1) with one pair of edges; infinite where no distance is proved."""
    apart = low0 + low1
    ratio = rho / apart if apart > 0.0 else np.inf
    if ratio > best.values[RATIO] or (ratio == best.values[RATIO] and comes_first(edges, i, j, best.ratio_witness)):
        best.values[RATIO] = ratio
        write_pair(best.ratio_witness, edges, i, j)


@njit(cache=True, nogil=True)
def keep_clearance(edges: IntArray, i: int, j: int, kind: int, clearance: float, best: Extremes) -> None:
    """Update the least clearance of a class with one pair of edges."""
    least = best.least[kind]
    if clearance < least or (clearance == least and comes_first(edges, i, j, best.witness[kind])):
        best.least[kind] = clearance
        write_pair(best.witness[kind], edges, i, j)
