"""What do hulls say of Bezier segments that move? One look, without halving.

Each check asks whether the origin stays outside conv V(t), for vectors V that move linearly:

=======  =======================================  ======================================================
check    V                                        what it proves
=======  =======================================  ======================================================
SELF     differences of consecutive points of A   A never meets itself, and has a tangent everywhere
JOINT    J - P_i (i < n) and P'_j - J (j > 0)     A and B meet at the joint J only, where A ends and B begins
PAIR     P_i - P'_j                               A and B never meet
=======  =======================================  ======================================================
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.hull import direction_bound, hull_distance, least_norm_point
from mdtopo.geometry.vectors import norm, row

FloatArray = NDArray[np.float64]

SELF, JOINT, PAIR = 0, 1, 2
BY_MOTION, BY_DIRECTION, BY_HULL, NOT_AT_ALL = 3, 4, 5, 8
"""Rungs, with the numbers of `mdtopo.records.Rung`."""


@njit(cache=True, nogil=True)
def vectors_of(kind: int, first: FloatArray, second: FloatArray, out: FloatArray) -> int:
    """Write V of a check at one end of the step, and return how many vectors it has.

    Parameters
    ----------
    kind : int
        SELF (`second` is ignored), JOINT or PAIR.
    first, second : ndarray, shape (n + 1, 3)
        Control points, Å.
    out : ndarray, shape (≥ (n + 1)², 3)
    """
    n, count = len(first) - 1, 0
    if kind == PAIR:
        for i in range(n + 1):
            for j in range(n + 1):
                for axis in range(3):
                    out[count, axis] = first[i, axis] - second[j, axis]
                count += 1
        return count
    for i in range(n):
        for axis in range(3):
            if kind == SELF:
                out[i, axis] = first[i + 1, axis] - first[i, axis]
            else:
                out[i, axis] = first[n, axis] - first[i, axis]
                out[n + i, axis] = second[i + 1, axis] - second[0, axis]
    return n if kind == SELF else 2 * n


@njit(cache=True, nogil=True)
def climb(v: FloatArray, count: int, slack: float) -> tuple[float, int, float, float, float]:
    """Return what rungs 3 to 5 say of vectors that move linearly.

    Parameters
    ----------
    v : ndarray, shape (≥ 2·count, 3)
        V at the start, then V at the end, Å.
    count : int
    slack : float
        How far one of them may be off beside the rounding of one difference, Å.

    Returns
    -------
    clearance : float
        Proven lower bound of the distance of the origin to conv V(t) at every time; proves nothing unless positive.
    rung : int
    d0, d1, rho : float
        Proven lower bounds at the ends, and upper bound of the motion.
    """
    ways, low = np.empty((3, 3)), np.empty(2)
    for end in range(2):
        here = v[end * count : (end + 1) * count]
        nearest = least_norm_point(here)
        ways[end, 0], ways[end, 1], ways[end, 2] = nearest
        low[end] = direction_bound(here, nearest) - slack
    rho = greatest_motion(v, count) + 2.0 * slack
    clearance = 0.5 * (low[0] + low[1] - rho)
    if clearance > 0.0:
        return clearance, BY_MOTION, low[0], low[1], rho
    s0, s1 = norm(row(ways, 0)), norm(row(ways, 1))
    if s0 > 0.0 and s1 > 0.0:
        both = v[: 2 * count]
        for axis in range(3):
            ways[2, axis] = ways[0, axis] / s0 + ways[1, axis] / s1
        for k in range(3):
            clearance = max(clearance, direction_bound(both, row(ways, k)) - slack)
        if clearance > 0.0:
            return clearance, BY_DIRECTION, low[0], low[1], rho
        if low[0] > 0.0 and low[1] > 0.0:
            clearance = hull_distance(both) - slack
            if clearance > 0.0:
                return clearance, BY_HULL, low[0], low[1], rho
    return min(clearance, 0.0), NOT_AT_ALL, low[0], low[1], rho


@njit(cache=True, nogil=True)
def greatest_motion(v: FloatArray, count: int) -> float:
    """Return ρ, how far one of the vectors moves at most, rounding included; V as in `climb`."""
    moved, longest = 0.0, 0.0
    for i in range(count):
        from_here, to_there, squared = 0.0, 0.0, 0.0
        for axis in range(3):
            start, end = v[i, axis], v[count + i, axis]
            from_here, to_there = from_here + start * start, to_there + end * end
            squared += (end - start) * (end - start)
        moved, longest = max(moved, squared), max(longest, max(from_here, to_there))
    return np.sqrt(moved) * (1.0 + 8.0 * UNIT_ROUNDOFF) + 8.0 * UNIT_ROUNDOFF * np.sqrt(longest)
