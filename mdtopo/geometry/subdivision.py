"""Does a moving smooth curve meet itself here? One check by its hulls, halved in time and space until they tell.

The three checks are those of `segmenthulls`; `halving` says what each is cut into. A piece that hulls do not settle may
hold a passage, which Krawczyk's test proves (`curvemeeting`); what lies in the cube of a passage is settled by it. A
cusp, a fold by 180° or a contact that is no passage is halved for ever: at `DEEPEST` halvings, or `MOST_BOXES` boxes,
the check is left OPEN, with its place.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.curvemeeting import locate
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.halving import halve_piece, take_top, whole_check
from mdtopo.geometry.segmenthulls import BY_MOTION, NOT_AT_ALL, PAIR, SELF, climb, vectors_of

FloatArray = NDArray[np.float64]

BY_HALVING, BY_MEETING = 6, 7
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

    `motion` is how far its vectors move, Å; `meetings` has rows (t, u, v, radius, sign); `box` is where it gave up, as
    (t0, t1, u0, u1, v0, v1).
    """

    clearance: float
    rung: int
    depth: int
    motion: float
    meetings: FloatArray
    box: FloatArray


@njit(cache=True, nogil=True)
def settle(
    kind: int,
    a0: FloatArray,
    a1: FloatArray,
    b0: FloatArray,
    b1: FloatArray,
    slack: float,
    greatest: float,
    most_boxes: int,
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
    most_boxes : int
        How many pieces may be looked at: `MOST_BOXES`, or 1 for the whole alone.

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
    if kind == SELF:
        b0, b1 = a0, a1
    pieces, waiting, n = whole_check(kind, a0, a1, b0, b1, DEEPEST), 1, len(a0) - 1
    meetings, n_meetings = np.empty((MOST_MEETINGS, 5)), 0
    v = np.empty((2 * (n + 1) * (n + 1), 3))
    least, rung, deepest, motion, top = np.inf, BY_MOTION, 0, 0.0, 0
    is_given_up = False
    for _ in range(most_boxes):
        if waiting == 0 or is_given_up:
            break
        top = take_top(pieces, waiting)
        waiting -= 1
        what, depth, points, box = pieces.kinds[top], pieces.depths[top], pieces.points[top], pieces.boxes[top]
        deepest = max(deepest, depth)
        if what == PAIR and is_inside(box, meetings, n_meetings):
            continue
        # n + 1 averages for each halving, of points and so of twice that for differences
        error = 2.0 * slack + 8.0 * (n + 2) * depth * UNIT_ROUNDOFF * greatest
        count = vectors_of(what, points[0], points[2], v)
        vectors_of(what, points[1], points[3], v[count:])
        clearance, by, d0, d1, rho = climb(v, count, error)
        motion = rho if depth == 0 else motion
        if clearance > 0.0:
            least = min(least, clearance)
            rung = max(rung, by if depth == 0 else BY_HALVING)
            continue
        if what == PAIR and depth >= FIRST_LOOK and depth % EVERY_LOOK == 0 and n_meetings < MOST_MEETINGS:
            middle = (0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3]), 0.5 * (box[4] + box[5]))
            found, place, radius, sign = locate(a0, a1, b0, b1, middle, slack, greatest)
            if found:
                n_meetings = keep_meeting(meetings, n_meetings, place, radius, sign, kind)
                if is_inside(box, meetings, n_meetings):
                    continue
        is_given_up = depth >= DEEPEST
        if not is_given_up:
            waiting = halve_piece(pieces, waiting, d0 > 0.0 and d1 > 0.0, rho)
    if is_given_up or waiting > 0:
        least, rung = 0.0, NOT_AT_ALL
        top = top if is_given_up else waiting - 1
    elif n_meetings > 0:
        least, rung = 0.0, BY_MEETING
    return Answer(least, rung, deepest, motion, meetings[:n_meetings].copy(), pieces.boxes[top].copy())


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
        u, v = v, u  # the sign stays: swapping the curves turns two signs
    for k in range(count):
        near = max(abs(meetings[k, 0] - t), max(abs(meetings[k, 1] - u), abs(meetings[k, 2] - v)))
        if near < max(meetings[k, 3], radius):  # in either cube there is one zero only
            meetings[k, 3] = max(meetings[k, 3], radius) if near == 0.0 else meetings[k, 3]
            return count
    meetings[count, 0], meetings[count, 1], meetings[count, 2] = t, u, v
    meetings[count, 3], meetings[count, 4] = radius, sign
    return count + 1
