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

    Each is counted under its rung, and its clearance is kept: 0 where it passes, or is not decided. Where a pair of a
    class passes, the class has no clearance to look for: a pair that provably has no passage is then done with, and
    counted under the rung that said so.
    """
    n_open, rung_pairs = is_open.sum(), best.rung_pairs
    rows, n_passages, passes = np.empty((MOST_PASSAGES * n_open, 14)), 0, (False, False, False)
    left, n_left = np.empty((n_open, 2), dtype=np.int64), 0
    basis0, basis1, x0, x1 = basis_of(motion.cell0), basis_of(motion.cell1), motion.x0, motion.x1
    for k in range(len(pairs)):
        if not is_open[k]:
            continue
        i, j, image, kind = named(k, pairs, images, local, trace)
        start, end = corners_of(i, j, lattice_vector(image, basis0), lattice_vector(image, basis1), x0, x1, edges)
        state, count, meetings, signs = passages(start, end, placing)
        if state != PASSES:
            left[n_left, 0], left[n_left, 1], n_left = k, state, n_left + 1
            continue
        rho = relative_motion(start, end) + placing
        for n in range(count):
            sign = 1.0 if (signs >> n) & 1 else -1.0
            write_passage(rows, n_passages, i, j, image, meetings[n], sign, rho, start, end)
            n_passages += 1
        passes = (passes[0] or kind == 0, passes[1] or kind == 1, passes[2] or kind == 2)
        rung_pairs[EXACT] += 1
        keep_clearance(edges, i, j, kind, 0.0, best)
    undecided = _decide_without_passage(
        left[:n_left], passes, pairs, images, local, motion, edges, trace, placing, best
    )
    return Found(rows[:n_passages], undecided)


@njit(cache=True, nogil=True)
def _decide_without_passage(
    left: IntArray,
    passes: tuple[bool, bool, bool],
    pairs: IntArray,
    images: IntArray,
    local: bool,
    motion: StepMotion,
    edges: IntArray,
    trace: IntArray,
    placing: float,
    best: Extremes,
) -> IntArray:
    """Decide the pairs without a passage, or without a sure one (`left`: which pair, and its state); see `decide_open`.

    `passes` says of each class whether a pair of it passes. Returned are the undecided pairs, as in `Found`.
    """
    least, rung_pairs, undecided, count = best.least, best.rung_pairs, np.empty((len(left), 6), dtype=np.int64), 0
    basis0, basis1, x0, x1 = basis_of(motion.cell0), basis_of(motion.cell1), motion.x0, motion.x1
    for n in range(len(left)):
        k, is_free = left[n, 0], left[n, 1] == FREE
        i, j, image, kind = named(k, pairs, images, local, trace)
        if is_free and passes[kind]:
            rung_pairs[EXACT] += 1
            continue
        start, end = corners_of(i, j, lattice_vector(image, basis0), lattice_vector(image, basis1), x0, x1, edges)
        rung, clearance = HULL, hull_clearance(start, end, SURELY * (least[kind] + placing)) - placing
        if not clearance > 0.0:
            rho = relative_motion(start, end) + placing
            rung, clearance = BISECTION, bisected_clearance(moving_pair(start, end, placing), rho, least[kind])
        if not clearance > 0.0:
            rung, clearance = EXACT, 0.0
        if rung == EXACT and not is_free:
            rung = OPEN
            undecided[count, 0], undecided[count, 1], undecided[count, 5] = i, j, kind
            undecided[count, 2], undecided[count, 3], undecided[count, 4] = image
            count += 1
        rung_pairs[rung] += 1
        if clearance <= least[kind]:
            keep_clearance(edges, i, j, kind, clearance, best)
    return undecided[:count]


@njit(cache=True, nogil=True, inline="always")
def named(k: int, pairs: IntArray, images: IntArray, local: bool, trace: IntArray) -> tuple[int, int, Counts, int]:
    """Return the edges of a pair, the image of the second, and their class."""
    i, j, image, kind = pairs[k, 0], pairs[k, 1], (0, 0, 0), 0
    if len(images) > 0:
        image = (images[k, 0], images[k, 1], images[k, 2])
    if not local:
        kind = 1 if trace[i] == trace[j] else 2
    return i, j, image, kind


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
