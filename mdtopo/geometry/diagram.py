"""Which crossings a closed polygon shows when it is seen from one side, and which of them no deformation removes.

A diagram is decided beyond rounding, or not at all. The kernels trust their input.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.vectors import Vector, cross, dot, row, subtract
from mdtopo.typing import Flags, Indices, Points

POSITION_ERROR = 1e-14
"""Error of a turned coordinate as a multiple of the polygon's extent: one difference and three products, below 16u."""


def rotation(k: int) -> Points:
    """Return the k-th of a fixed sequence of generic rotations, from a quaternion of irrational phases."""
    w, x, y, z = np.cos(np.arange(1.0, 5.0) + k * np.sqrt([2.0, 3.0, 5.0, 7.0]))
    matrix = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.array(matrix) / (w * w + x * x + y * y + z * z)


def gauss_code(x: Points) -> tuple[Indices, Flags] | None:
    """Return the crossings in the order in which the polygon runs through them, or None where rounding leaves it open.

    Returns
    -------
    crossing : ndarray, shape (2 k,)
        Number of the crossing at each passage, 0 to k - 1, each twice.
    over : ndarray of bool, shape (2 k,)
        Whether the passage is the upper one.
    """
    room = 4 * len(x)
    while True:
        edges, places = np.empty((room, 2), np.int64), np.empty((room, 5))
        count = _find_crossings(x, edges, places)
        if count <= room:
            break
        room = count
    if count < 0:
        return None
    edges, places = edges[:count], places[:count]
    edge, place = edges.T.ravel(), places[:, :2].T.ravel()  # first the passages on edges i, then those on edges j
    error = np.tile(places[:, 2], 2)
    order = np.lexsort((place, edge))
    same = edge[order][1:] == edge[order][:-1]
    if np.any(same & (np.diff(place[order]) <= error[order][1:] + error[order][:-1])):
        return None
    crossing = np.tile(np.arange(count), 2)[order]
    over = np.concatenate([places[:, 4] > 0.0, places[:, 4] < 0.0])[order]
    kept = _reduce_code(crossing, over, places[:, 3] > 0.0)
    return np.unique(crossing[kept], return_inverse=True)[1].astype(np.int64), over[kept]


@njit(cache=True, nogil=True)
def _reduce_code(crossing: NDArray[np.int64], over: NDArray[np.bool_], positive: NDArray[np.bool_]) -> Flags:
    """Return which passages remain after all moves that remove one or two crossings (Reidemeister I and II).

    I: both passages of a crossing follow each other. II: two crossings of opposite sign follow each other above and
    follow each other, in either order, below.
    """
    n = len(crossing)
    alive = np.ones(n, np.bool_)
    partner, seen = np.empty(n, np.int64), np.full(n, -1)
    after, before = np.empty(n, np.int64), np.empty(n, np.int64)
    for k in range(n):
        after[k], before[k] = (k + 1) % n, (k - 1) % n
        first = seen[crossing[k]]
        if first >= 0:
            partner[k], partner[first] = first, k
        seen[crossing[k]] = k
    n_left, n_idle, k = n, 0, 0
    while n_left > 0 and n_idle <= n_left:
        m = after[k]
        is_loop = partner[k] == m
        is_lens = not is_loop and over[k] == over[m] and positive[crossing[k]] != positive[crossing[m]]
        if is_lens:
            is_lens = after[partner[k]] == partner[m] or after[partner[m]] == partner[k]
        if not (is_loop or is_lens):
            k, n_idle = m, n_idle + 1
            continue
        for gone in (k, m, partner[k], partner[m]):
            if alive[gone]:
                alive[gone] = False
                after[before[gone]], before[after[gone]] = after[gone], before[gone]
                n_left -= 1
        n_idle = 0
        while n_left > 0 and not alive[k]:
            k = before[k]
    return alive


@njit(cache=True, nogil=True)
def _find_crossings(x: NDArray[np.float64], edges: NDArray[np.int64], places: NDArray[np.float64]) -> int:
    """Return the number of crossings of a closed polygon seen along z, or -1 where rounding leaves one open.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Turned positions of extent at most 4; no two in a row are equal.
    edges : ndarray, shape (room, 2)
        Filled with the two edges of each crossing, as far as there is room.
    places : ndarray, shape (room, 5)
        Filled with s, t, their error, the sign and the height, as in `_meeting`.
    """
    n, count = len(x), 0
    for i in range(n):
        a, b = row(x, i), row(x, (i + 1) % n)
        if _folds(a, b, row(x, (i + 2) % n)):
            return -1
        for j in range(i + 2, n - 1 if i == 0 else n):
            c, d = row(x, j), row(x, (j + 1) % n)
            if not _boxes_meet(a, b, c, d):
                continue
            state, s, t, error, sign, height = _meeting(a, b, c, d)
            if state < 0:
                return -1
            if state > 0:
                if count < len(edges):
                    edges[count, 0], edges[count, 1] = i, j
                    places[count, 0], places[count, 1], places[count, 2] = s, t, error
                    places[count, 3], places[count, 4] = sign, height
                count += 1
    return count


@njit(cache=True, nogil=True)
def _meeting(a: Vector, b: Vector, c: Vector, d: Vector) -> tuple[int, float, float, float, float, float]:
    """Return whether and where the edges (a, b) and (c, d) cross seen along z, and what lies over what.

    Returns
    -------
    state : int
        0 they do not cross, 1 they cross, -1 rounding does not say.
    s, t : float
        Parameters of the crossing on the first and the second edge.
    error : float
        Bound of the errors of s and t.
    sign : float
        Sign of det(e, f, a - c), the sign of the crossing.
    height : float
        Sign of the height of the first edge over the second.
    """
    e, f, r = subtract(b, a), subtract(d, c), subtract(a, c)
    none = (0, 0.0, 0.0, 0.0, 0.0, 0.0)
    at_c, error_c = _turn(e, subtract(c, a))
    at_d, error_d = _turn(e, subtract(d, a))
    if (at_c > error_c and at_d > error_d) or (at_c < -error_c and at_d < -error_d):
        return none
    at_a, error_a = _turn(f, r)
    at_b, error_b = _turn(f, subtract(b, c))
    if (at_a > error_a and at_b > error_b) or (at_a < -error_a and at_b < -error_b):
        return none
    determinant = dot(cross(e, f), r)
    rounding = 4.0 * POSITION_ERROR * (_size(e) * _size(f) + _size(f) * _size(r) + _size(r) * _size(e))
    sure = abs(at_c) > error_c and abs(at_d) > error_d and abs(at_a) > error_a and abs(at_b) > error_b
    if not (sure and abs(determinant) > rounding):
        return -1, 0.0, 0.0, 0.0, 0.0, 0.0
    s, t = at_a / (at_a - at_b), at_c / (at_c - at_d)
    error = 2.0 * max((error_a + error_b) / abs(at_a - at_b), (error_c + error_d) / abs(at_c - at_d))
    sign = 1.0 if determinant > 0.0 else -1.0
    # a + s·e - c - t·f = (0, 0, h) gives det(e, f, a - c) = h·(e × f)_z, and (e × f)_z has the sign of at_d
    return 1, s, t, error, sign, sign if at_d > 0.0 else -sign


@njit(cache=True, nogil=True)
def _turn(e: Vector, r: Vector) -> tuple[float, float]:
    """Return the z component of e x r and a bound of its error, for differences of coordinates wrong by η each."""
    error = POSITION_ERROR * (4.0 * (_size(e) + _size(r)) + 16.0 * POSITION_ERROR)
    return e[0] * r[1] - e[1] * r[0], error


@njit(cache=True, nogil=True)
def _size(e: Vector) -> float:
    """Return the sum of the components' sizes, a cheap upper bound of the length."""
    return abs(e[0]) + abs(e[1]) + abs(e[2])


@njit(cache=True, nogil=True)
def _boxes_meet(a: Vector, b: Vector, c: Vector, d: Vector) -> bool:
    """Return whether the boxes around two edges, seen along z, may overlap."""
    margin = 4.0 * POSITION_ERROR
    for k in range(2):
        if min(a[k], b[k]) > max(c[k], d[k]) + margin or min(c[k], d[k]) > max(a[k], b[k]) + margin:
            return False
    return True


@njit(cache=True, nogil=True)
def _folds(a: Vector, b: Vector, c: Vector) -> bool:
    """Return whether the edge (b, c) may run back over (a, b), seen along z."""
    e, f = subtract(b, a), subtract(c, b)
    turn, error = _turn(e, f)
    return abs(turn) <= error and e[0] * f[0] + e[1] * f[1] <= error
