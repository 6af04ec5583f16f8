"""Where two edges come together: the passages of a step, and the pairs that floating point leaves open (rungs 5 to 7).

What rungs 2 to 4 do not settle is looked at for passages first, because most such pairs have one: no hull is clear of
the origin then, and bisection would never end. What has none and no clearance either goes to exact arithmetic
(`mdtopo.passages`).
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.extremes import Extremes, keep_clearance
from mdtopo.geometry.bisection import bisected_clearance
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.lattice import Counts, basis_of, lattice_vector
from mdtopo.geometry.pairs import Corners, hull_clearance, relative_motion
from mdtopo.geometry.passage import FREE, MOST_PASSAGES, PASSES, moving_pair, passages
from mdtopo.geometry.vectors import Vector, add, norm, row, scale, subtract
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]
BoolArray = NDArray[np.bool_]

HULL, BISECTION = int(Rung.HULL), int(Rung.BISECTION)
EXACT, OPEN = int(Rung.EXACT), int(Rung.OPEN)


SURELY = 1.0 + 8.0 * UNIT_ROUNDOFF
"""What proves so much more than a bound is above it in rounding too, so that no tie is made up."""


class Found(NamedTuple):
    """Passages, and pairs that floating point leaves open.

    Attributes
    ----------
    passages : ndarray, shape (k, 14)
        Edges i and j, image of j (3), t, s, r, point (3), sign, ρ, length of the shorter edge (its least in the step).
    undecided : ndarray of int, shape (l, 6)
        Edges i and j, image of j (3), class.
    """

    passages: FloatArray
    undecided: IntArray

    def rows(self, start: IntArray, stop: IntArray) -> "Found":
        """Return some of the passages and some of the pairs; `start` and `stop` hold one number for each."""
        return Found(self.passages[start[0] : stop[0]], self.undecided[start[1] : stop[1]])


@njit(cache=True, nogil=True, inline="always")
def corners_of(
    i: int, j: int, shift0: Vector, shift1: Vector, x0: FloatArray, x1: FloatArray, edges: IntArray
) -> tuple[Corners, Corners]:
    """Return the ends of two edges, the second one shifted to its image, at both ends of the step."""
    a, b, c, d = edges[i, 0], edges[i, 1], edges[j, 0], edges[j, 1]
    start = row(x0, a), row(x0, b), add(row(x0, c), shift0), add(row(x0, d), shift0)
    end = row(x1, a), row(x1, b), add(row(x1, c), shift1), add(row(x1, d), shift1)
    return start, end


@njit(cache=True, nogil=True)
def decide_open(
    pairs: IntArray,
    images: IntArray,
    is_open: BoolArray,
    local: bool,
    motion: StepMotion,
    edges: IntArray,
    trace: IntArray,
    placing: float,
    best: Extremes,
) -> Found:
    """Decide the pairs that rungs 2 to 4 left open: by their passages, else by their hull or by bisection (7, 5, 6).

    Each is counted under its rung, and its clearance is kept: 0 where it passes, or is not decided.
    """
    n_open = is_open.sum()
    rows, undecided = np.empty((MOST_PASSAGES * n_open, 14)), np.empty((n_open, 6), dtype=np.int64)
    least, rung_pairs = best.least, best.rung_pairs
    n_passages, n_undecided, image, kind = 0, 0, (0, 0, 0), 0
    x0, x1, basis0, basis1 = motion.x0, motion.x1, basis_of(motion.cell0), basis_of(motion.cell1)
    for k in range(len(pairs)):
        if not is_open[k]:
            continue
        i, j = pairs[k, 0], pairs[k, 1]
        if not local:
            if len(images) > 0:
                image = (images[k, 0], images[k, 1], images[k, 2])
            kind = 1 if trace[i] == trace[j] else 2
        shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
        start, end = corners_of(i, j, shift0, shift1, x0, x1, edges)
        state, count, meetings, signs = passages(start, end, placing)
        rung, clearance = EXACT, 0.0
        rho = relative_motion(start, end) + placing
        if state == PASSES:
            for n in range(count):
                at = meetings[n]
                sign = 1.0 if (signs >> n) & 1 else -1.0
                write_passage(rows, n_passages, i, j, image, at, sign, rho, start, end)
                n_passages += 1
        else:
            rung, clearance = HULL, hull_clearance(start, end, SURELY * (least[kind] + placing)) - placing
            if not clearance > 0.0:
                rung, clearance = BISECTION, bisected_clearance(moving_pair(start, end, placing), rho, least[kind])
            if not clearance > 0.0:
                rung, clearance = EXACT, 0.0
            if rung == EXACT and state != FREE:
                rung = OPEN
                undecided[n_undecided, 0], undecided[n_undecided, 1], undecided[n_undecided, 5] = i, j, kind
                undecided[n_undecided, 2], undecided[n_undecided, 3], undecided[n_undecided, 4] = image
                n_undecided += 1
        rung_pairs[rung] += 1
        if clearance <= least[kind]:
            keep_clearance(edges, i, j, kind, clearance, best)
    return Found(rows[:n_passages], undecided[:n_undecided])


@njit(cache=True, nogil=True)
def write_passage(
    out: FloatArray,
    n: int,
    i: int,
    j: int,
    image: Counts,
    at: Vector,
    sign: float,
    rho: float,
    start: Corners,
    end: Corners,
) -> None:
    """Write row n of `Found.passages`."""
    t, s, r = at
    a, b = between(start[0], end[0], t), between(start[1], end[1], t)
    first = min(norm(subtract(start[1], start[0])), norm(subtract(end[1], end[0])))
    second = min(norm(subtract(start[3], start[2])), norm(subtract(end[3], end[2])))
    out[n, 0], out[n, 1] = i, j
    out[n, 2], out[n, 3], out[n, 4] = image
    out[n, 5], out[n, 6], out[n, 7] = t, s, r
    out[n, 8], out[n, 9], out[n, 10] = between(a, b, s)
    out[n, 11], out[n, 12], out[n, 13] = sign, rho, min(first, second)


@njit(cache=True, nogil=True)
def passage_row(
    i: int, j: int, image: Counts, at: Vector, sign: float, motion: StepMotion, edges: IntArray
) -> FloatArray:
    """Return the row of `Found.passages` of a passage that was found elsewhere."""
    shift0, shift1 = lattice_vector(image, basis_of(motion.cell0)), lattice_vector(image, basis_of(motion.cell1))
    start, end = corners_of(i, j, shift0, shift1, motion.x0, motion.x1, edges)
    out = np.empty((1, 14))
    write_passage(out, 0, i, j, image, at, sign, relative_motion(start, end), start, end)
    return out[0]


@njit(cache=True, nogil=True)
def between(p: Vector, q: Vector, t: float) -> Vector:
    """Return (1 - t)·p + t·q."""
    return add(scale(1.0 - t, p), scale(t, q))


@njit(cache=True, nogil=True)
def both_found(one: Found, other: Found) -> Found:
    """Return what two lists of pairs have found, together."""
    return Found(np.concatenate((one.passages, other.passages)), np.concatenate((one.undecided, other.undecided)))
