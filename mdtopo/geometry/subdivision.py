"""Does a moving smooth curve meet itself here? One check by its hulls, halved in time and space until they tell.

Three questions about Bezier segments, each of which is whether the origin stays outside a hull conv V(t):

=======  =======================================  ================================================================
check    V                                        halved in space, it is
=======  =======================================  ================================================================
SELF     differences of consecutive points of A   SELF(A1), SELF(A2), JOINT(A1, A2)
JOINT    J - P_i (i < n) and P'_j - J (j > 0)     JOINT(A2, B1), PAIR(A1, B1), PAIR(A1, B2), PAIR(A2, B2)
PAIR     P_i - P'_j                               the longer segment in two
=======  =======================================  ================================================================

A piece that hulls do not settle may hold a passage, which Krawczyk's test proves (`curvemeeting`); what lies in the
cube of a passage is settled by it. A cusp, a fold by 180° or a contact that is no passage is halved for ever: at
`DEEPEST` halvings, or `MOST_BOXES` boxes, the check is left OPEN, with its place.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.bezier import halve
from mdtopo.geometry.curvemeeting import locate
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.hull import direction_bound, hull_distance, least_norm_point
from mdtopo.geometry.vectors import add, dot, norm, scale

FloatArray = NDArray[np.float64]

SELF, JOINT, PAIR = 0, 1, 2
BY_MOTION, BY_DIRECTION, BY_HULL, BY_HALVING, BY_MEETING, NOT_AT_ALL = 3, 4, 5, 6, 7, 8
"""Rungs, with the numbers of `mdtopo.records.Rung`."""

DEEPEST = 48
"""Halvings of a piece, in time and space together."""

MOST_BOXES = 2000
"""Pieces that one check may look at; an ordinary one that needs halving at all takes a few dozen."""

MOST_MEETINGS = 16
FIRST_LOOK, EVERY_LOOK = 4, 2
"""Newton's method is tried from the fourth halving on, at every second one."""


class Answer(NamedTuple):
    """What a check has found.

    `meetings` has rows (t, u, v, radius, sign); `box` is where it gave up, as (t0, t1, u0, u1, v0, v1).
    """

    clearance: float
    rung: int
    depth: int
    meetings: FloatArray
    box: FloatArray


@njit(cache=True, nogil=True)
def vectors_of(kind: int, first: FloatArray, second: FloatArray, out: FloatArray) -> int:
    """Write V of a check at one end of the step, and return how many vectors it has."""
    n, count = len(first) - 1, 0
    if kind == SELF:
        for i in range(n):
            for axis in range(3):
                out[i, axis] = first[i + 1, axis] - first[i, axis]
        return n
    if kind == JOINT:
        for i in range(n):
            for axis in range(3):
                out[i, axis] = first[n, axis] - first[i, axis]
                out[n + i, axis] = second[i + 1, axis] - second[0, axis]
        return 2 * n
    for i in range(n + 1):
        for j in range(n + 1):
            for axis in range(3):
                out[count, axis] = first[i, axis] - second[j, axis]
            count += 1
    return count


@njit(cache=True, nogil=True)
def climb(v: FloatArray, count: int, slack: float) -> tuple[float, int, float, float, float]:
    """Return what rungs 3 to 5 say of vectors that move linearly.

    Parameters
    ----------
    v : ndarray, shape (2·count, 3)
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
    v0, v1, both = v[:count], v[count : 2 * count], v[: 2 * count]
    n0, n1 = least_norm_point(v0), least_norm_point(v1)
    d0, d1 = direction_bound(v0, n0) - slack, direction_bound(v1, n1) - slack
    moved, longest = 0.0, 0.0
    for i in range(count):
        d = (v1[i, 0] - v0[i, 0], v1[i, 1] - v0[i, 1], v1[i, 2] - v0[i, 2])
        moved = max(moved, dot(d, d))
        longest = max(longest, max(norm((v0[i, 0], v0[i, 1], v0[i, 2])), norm((v1[i, 0], v1[i, 1], v1[i, 2]))))
    rho = np.sqrt(moved) * (1.0 + 8.0 * UNIT_ROUNDOFF) + 2.0 * slack + 8.0 * UNIT_ROUNDOFF * longest
    clearance = 0.5 * (d0 + d1 - rho)
    if clearance > 0.0:
        return clearance, BY_MOTION, d0, d1, rho
    s0, s1 = norm(n0), norm(n1)
    if s0 > 0.0 and s1 > 0.0:
        for k in range(3):
            w = n0 if k == 0 else (n1 if k == 1 else add(scale(1.0 / s0, n0), scale(1.0 / s1, n1)))
            clearance = max(clearance, direction_bound(both, w) - slack)
        if clearance > 0.0:
            return clearance, BY_DIRECTION, d0, d1, rho
        if d0 > 0.0 and d1 > 0.0:
            return hull_distance(both) - slack, BY_HULL, d0, d1, rho
    return min(clearance, 0.0), NOT_AT_ALL, d0, d1, rho


@njit(cache=True, nogil=True)
def settle(
    kind: int,
    a0: FloatArray,
    a1: FloatArray,
    b0: FloatArray,
    b1: FloatArray,
    slack: float,
    greatest: float,
) -> Answer:
    """Answer one check of moving segments.

    Parameters
    ----------
    kind : int
        SELF (b is ignored), JOINT (b begins where a ends, at both ends of the step) or PAIR.
    a0, a1, b0, b1 : ndarray, shape (n + 1, 3)
        Control points at both ends of the step, Å.
    slack : float
        How far a control point may be off, Å.
    greatest : float
        Greatest coordinate among them, Å.

    Returns
    -------
    Answer
        Its rung is NOT_AT_ALL where it is not settled; meetings that were proved until then stand all the same. The
        clearance is 0 then, and where there is a meeting.

    Guarantee
    ---------
    Proven: unless the rung is NOT_AT_ALL, the segments meet at no other times and places than the meetings (JOINT: and
    the joint); each meeting is a passage.
    """
    n = len(a0) - 1
    room = 3 * DEEPEST + 8
    pieces, kinds = np.empty((room, 4, n + 1, 3)), np.empty(room, dtype=np.int64)
    boxes, depths = np.empty((room, 6)), np.empty(room, dtype=np.int64)
    meetings, n_meetings = np.empty((MOST_MEETINGS, 5)), 0
    pieces[0, 0], pieces[0, 1], pieces[0, 2], pieces[0, 3] = a0, a1, b0, b1
    kinds[0], depths[0], waiting = kind, 0, 1
    boxes[0, 0], boxes[0, 1], boxes[0, 2] = 0.0, 1.0, 0.0
    boxes[0, 3], boxes[0, 4], boxes[0, 5] = 1.0, 0.0, 1.0
    v = np.empty((2 * (n + 1) * (n + 1), 3))
    least, rung, deepest = np.inf, BY_MOTION, 0
    here, box = np.empty((4, n + 1, 3)), np.empty(6)
    for _ in range(MOST_BOXES):
        if waiting == 0:
            break
        waiting -= 1
        what, depth = kinds[waiting], depths[waiting]
        here[:], box[:] = pieces[waiting], boxes[waiting]
        deepest = max(deepest, depth)
        if what == PAIR and is_inside(box, meetings, n_meetings):
            continue
        # n + 1 averages for each halving, of points and so of twice that for differences
        error = 2.0 * slack + 8.0 * (n + 2) * depth * UNIT_ROUNDOFF * greatest
        count = vectors_of(what, here[0], here[2], v)
        vectors_of(what, here[1], here[3], v[count:])
        clearance, by, d0, d1, rho = climb(v, count, error)
        if clearance > 0.0:
            least = min(least, clearance)
            rung = max(rung, by if depth == 0 else BY_HALVING)
            continue
        if what == PAIR and depth >= FIRST_LOOK and depth % EVERY_LOOK == 0 and n_meetings < MOST_MEETINGS:
            middle = (0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3]), 0.5 * (box[4] + box[5]))
            second0, second1 = (a0, a1) if kind == SELF else (b0, b1)
            found, place, radius, sign = locate(a0, a1, second0, second1, middle, slack, greatest)
            if found:
                n_meetings = keep_meeting(meetings, n_meetings, place, radius, sign, kind)
                if is_inside(box, meetings, n_meetings):
                    continue
        if depth >= DEEPEST:
            return Answer(0.0, NOT_AT_ALL, deepest, meetings[:n_meetings].copy(), box)
        waiting = halve_piece(what, here, box, depth, d0 > 0.0 and d1 > 0.0, rho, pieces, kinds, boxes, depths, waiting)
    if waiting > 0:
        return Answer(0.0, NOT_AT_ALL, deepest, meetings[:n_meetings].copy(), boxes[waiting - 1].copy())
    if n_meetings > 0:
        return Answer(0.0, BY_MEETING, deepest, meetings[:n_meetings].copy(), box)
    return Answer(least, rung, deepest, meetings[:0].copy(), box)


@njit(cache=True, nogil=True)
def is_inside(box: FloatArray, meetings: FloatArray, count: int) -> bool:
    """Return whether a box lies in the cube of a proved meeting, where it is the only one."""
    for k in range(count):
        inside = True
        for axis in range(3):
            low, high = meetings[k, axis] - meetings[k, 3], meetings[k, axis] + meetings[k, 3]
            inside = inside and low < box[2 * axis] and box[2 * axis + 1] < high
        if inside:
            return True
    return False


@njit(cache=True, nogil=True)
def keep_meeting(
    meetings: FloatArray, count: int, place: tuple[float, float, float], radius: float, sign: int, kind: int
) -> int:
    """Add a meeting unless it is there, and return how many there are; of one segment with itself u < v."""
    t, u, v = place
    if kind == SELF and u > v:
        t, u, v, sign = t, v, u, sign  # swapping the curves turns two signs
    for k in range(count):
        near = max(abs(meetings[k, 0] - t), max(abs(meetings[k, 1] - u), abs(meetings[k, 2] - v)))
        if near < max(meetings[k, 3], radius):  # in either cube there is one zero only
            meetings[k, 3] = max(meetings[k, 3], radius) if near == 0.0 else meetings[k, 3]
            return count
    meetings[count, 0], meetings[count, 1], meetings[count, 2] = t, u, v
    meetings[count, 3], meetings[count, 4] = radius, sign
    return count + 1


@njit(cache=True, nogil=True)
def halve_piece(
    kind: int,
    here: FloatArray,
    box: FloatArray,
    depth: int,
    ends_clear: bool,
    rho: float,
    pieces: FloatArray,
    kinds: NDArray[np.int64],
    boxes: FloatArray,
    depths: NDArray[np.int64],
    waiting: int,
) -> int:
    """Put the parts of a piece on the stack, and return how many wait there.

    Time is halved where the motion is larger than the piece; the earlier half is looked at first.
    """
    size_a, size_b = extent(here[0], here[1]), extent(here[2], here[3]) if kind != SELF else 0.0
    in_time = rho > max(size_a, size_b) if kind == PAIR else ends_clear and rho > 0.5 * max(size_a, size_b)
    if in_time:
        middle = 0.5 * (box[0] + box[1])
        for late in range(2):
            k = waiting + 1 - late
            kinds[k], depths[k] = kind, depth + 1
            boxes[k] = box
            boxes[k, 1 - late] = middle
            for piece in range(0, 4, 2):
                for i in range(here.shape[1]):
                    for axis in range(3):
                        mean = 0.5 * (here[piece, i, axis] + here[piece + 1, i, axis])
                        pieces[k, piece, i, axis] = mean if late else here[piece, i, axis]
                        pieces[k, piece + 1, i, axis] = here[piece + 1, i, axis] if late else mean
        return waiting + 2
    halves = np.empty((8, *here.shape[1:]))
    for piece in range(4):
        halve(here[piece], halves[piece], halves[4 + piece])
    u, w = 0.5 * (box[2] + box[3]), 0.5 * (box[4] + box[5])
    if kind == SELF:
        k = _push(
            SELF, halves, 0, 0, box[0], box[1], box[2], u, box[2], u, depth, pieces, kinds, boxes, depths, waiting
        )
        k = _push(SELF, halves, 1, 1, box[0], box[1], u, box[3], u, box[3], depth, pieces, kinds, boxes, depths, k)
        # the second of the pair is the other half of the same segment
        halves[2], halves[3] = halves[0], halves[1]
        halves[6], halves[7] = halves[4], halves[5]
        return _push(JOINT, halves, 0, 1, box[0], box[1], box[2], u, u, box[3], depth, pieces, kinds, boxes, depths, k)
    if kind == JOINT:
        k, t0, t1 = waiting, box[0], box[1]
        k = _push(JOINT, halves, 1, 0, t0, t1, u, box[3], box[4], w, depth, pieces, kinds, boxes, depths, k)
        k = _push(PAIR, halves, 0, 0, t0, t1, box[2], u, box[4], w, depth, pieces, kinds, boxes, depths, k)
        k = _push(PAIR, halves, 0, 1, t0, t1, box[2], u, w, box[5], depth, pieces, kinds, boxes, depths, k)
        return _push(PAIR, halves, 1, 1, t0, t1, u, box[3], w, box[5], depth, pieces, kinds, boxes, depths, k)
    k, t0, t1 = waiting, box[0], box[1]
    if size_a >= size_b:
        halves[2], halves[3], halves[6], halves[7] = here[2], here[3], here[2], here[3]
        k = _push(PAIR, halves, 0, 0, t0, t1, box[2], u, box[4], box[5], depth, pieces, kinds, boxes, depths, k)
        return _push(PAIR, halves, 1, 0, t0, t1, u, box[3], box[4], box[5], depth, pieces, kinds, boxes, depths, k)
    halves[0], halves[1], halves[4], halves[5] = here[0], here[1], here[0], here[1]
    k = _push(PAIR, halves, 0, 0, t0, t1, box[2], box[3], box[4], w, depth, pieces, kinds, boxes, depths, k)
    return _push(PAIR, halves, 0, 1, t0, t1, box[2], box[3], w, box[5], depth, pieces, kinds, boxes, depths, k)


@njit(cache=True, nogil=True)
def _push(
    kind: int,
    halves: FloatArray,
    half_a: int,
    half_b: int,
    t0: float,
    t1: float,
    u0: float,
    u1: float,
    v0: float,
    v1: float,
    depth: int,
    pieces: FloatArray,
    kinds: NDArray[np.int64],
    boxes: FloatArray,
    depths: NDArray[np.int64],
    k: int,
) -> int:
    kinds[k], depths[k] = kind, depth + 1
    for i in range(halves.shape[1]):
        for axis in range(3):
            pieces[k, 0, i, axis], pieces[k, 1, i, axis] = halves[4 * half_a, i, axis], halves[4 * half_a + 1, i, axis]
            pieces[k, 2, i, axis] = halves[4 * half_b + 2, i, axis]
            pieces[k, 3, i, axis] = halves[4 * half_b + 3, i, axis]
    boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3], boxes[k, 4], boxes[k, 5] = t0, t1, u0, u1, v0, v1
    return k + 1


@njit(cache=True, nogil=True)
def extent(p0: FloatArray, p1: FloatArray) -> float:
    """Return how far a control point lies from the first one at most, at either end, Å."""
    greatest = 0.0
    for points in (p0, p1):
        for i in range(1, len(points)):
            d = (points[i, 0] - points[0, 0], points[i, 1] - points[0, 1], points[i, 2] - points[0, 2])
            greatest = max(greatest, dot(d, d))
    return np.sqrt(greatest)
