"""The certificate of a moving smooth curve over all of its segments in one step.

Every segment is asked whether it meets itself (S1), every joint whether its two segments meet elsewhere (S2), and every
pair of segments that share no point whether they meet (S3). Nearly all pairs are settled by the chord: a segment stays
within r of its chord, r the greatest distance of a control point from the matching chord point at either end.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import candidate_pairs
from mdtopo.geometry.distances import LEAST_SQUARE, UNIT_ROUNDOFF
from mdtopo.geometry.hull import hull_distance
from mdtopo.geometry.lattice import basis_of, lattice_vector
from mdtopo.geometry.subdivision import JOINT, PAIR, SELF, climb, settle, vectors_of
from mdtopo.geometry.vectors import Vector, add, dot, norm, row, scale, subtract
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BALL, TWO_FRAME_BALL, BROAD_PHASE, OPEN = (
    int(Rung.BALL),
    int(Rung.TWO_FRAME_BALL),
    int(Rung.BROAD_PHASE),
    int(Rung.OPEN),
)

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


class Tally(NamedTuple):
    """What is being collected, in place: `numbers` clearance; `counts` rung, depth, open, found, pair, first open."""

    numbers: FloatArray
    counts: IntArray
    place: FloatArray
    found: FloatArray


CLEARANCE, LEAST_START = 0, 1
RUNG, DEPTH, N_OPEN, N_FOUND, FIRST, SECOND = 0, 1, 2, 3, 4, 5


@njit(cache=True, nogil=True)
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
    greatest = greatest_of(c0, c1, cell0, cell1, periodic)
    found = np.empty((0, FOUND_WIDTH))
    t = Tally(
        np.full(2, np.inf), np.full(6, -1, dtype=np.int64), np.full(6, np.nan), np.empty((MOST_FOUND, FOUND_WIDTH))
    )
    t.counts[RUNG], t.counts[DEPTH], t.counts[N_OPEN], t.counts[N_FOUND] = BROAD_PHASE, 0, 0, 0
    margins = hodograph_margins(c0, c1, slack)
    check_segments(c0, c1, following, slack, greatest, t)
    countable = check_pairs(c0, c1, following, cell0, cell1, periodic, slack, greatest, t)
    found = t.found[: t.counts[N_FOUND]].copy()
    rung = t.counts[RUNG]
    if t.counts[N_OPEN] > 0 or not countable:
        rung = OPEN
    clearance = t.numbers[CLEARANCE] if countable else 0.0
    if t.counts[N_OPEN] > 0 or len(found) > 0:
        clearance = 0.0
    return CurveMeasure(
        margins[0],
        int(margins[1]),
        margins[2],
        margins[3],
        margins[4],
        clearance,
        rung,
        t.counts[DEPTH],
        t.counts[FIRST:].copy(),
        t.counts[N_OPEN],
        t.place,
        found,
        countable,
    )


@njit(cache=True, nogil=True)
def greatest_of(c0: FloatArray, c1: FloatArray, cell0: FloatArray, cell1: FloatArray, periodic: bool) -> float:
    """Return the greatest coordinate that a control point or its image can have, Å."""
    greatest = 0.0
    for points in (c0, c1):
        for k in range(points.shape[0]):
            for i in range(points.shape[1]):
                for axis in range(3):
                    greatest = max(greatest, abs(points[k, i, axis]))
    if periodic:
        for cell in (cell0, cell1):
            for k in range(3):
                greatest += 4.0 * norm(row(cell, k))
    return greatest


@njit(cache=True, nogil=True)
def hodograph_margins(c0: FloatArray, c1: FloatArray, slack: float) -> tuple[float, float, float, float, float]:
    """Return least d* with its segment, greatest sound ratio, least margin and greatest printed ratio.

    A segment is measured in full only where a cheap bound of its d* does not show that it changes none of them.
    """
    m, n = c0.shape[0], c0.shape[1] - 1
    d_star, segment, ratio, margin, printed = np.inf, -1, 0.0, np.inf, 0.0
    v = np.empty((n, 3))
    for k in range(m):
        moved, turned = 0.0, 0.0
        before = subtract(row(c1[k], 0), row(c0[k], 0))
        moved = dot(before, before)
        chord = subtract(row(c0[k], n), row(c0[k], 0))
        least = np.inf
        for i in range(n):
            q = subtract(row(c0[k], i + 1), row(c0[k], i))
            v[i, 0], v[i, 1], v[i, 2] = q
            least = min(least, dot(chord, q))
            after = subtract(row(c1[k], i + 1), row(c0[k], i + 1))
            moved = max(moved, dot(after, after))
            change = subtract(after, before)
            turned = max(turned, dot(change, change))
            before = after
        length = norm(chord)
        low = least / length - 2.0 * slack if length > 1e-140 else 0.0
        moved, turned = np.sqrt(moved), np.sqrt(turned)
        if low > d_star and turned <= ratio * low and low - turned > margin and moved <= printed * low:
            continue
        exact = max(hull_distance(v) - 2.0 * slack, 0.0)
        if exact < d_star:
            d_star, segment = exact, k
        margin = min(margin, exact - turned)
        ratio = max(ratio, turned / exact if exact > 0.0 else (np.inf if turned > 0.0 else 0.0))
        printed = max(printed, moved / exact if exact > 0.0 else (np.inf if moved > 0.0 else 0.0))
    return d_star, float(segment), ratio, margin, printed


@njit(cache=True, nogil=True)
def check_segments(
    c0: FloatArray, c1: FloatArray, following: IntArray, slack: float, greatest: float, t: Tally
) -> None:
    """Check every segment against itself, and every joint (S1 and S2)."""
    m, n = c0.shape[0], c0.shape[1] - 1
    v = np.empty((2 * (n + 1) * (n + 1), 3))
    for k in range(m):
        chord = add(subtract(row(c0[k], n), row(c0[k], 0)), subtract(row(c1[k], n), row(c1[k], 0)))
        if not hodograph_points_along(c0[k], c1[k], chord, slack):
            settle_or_open(SELF, k, k, (0, 0, 0), c0[k], c1[k], c0[k], c1[k], slack, greatest, v, t)
        after = following[k]
        if after >= 0:
            other = add(subtract(row(c0[after], n), row(c0[after], 0)), subtract(row(c1[after], n), row(c1[after], 0)))
            if not joint_points_along(c0[k], c1[k], c0[after], c1[after], add(chord, other), slack):
                settle_or_open(JOINT, k, after, (0, 0, 0), c0[k], c1[k], c0[after], c1[after], slack, greatest, v, t)


@njit(cache=True, nogil=True)
def proves(least: float, w: Vector, longest: float, slack: float) -> bool:
    """Return whether min w·v = `least` keeps the origin out, the v being off by 2·slack and by their rounding."""
    size = norm(w)
    return least > size * (2.0 * slack + 16.0 * UNIT_ROUNDOFF * longest) + LEAST_SQUARE


@njit(cache=True, nogil=True)
def hodograph_points_along(p0: FloatArray, p1: FloatArray, w: Vector, slack: float) -> bool:
    """Return whether all differences at both ends point along w: then the segment never meets itself."""
    least, longest = np.inf, 0.0
    for points in (p0, p1):
        for i in range(len(points) - 1):
            q = subtract(row(points, i + 1), row(points, i))
            least, longest = min(least, dot(w, q)), max(longest, dot(q, q))
    return proves(least, w, np.sqrt(longest), slack)


@njit(cache=True, nogil=True)
def joint_points_along(a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray, w: Vector, slack: float) -> bool:
    """Return whether two segments stay on either side of their joint along w, at both ends."""
    least, longest, n = np.inf, 0.0, len(a0) - 1
    for end in range(2):
        a, b = (a0, b0) if end == 0 else (a1, b1)
        joint = row(a, n)
        for i in range(n):
            q = subtract(joint, row(a, i))
            least, longest = min(least, dot(w, q)), max(longest, dot(q, q))
            q = subtract(row(b, i + 1), joint)
            least, longest = min(least, dot(w, q)), max(longest, dot(q, q))
    return proves(least, w, np.sqrt(longest), slack)


@njit(cache=True, nogil=True)
def settle_or_open(
    kind: int,
    i: int,
    j: int,
    image: tuple[int, int, int],
    a0: FloatArray,
    a1: FloatArray,
    b0: FloatArray,
    b1: FloatArray,
    slack: float,
    greatest: float,
    v: FloatArray,
    t: Tally,
) -> float:
    """Settle one check by hulls, or by halving, note what comes of it, and return its clearance."""
    count = vectors_of(kind, a0, b0, v)
    vectors_of(kind, a1, b1, v[count:])
    clearance, rung, _, _, rho = climb(v, count, 2.0 * slack)
    if clearance > 0.0:
        t.counts[RUNG] = max(t.counts[RUNG], rung)
        return clearance
    if t.counts[N_OPEN] >= MOST_OPEN:
        t.counts[N_OPEN] += 1
        return 0.0
    answer = settle(kind, a0, a1, b0, b1, slack, greatest)
    t.counts[DEPTH] = max(t.counts[DEPTH], answer.depth)
    is_open = answer.rung == OPEN
    for k in range(len(answer.meetings)):
        if t.counts[N_FOUND] == MOST_FOUND:
            is_open = True
            break
        out = t.found[t.counts[N_FOUND]]
        out[0], out[1] = i, j
        out[2], out[3], out[4] = image
        out[5], out[6], out[7] = answer.meetings[k, 0], answer.meetings[k, 1], answer.meetings[k, 2]
        out[8], out[9] = answer.meetings[k, 4], rho
        n = len(a0) - 1
        length = min(norm(subtract(row(a0, n), row(a0, 0))), norm(subtract(row(a1, n), row(a1, 0))))
        other = min(norm(subtract(row(b0, n), row(b0, 0))), norm(subtract(row(b1, n), row(b1, 0))))
        out[10] = min(length, other)
        t.counts[N_FOUND] += 1
    if is_open:
        if t.counts[N_OPEN] == 0:
            t.counts[FIRST], t.counts[SECOND] = i, j
            t.place[:] = answer.box
        t.counts[N_OPEN] += 1
        return 0.0
    t.counts[RUNG] = max(t.counts[RUNG], answer.rung)
    return answer.clearance


@njit(cache=True, nogil=True)
def check_pairs(
    c0: FloatArray,
    c1: FloatArray,
    following: IntArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
    slack: float,
    greatest: float,
    t: Tally,
) -> bool:
    """Check all pairs of segments that share no point (S3), and return whether images could be counted."""
    m, n = c0.shape[0], c0.shape[1] - 1
    mid0, mid1, half0, half1 = np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 3))
    radii, away = np.empty(m), np.empty(m)
    reach = 0.0
    for k in range(m):
        reach += norm(subtract(row(c0[k], n), row(c0[k], 0))) / m
        away[k] = 0.0
        radii[k] = 0.0
        for end in range(2):
            points = c0[k] if end == 0 else c1[k]
            mid, half = (mid0, half0) if end == 0 else (mid1, half1)
            p, q = row(points, 0), row(points, n)
            centre, span = scale(0.5, add(p, q)), scale(0.5, subtract(q, p))
            mid[k, 0], mid[k, 1], mid[k, 2] = centre
            half[k, 0], half[k, 1], half[k, 2] = span
            for i in range(n + 1):
                d = subtract(row(points, i), centre)
                radii[k] = max(radii[k], dot(d, d))
                d = subtract(d, scale(2.0 * i / n - 1.0, span))
                away[k] = max(away[k], dot(d, d))
        radii[k], away[k] = np.sqrt(radii[k]), np.sqrt(away[k])
    rounding = slack + 64.0 * UNIT_ROUNDOFF * greatest + 1e-140
    padded = radii + (0.5 * reach + rounding)
    pairs, images, countable = candidate_pairs(mid0, mid1, padded, cell0, cell1, periodic)
    t.numbers[CLEARANCE] = reach if m > 1 else np.inf
    if not countable:
        return False
    basis0, basis1 = basis_of(cell0), basis_of(cell1)
    image = (0, 0, 0)
    shift0, shift1 = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    v = np.empty((2 * (n + 1) * (n + 1), 3))
    b0, b1 = np.empty((n + 1, 3)), np.empty((n + 1, 3))
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        if len(images) > 0:
            image = (images[k, 0], images[k, 1], images[k, 2])
        if image == (0, 0, 0):
            if i == j or following[i] == j or following[j] == i:
                continue
            shift0 = shift1 = (0.0, 0.0, 0.0)
        else:
            shift0, shift1 = lattice_vector(image, basis0), lattice_vector(image, basis1)
        centre0 = add(subtract(row(mid0, j), row(mid0, i)), shift0)
        centre1 = add(subtract(row(mid1, j), row(mid1, i)), shift1)
        w = add(centre0, centre1)
        length = norm(w)
        start = dot(w, centre0) - abs(dot(w, row(half0, i))) - abs(dot(w, row(half0, j)))
        finish = dot(w, centre1) - abs(dot(w, row(half1, i))) - abs(dot(w, row(half1, j)))
        # of the slabs that hold the chords, less how far the segments may stray from these
        need = away[i] + away[j] + 4.0 * rounding
        if min(start, finish) > length * (need + t.numbers[CLEARANCE]) * (1.0 + 1e-12) and length > 1e-100:
            continue
        for c in range(n + 1):
            b0[c, 0], b0[c, 1], b0[c, 2] = add(row(c0[j], c), shift0)
            b1[c, 0], b1[c, 1], b1[c, 2] = add(row(c1[j], c), shift1)
        clearance = separation_along(c0[i], c1[i], b0, b1, w, rounding)
        if clearance > t.numbers[CLEARANCE]:
            continue
        sharper = settle_or_open(PAIR, i, j, image, c0[i], c1[i], b0, b1, rounding, greatest, v, t)
        clearance = max(clearance, sharper)
        if clearance < t.numbers[CLEARANCE]:
            t.numbers[CLEARANCE] = clearance
            if t.counts[N_OPEN] == 0:
                t.counts[FIRST], t.counts[SECOND] = i, j
    return True


@njit(cache=True, nogil=True)
def separation_along(
    a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray, w: Vector, rounding: float
) -> float:
    """Return how far two segments stay apart along w, a proven lower bound of their distance, Å; else 0 or less."""
    size = norm(w)
    if not size > 1e-100:
        return 0.0
    best = np.inf
    for end in range(2):
        a, b = (a0, b0) if end == 0 else (a1, b1)
        low, high = np.inf, -np.inf
        for i in range(len(a)):
            high = max(high, dot(w, row(a, i)))
            low = min(low, dot(w, row(b, i)))
        best = min(best, low - high)
    return best / size - 4.0 * rounding
