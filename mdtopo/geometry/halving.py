"""The pieces that a check of moving Bezier segments is cut into: a stack, halved in time or in space from the top.

=======  ========================================================
check    halved in space, it is
=======  ========================================================
SELF     SELF(A1), SELF(A2), JOINT(A1, A2)
JOINT    JOINT(A2, B1), PAIR(A1, B1), PAIR(A1, B2), PAIR(A2, B2)
PAIR     the longer segment in two
=======  ========================================================
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.bezier import halve
from mdtopo.geometry.segmenthulls import JOINT, PAIR, SELF

FloatArray = NDArray[np.float64]

NONE = -1
FIRST_HALF, SECOND_HALF, WHOLE = 0, 1, 2

PARTS = np.array(
    [
        [[SELF, 0, 0], [SELF, 1, 1], [JOINT, 0, 1], [NONE, 0, 0]],
        [[JOINT, 1, 0], [PAIR, 0, 0], [PAIR, 0, 1], [PAIR, 1, 1]],
        [[PAIR, 0, WHOLE], [PAIR, 1, WHOLE], [NONE, 0, 0], [NONE, 0, 0]],
        [[PAIR, WHOLE, 0], [PAIR, WHOLE, 1], [NONE, 0, 0], [NONE, 0, 0]],
    ]
)
"""By the kind of a check, and with one more where the second of a pair is longer: the parts, each with its kind and
what it takes of A and of B."""

MOST_PARTS = 4


class Pieces(NamedTuple):
    """Pieces that wait, and one more row for the piece that was taken off last.

    Attributes
    ----------
    points : ndarray, shape (room + 1, 4, n + 1, 3)
        Control points of A at the start and the end of the piece's time, and of B, Å. B is A in a check of kind SELF.
    boxes : ndarray, shape (room + 1, 6)
        t, u and v from and to, as parts of the whole step and segments.
    kinds, depths : ndarray of int, shape (room + 1,)
    """

    points: FloatArray
    boxes: FloatArray
    kinds: NDArray[np.int64]
    depths: NDArray[np.int64]


@njit(cache=True, nogil=True)
def whole_check(kind: int, a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray, deepest: int) -> Pieces:
    """Return a stack that can hold the parts of a check down to a depth, and holds the check itself."""
    room = (MOST_PARTS - 1) * (deepest + 1) + 1
    points, boxes = np.empty((room + 1, 4, len(a0), 3)), np.empty((room + 1, 6))
    for i in range(len(a0)):
        for axis in range(3):
            points[0, 0, i, axis], points[0, 1, i, axis] = a0[i, axis], a1[i, axis]
            points[0, 2, i, axis], points[0, 3, i, axis] = b0[i, axis], b1[i, axis]
    for k in range(3):
        boxes[0, 2 * k], boxes[0, 2 * k + 1] = 0.0, 1.0
    kinds, depths = np.zeros(room + 1, dtype=np.int64), np.zeros(room + 1, dtype=np.int64)
    kinds[0] = kind
    return Pieces(points, boxes, kinds, depths)


@njit(cache=True, nogil=True)
def take_top(pieces: Pieces, waiting: int) -> int:
    """Move the top of the stack to its last row, so that its parts can take its place; return that row."""
    last, top = len(pieces.kinds) - 1, waiting - 1
    for k in range(4):
        for i in range(pieces.points.shape[2]):
            for axis in range(3):
                pieces.points[last, k, i, axis] = pieces.points[top, k, i, axis]
    for k in range(6):
        pieces.boxes[last, k] = pieces.boxes[top, k]
    pieces.kinds[last], pieces.depths[last] = pieces.kinds[top], pieces.depths[top]
    return last


@njit(cache=True, nogil=True)
def halve_piece(pieces: Pieces, waiting: int, are_ends_clear: bool, rho: float) -> int:
    """Put the parts of the piece in the last row on the stack, and return how many pieces wait there.

    Parameters
    ----------
    pieces : Pieces
    waiting : int
        How many wait already.
    are_ends_clear : bool
        Whether hulls settle the piece at the start and at the end of its time.
    rho : float
        How far its vectors move, Å; time is halved where that is more than the piece is long.
    """
    last = len(pieces.kinds) - 1
    kind = pieces.kinds[last]
    size_a, size_b = extent(pieces.points, last, 0), extent(pieces.points, last, 2)
    longer = max(size_a, size_b)
    if rho > longer if kind == PAIR else are_ends_clear and rho > 0.5 * longer:
        return _halve_in_time(pieces, waiting)
    return _halve_in_space(pieces, waiting, kind + 1 if kind == PAIR and size_b > size_a else kind)


@njit(cache=True, nogil=True)
def extent(points: FloatArray, row: int, first: int) -> float:
    """Return how far a control point of a segment lies from its first one at most, at either end of the time, Å."""
    greatest = 0.0
    for k in range(first, first + 2):
        for i in range(1, points.shape[2]):
            squared = 0.0
            for axis in range(3):
                away = points[row, k, i, axis] - points[row, k, 0, axis]
                squared += away * away
            greatest = max(greatest, squared)
    return np.sqrt(greatest)


@njit(cache=True, nogil=True)
def _halve_in_time(pieces: Pieces, waiting: int) -> int:
    """Put the later half on the stack, and the earlier one, which is looked at first, on top of it."""
    points, boxes, last = pieces.points, pieces.boxes, len(pieces.kinds) - 1
    for early in range(2):
        top = waiting + early
        pieces.kinds[top], pieces.depths[top] = pieces.kinds[last], pieces.depths[last] + 1
        for k in range(6):
            boxes[top, k] = boxes[last, k]
        boxes[top, early] = 0.5 * (boxes[last, 0] + boxes[last, 1])
        for k in range(0, 4, 2):
            for i in range(points.shape[2]):
                for axis in range(3):
                    start, end = points[last, k, i, axis], points[last, k + 1, i, axis]
                    middle = 0.5 * (start + end)
                    points[top, k, i, axis] = start if early else middle
                    points[top, k + 1, i, axis] = middle if early else end
    return waiting + 2


@njit(cache=True, nogil=True)
def _halve_in_space(pieces: Pieces, waiting: int, how: int) -> int:
    """Put the parts that a row of `PARTS` names on the stack."""
    points, boxes, last = pieces.points, pieces.boxes, len(pieces.kinds) - 1
    halves = np.empty((3, 4, points.shape[2], 3))
    for k in range(4):
        halve(points[last, k], halves[FIRST_HALF, k], halves[SECOND_HALF, k])
        for i in range(points.shape[2]):
            for axis in range(3):
                halves[WHOLE, k, i, axis] = points[last, k, i, axis]
    for part in range(MOST_PARTS):
        if PARTS[how, part, 0] == NONE:
            break
        pieces.kinds[waiting], pieces.depths[waiting] = PARTS[how, part, 0], pieces.depths[last] + 1
        boxes[waiting, 0], boxes[waiting, 1] = boxes[last, 0], boxes[last, 1]
        for segment in range(2):
            taken, k = PARTS[how, part, 1 + segment], 2 * segment
            low, high = boxes[last, k + 2], boxes[last, k + 3]
            middle = 0.5 * (low + high)
            boxes[waiting, k + 2] = middle if taken == SECOND_HALF else low
            boxes[waiting, k + 3] = middle if taken == FIRST_HALF else high
            for i in range(points.shape[2]):
                for axis in range(3):
                    points[waiting, k, i, axis] = halves[taken, k, i, axis]
                    points[waiting, k + 1, i, axis] = halves[taken, k + 1, i, axis]
        waiting += 1
    return waiting
