"""The certificate of a moving smooth curve over all of its segments in one step.

Every segment is asked whether it meets itself (S1), every joint whether its two segments meet elsewhere (S2), and every
pair of segments that share no point whether they meet (S3). Chords settle nearly all of that (`geometry.segmentpairs`);
what they leave is listed and settled by hulls, and by halving (`geometry.subdivision`).

Every kernel that calls another compiles it again, with all that this one calls. So a kernel with much below it and one
caller is inlined there, which spares that; and the three kinds of checks come as numbers in one list, to be settled in
one place, so that what settles them is compiled once and not for each kind.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.distances import DUAL_ERROR, LEAST_SQUARE, UNIT_ROUNDOFF
from mdtopo.geometry.hull import hull_distance
from mdtopo.geometry.lattice import basis_of, lattice_vector
from mdtopo.geometry.segmenthulls import PAIR
from mdtopo.geometry.segmentpairs import lone_checks, pair_checks
from mdtopo.geometry.segmentshapes import HALF0, HALF1, mean_chord, pair_separation, shapes_of, vector_of
from mdtopo.geometry.subdivision import MOST_BOXES, Answer, settle
from mdtopo.geometry.vectors import Vector, dot, norm, quotient, row, subtract
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BROAD_PHASE, OPEN = int(Rung.BROAD_PHASE), int(Rung.OPEN)

MOST_FOUND = 4096
"""Passages of one step that are listed; beyond, the step stays open."""

MOST_OPEN = 64
"""Checks that may stay open in one step before no more are halved: the step is undecided whatever they say."""

FOUND_WIDTH = 11


class CurveMeasure(NamedTuple):
    """What one step of a curve comes to.

    Attributes
    ----------
    d_star, d_star_segment : float, int
        Least d* of a segment's hodograph at the start, Å, and that segment.
    bezier_ratio, bezier_margin : float
        Greatest max|δ(P_(i+1) - P_i)|/d* of a segment (below 1 no segment meets itself), and least d* less that.
    printed_ratio : float
        Greatest max|δP_i|/d* of a segment: the paper's comparison as printed, which proves nothing unless below 1/2.
    clearance : float
        Proven lower bound of the distance of segments that share no point, Å; at most the reach of the search.
    rung, depth : int
        The costliest rung, and the most halvings of one check.
    pair : ndarray of int, shape (2,)
        The segments that hold the clearance, or of the first check that stayed open.
    n_open : int
        Checks that are not settled.
    place : ndarray, shape (6,)
        The box of the first of them: t, u and v from and to.
    found : ndarray, shape (k, 11)
        Passages: segments i and j, image (3), t, u, v, sign, ρ, resolution length.
    countable : bool
        Whether periodic images could be counted.
    """

    d_star: float
    d_star_segment: int
    bezier_ratio: float
    bezier_margin: float
    printed_ratio: float
    clearance: float
    rung: int
    depth: int
    pair: IntArray
    n_open: int
    place: FloatArray
    found: FloatArray
    countable: bool


@njit(cache=True, nogil=True, inline="always")
def measure_curve(
    c0: FloatArray,
    c1: FloatArray,
    following: IntArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
    slack: float,
) -> CurveMeasure:
    """Return margins, clearance, verdict and passages of one step of a curve.

    Parameters
    ----------
    c0, c1 : ndarray, shape (m, n + 1, 3)
        Control points at both ends, Å; they move linearly.
    following : ndarray of int, shape (m,)
        The segment that follows each one, -1 at an open end. Rings have three segments or more.
    cell0, cell1 : ndarray, shape (3, 3)
        Lattice vectors at both ends; ignored unless periodic.
    periodic : bool
    slack : float
        How far a control point may be off, Å.

    Guarantee
    ---------
    Proven: where nothing is open, the curve meets itself, in any image, at no other times and places than the passages
    that are found; each of these is one.
    """
    shapes, boxes = shapes_of(c0, c1)
    greatest = greatest_coordinate(boxes, cell0, cell1, periodic)
    rounding = slack + 64.0 * UNIT_ROUNDOFF * greatest + 1e-140
    chord = mean_chord(shapes)
    tally = fresh_tally(chord if len(c0) > 1 or periodic else np.inf)
    is_complete = True
    checks, lows = lone_checks(c0, c1, shapes, following, rounding)
    for late in range(2):
        if late:
            # nothing further away than what is known by now can count
            reach = min(tally.numbers[CLEARANCE], chord)
            checks, lows, is_complete = pair_checks(shapes, boxes, following, cell0, cell1, periodic, reach, rounding)
        settle_checks(checks, lows, c0, c1, shapes, cell0, cell1, slack, rounding, greatest, tally)
    n_found, n_open = tally.counts[N_FOUND], tally.counts[N_OPEN]
    d_star, segment, ratio, margin, printed = hodograph_margins(c0, c1, slack)
    return CurveMeasure(
        d_star,
        segment,
        ratio,
        margin,
        printed,
        0.0 if n_open > 0 or n_found > 0 or not is_complete else tally.numbers[CLEARANCE],
        OPEN if n_open > 0 or not is_complete else tally.counts[RUNG],
        tally.counts[DEPTH],
        tally.counts[FIRST:].copy(),
        n_open,
        tally.place,
        tally.found[:n_found].copy(),
        is_complete,
    )


class Tally(NamedTuple):
    """What is being collected, in place: `numbers` clearance; `counts` rung, depth, open, found, pair, first open."""

    numbers: FloatArray
    counts: IntArray
    place: FloatArray
    found: FloatArray


CLEARANCE = 0
RUNG, DEPTH, N_OPEN, N_FOUND, FIRST, SECOND = 0, 1, 2, 3, 4, 5


@njit(cache=True, nogil=True)
def fresh_tally(clearance: float) -> Tally:
    """Return a tally of nothing, to be followed up to a clearance, Å."""
    counts = np.zeros(6, dtype=np.int64)
    counts[RUNG], counts[FIRST], counts[SECOND] = BROAD_PHASE, -1, -1
    return Tally(np.full(1, clearance), counts, np.full(6, np.nan), np.empty((MOST_FOUND, FOUND_WIDTH)))


@njit(cache=True, nogil=True)
def greatest_coordinate(boxes: FloatArray, cell0: FloatArray, cell1: FloatArray, periodic: bool) -> float:
    """Return the greatest coordinate that a control point or its image can have, Å."""
    low, high, cells = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0  # by axis: six maxima that do not wait for each other
    for k in range(len(boxes)):
        low = (max(low[0], abs(boxes[k, 0])), max(low[1], abs(boxes[k, 1])), max(low[2], abs(boxes[k, 2])))
        high = (max(high[0], abs(boxes[k, 3])), max(high[1], abs(boxes[k, 4])), max(high[2], abs(boxes[k, 5])))
    greatest = max(max(low[0], low[1], low[2]), max(high[0], high[1], high[2]))
    for k in range(3):
        cells += norm(row(cell0, k)) + norm(row(cell1, k))
    return greatest + 4.0 * cells if periodic else greatest


@njit(cache=True, nogil=True)
def control(c: FloatArray, k: int, i: int) -> Vector:
    """Return control point i of segment k."""
    return c[k, i, 0], c[k, i, 1], c[k, i, 2]


@njit(cache=True, nogil=True)
def hodograph_margins(c0: FloatArray, c1: FloatArray, slack: float) -> tuple[float, int, float, float, float]:
    """Return least d* with its segment, greatest sound ratio, least margin and greatest printed ratio.

    A segment is measured in full only where a cheap bound of its d* does not show that it changes none of them.
    """
    m, n = c0.shape[0], c0.shape[1] - 1
    d_star, segment, ratio, margin, printed = np.inf, -1, 0.0, np.inf, 0.0
    v = np.empty((n, 3))
    for k in range(m):
        before, chord = subtract(control(c1, k, 0), control(c0, k, 0)), subtract(control(c0, k, n), control(c0, k, 0))
        moved, turned, least, greatest = dot(before, before), 0.0, np.inf, 0.0
        for i in range(n):
            step = subtract(control(c0, k, i + 1), control(c0, k, i))
            least, greatest = min(least, dot(chord, step)), max(greatest, dot(step, step))
            after = subtract(control(c1, k, i + 1), control(c0, k, i + 1))
            moved = max(moved, dot(after, after))
            change = subtract(after, before)
            turned = max(turned, dot(change, change))
            before = after
        # as `direction_bound` has it, without an array
        is_long = dot(chord, chord) > LEAST_SQUARE
        low = quotient(least, norm(chord)) - DUAL_ERROR * np.sqrt(greatest) if is_long else 0.0
        low, moved, turned = low - 2.0 * slack, np.sqrt(moved), np.sqrt(turned)
        if low > d_star and turned <= ratio * low and low - turned > margin and moved <= printed * low:
            continue
        for i in range(n):
            v[i, 0], v[i, 1], v[i, 2] = subtract(control(c0, k, i + 1), control(c0, k, i))
        exact = max(hull_distance(v) - 2.0 * slack, 0.0)
        if exact < d_star:
            d_star, segment = exact, k
        margin = min(margin, exact - turned)
        ratio = max(ratio, turned / exact if exact > 0.0 else (np.inf if turned > 0.0 else 0.0))
        printed = max(printed, moved / exact if exact > 0.0 else (np.inf if moved > 0.0 else 0.0))
    return d_star, segment, ratio, margin, printed


@njit(cache=True, nogil=True, inline="always")
def settle_checks(
    checks: IntArray,
    lows: FloatArray,
    c0: FloatArray,
    c1: FloatArray,
    shapes: FloatArray,
    cell0: FloatArray,
    cell1: FloatArray,
    slack: float,
    rounding: float,
    greatest: float,
    tally: Tally,
) -> None:
    """Settle a list of checks, pairs only as far as they may lower the clearance, and note what comes of them.

    `lows` are lower bounds of the pairs' distances.
    """
    basis0, basis1, width = basis_of(cell0), basis_of(cell1), c0.shape[1]
    b0, b1 = np.empty((width, 3)), np.empty((width, 3))
    for k in range(len(checks)):
        if lows[k] > tally.numbers[CLEARANCE]:
            continue
        kind, i, j = checks[k, 0], checks[k, 1], checks[k, 2]
        image = (checks[k, 3], checks[k, 4], checks[k, 5])
        shift0, shift1, low, error = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, slack
        if kind == PAIR:
            error = rounding
            if image != (0, 0, 0):
                shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
            low = pair_separation(c0, c1, shapes, i, j, shift0, shift1, rounding, tally.numbers[CLEARANCE])
            if low > tally.numbers[CLEARANCE]:
                continue
        _place(c0, j, shift0, b0)
        _place(c1, j, shift1, b1)
        most_boxes = MOST_BOXES if tally.counts[N_OPEN] < MOST_OPEN else 1
        answer = settle(kind, c0[i], c1[i], b0, b1, error, greatest, most_boxes)
        is_open = _note(answer, i, j, image, shapes, tally)
        clearance = 0.0 if is_open else max(low, answer.clearance)
        if kind == PAIR and clearance < tally.numbers[CLEARANCE]:
            tally.numbers[CLEARANCE] = clearance
            if tally.counts[N_OPEN] == 0:
                tally.counts[FIRST], tally.counts[SECOND] = i, j


@njit(cache=True, nogil=True)
def _place(c: FloatArray, k: int, shift: Vector, out: FloatArray) -> None:
    """Write the control points of an image of a segment."""
    for i in range(c.shape[1]):
        for axis in range(3):
            out[i, axis] = c[k, i, axis] + shift[axis]


@njit(cache=True, nogil=True)
def _note(answer: Answer, i: int, j: int, image: tuple[int, int, int], shapes: FloatArray, tally: Tally) -> bool:
    """Take an answer into the tally, and return whether the check stays open."""
    counts = tally.counts
    counts[DEPTH] = max(counts[DEPTH], answer.depth)
    is_open = answer.rung == OPEN
    length = min(norm(vector_of(shapes, i, HALF0)), norm(vector_of(shapes, i, HALF1)))
    length = 2.0 * min(length, min(norm(vector_of(shapes, j, HALF0)), norm(vector_of(shapes, j, HALF1))))
    for k in range(len(answer.meetings)):
        if counts[N_FOUND] == MOST_FOUND:
            is_open = True
            break
        out = tally.found[counts[N_FOUND]]
        out[0], out[1], out[2], out[3], out[4] = i, j, image[0], image[1], image[2]
        out[5], out[6], out[7] = answer.meetings[k, 0], answer.meetings[k, 1], answer.meetings[k, 2]
        out[8], out[9], out[10] = answer.meetings[k, 4], answer.motion, length
        counts[N_FOUND] += 1
    if not is_open:
        counts[RUNG] = max(counts[RUNG], answer.rung)
        return False
    if counts[N_OPEN] == 0:
        counts[FIRST], counts[SECOND] = i, j
        for k in range(6):
            tally.place[k] = answer.box[k]
    counts[N_OPEN] += 1
    return True
