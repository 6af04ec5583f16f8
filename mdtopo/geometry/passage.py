"""Does one moving edge pass through another? Decided in floating point where its error bound allows (rung 7).

Edges a + s·u and c + r·v, with u = b - a, v = d - c, w = c - a linear in t, lie in one plane where the cubic
f(t) = det(a - c, u, v) is zero. With n = u×v ≠ 0 the lines then meet at s = (w×v)·n/n² and r = (w×u)·n/n². A passage is
a simple root of f in (0, 1) at which 0 < s < 1 and 0 < r < 1.

Every quantity carries a bound of its error: rounding, the rounding of the positions themselves, and the width of the
bracket that holds the root. What these bounds leave open is UNSURE, and decided by rational arithmetic
(`mdtopo.geometry.rational`) or not at all.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.pairs import Corners
from mdtopo.geometry.vectors import Vector, add, cross, dot, norm, scale, subtract

FREE, PASSES, UNSURE = 0, 1, 2

MOST_PASSAGES = 3
"""A cubic has no more roots."""

MOST_PIECES = 48
"""Pieces of [0, 1] that the search for roots may look at. Clear cases need a handful, hopeless ones end early."""

OFF_CENTRE = 0.4870129
"""Where an interval is cut: not in the middle, because made-up motions like to pass there, and a cut hides a root."""

WIDENINGS = 8
"""A bracket starts a few rounding errors wide, and grows by a factor of eight so many times at most."""

TIME_WIDTH = 1.5e-9
"""A passage whose time is not known this well in floating point is left to exact arithmetic. Half of it is what a time
may be off by: less than 1e-9 of a step."""

PLACED_TIME_WIDTH = 1e-7
"""And this well where positions were placed in a cell. By how much they are off is bounded for all edges of a step at
once, a hundred times above what rounding comes to: so times are as good there, but proved to 5e-8 only. With one width
for both, a third of the passages in a cell of 200 Å would need exact arithmetic, at 2 ms each."""

POLISH = 60
"""Steps to refine a root at most. Mostly four or five do; one that is not known well enough by then is left open."""

POLISHED = 0.125
"""A root is refined until f is this share of what arithmetic alone may be off by: then about twice the whole error over
the slope brackets it."""

UNDERFLOW = 1e-280
"""Added to the error of every product: below 1e-100 Å a product of three lengths has lost its digits, or is 0."""

Cubic = tuple[float, float, float, float]


class MovingPair(NamedTuple):
    """Differences of two moving edges: u, v, w at both ends, their greatest lengths, and the error of each.

    `far` is the greatest motion of any of the three, `width` how well the time of a passage must be known, and `share`
    what of the error is not that of placing.
    """

    u0: Vector
    v0: Vector
    w0: Vector
    u1: Vector
    v1: Vector
    w1: Vector
    u: float
    v: float
    w: float
    far: float
    error: float
    width: float
    share: float


@njit(cache=True, nogil=True)
def moving_pair(start: Corners, end: Corners, placing: float) -> MovingPair:
    """Return the differences of two moving edges; `placing` bounds the rounding of a difference of positions, Å."""
    u0, v0, w0 = subtract(start[1], start[0]), subtract(start[3], start[2]), subtract(start[2], start[0])
    u1, v1, w1 = subtract(end[1], end[0]), subtract(end[3], end[2]), subtract(end[2], end[0])
    u, v, w = longer(u0, u1), longer(v0, v1), longer(w0, w1)
    far = max(norm(subtract(u1, u0)), longer(subtract(v1, v0), subtract(w1, w0)))
    # a difference is rounded once, u·|x| per component; a factor of two covers the rounding of the lengths
    rounding, width = 4.0 * UNIT_ROUNDOFF * max(u, max(v, w)), PLACED_TIME_WIDTH if placing > 0.0 else TIME_WIDTH
    share = rounding / (placing + rounding) if placing > 0.0 else 1.0
    return MovingPair(u0, v0, w0, u1, v1, w1, u, v, w, far, placing + rounding, width, share)


@njit(cache=True, nogil=True)
def longer(a: Vector, b: Vector) -> float:
    """Return the greater one of two lengths, by one root."""
    return np.sqrt(max(dot(a, a), dot(b, b)))


@njit(cache=True, nogil=True)
def differences_at(pair: MovingPair, t: float) -> tuple[Vector, Vector, Vector]:
    """Return u, v and w at a time; rounding adds less than 8u of the greatest to their error."""
    return (
        add(scale(1.0 - t, pair.u0), scale(t, pair.u1)),
        add(scale(1.0 - t, pair.v0), scale(t, pair.v1)),
        add(scale(1.0 - t, pair.w0), scale(t, pair.w1)),
    )


@njit(cache=True, nogil=True)
def coplanarity(pair: MovingPair) -> tuple[Cubic, float]:
    """Return the Bernstein coefficients of f over [0, 1], and a bound of their error.

    Guarantee
    ---------
    Proven: f is trilinear in the three vectors. Errors e of these change a product of lengths by at most
    e·(uv + vw + wu) and terms of second order, for which a factor of two stands; rounding of a coefficient is below
    16u·|u||v||w|, and twice that is taken.
    """
    uv0, uv1 = cross(pair.u0, pair.v0), cross(pair.u1, pair.v1)
    mixed = add(cross(pair.u0, pair.v1), cross(pair.u1, pair.v0))
    b0, b3 = -dot(pair.w0, uv0), -dot(pair.w1, uv1)
    b1 = -(dot(pair.w1, uv0) + dot(pair.w0, mixed)) / 3.0
    b2 = -(dot(pair.w0, uv1) + dot(pair.w1, mixed)) / 3.0
    u, v, w = pair.u, pair.v, pair.w
    error = 2.0 * pair.error * (u * v + v * w + w * u) + 32.0 * UNIT_ROUNDOFF * u * v * w + UNDERFLOW
    return (b0, b1, b2, b3), error


@njit(cache=True, nogil=True)
def blossom(b: Cubic, p: float, q: float, r: float) -> float:
    """Return the polar form of a cubic; at (l,l,l), (l,l,h), … it is the Bernstein coefficients over [l, h]."""
    c0 = b[0] + p * (b[1] - b[0])
    c1 = b[1] + p * (b[2] - b[1])
    c2 = b[2] + p * (b[3] - b[2])
    d0, d1 = c0 + q * (c1 - c0), c1 + q * (c2 - c1)
    return d0 + r * (d1 - d0)


@njit(cache=True, nogil=True)
def value_and_slope(b: Cubic, t: float) -> tuple[float, float]:
    """Return a cubic and its derivative at t, from its Bernstein coefficients over [0, 1]."""
    c0 = b[0] + t * (b[1] - b[0])
    c1 = b[1] + t * (b[2] - b[1])
    c2 = b[2] + t * (b[3] - b[2])
    d0, d1 = c0 + t * (c1 - c0), c1 + t * (c2 - c1)
    return d0 + t * (d1 - d0), 3.0 * (d1 - d0)


@njit(cache=True, nogil=True)
def sign_beyond(value: float, error: float) -> int:
    """Return the sign of a value known up to an error, 0 where that hides it."""
    return 1 if value > error else (-1 if value < -error else 0)


@njit(cache=True, nogil=True)
def variations(low: int, second: int, third: int, high: int) -> int:
    """Return how many roots a cubic with these signs of Bernstein coefficients has: 0, 1, or -1 where they do not tell.

    By Descartes' rule the number of sign changes, or an even number less. A sign of 0 may stand for any.
    """
    if low == 0 or high == 0:
        return -1
    if low == high:
        return 0 if second == low and third == low else -1
    # opposite ends: any signs between give one change, unless they can make three: low, high, low, high
    return 1 if second == low or third == high else -1


@njit(cache=True, nogil=True)
def meeting(pair: MovingPair, low: float, high: float) -> tuple[int, float, float]:
    """Return whether the edges meet where they are coplanar at a time in [low, high], and their parameters there.

    Returns
    -------
    state : int
        PASSES where both parameters are inside at every such time, FREE where one is outside, else UNSURE.
    s, r : float
        Parameters at the middle.

    Guarantee
    ---------
    Proven: the vectors at the middle are off by at most their own error, rounding, and half the width of the interval
    times their motion; the products by the sums of what their factors are off by, of second order included.
    """
    u, v, w = differences_at(pair, 0.5 * (low + high))
    lu, lv, lw = norm(u), norm(v), norm(w)
    e = pair.error + 0.5000001 * (high - low) * pair.far + 8.0 * UNIT_ROUNDOFF * max(pair.u, max(pair.v, pair.w))
    n, wv, wu = cross(u, v), cross(w, v), cross(w, u)
    ln, lwv, lwu = norm(n), norm(wv), norm(wu)
    en = e * (lu + lv + e) + 8.0 * UNIT_ROUNDOFF * lu * lv
    ewv = e * (lw + lv + e) + 8.0 * UNIT_ROUNDOFF * lw * lv
    ewu = e * (lw + lu + e) + 8.0 * UNIT_ROUNDOFF * lw * lu
    nn, s, r = dot(n, n), dot(wv, n), dot(wu, n)
    guard = 1.0 + 64.0 * UNIT_ROUNDOFF
    enn = (en * (2.0 * ln + en) + 8.0 * UNIT_ROUNDOFF * nn) * guard + UNDERFLOW
    es = (ewv * ln + en * lwv + ewv * en + 8.0 * UNIT_ROUNDOFF * lwv * ln) * guard + UNDERFLOW
    er = (ewu * ln + en * lwu + ewu * en + 8.0 * UNIT_ROUNDOFF * lwu * ln) * guard + UNDERFLOW
    if s < -es or r < -er or s - nn > es + enn or r - nn > er + enn:
        return FREE, 0.0, 0.0
    if s > es and r > er and nn - s > es + enn and nn - r > er + enn:
        return PASSES, s / nn, r / nn
    return UNSURE, 0.0, 0.0


@njit(cache=True, nogil=True)
def bracketed_root(b: Cubic, error: float, share: float, low: float, high: float) -> tuple[float, float]:
    """Return a narrow bracket of the one root in (low, high), with certain and opposite signs at its ends.

    Where rounding hides a sign next to the root, the bracket stays as wide as it came. For `share` see `MovingPair`:
    the middle of the bracket is as good as arithmetic allows.
    """
    f_low, f_high = blossom(b, low, low, low), blossom(b, high, high, high)
    x, y, slope, rises = low, high, 0.0, f_high > f_low
    t = low - f_low * (high - low) / (f_high - f_low)
    for k in range(POLISH):
        # Newton's step, or bisection where that leads out of the bracket, and now and then anyway
        if not x < t < y or k % 6 == 5:
            t = 0.5 * (x + y)
        f, slope = value_and_slope(b, t)
        if abs(f) <= POLISHED * share * error or (y - x) < 4.0 * UNIT_ROUNDOFF:
            break
        if (f > 0.0) == rises:
            y = t
        else:
            x = t
        t = t - f / slope if slope != 0.0 else x
    t = min(max(t, x), y)
    slope = abs(slope)  # of the derivative the size counts, and that only as a guess: below the signs decide
    width = ((1.0 + 2.0 * POLISHED) * error / slope if slope > 0.0 else high - low) + 4.0 * UNIT_ROUNDOFF
    for _ in range(WIDENINGS):
        x, y = max(t - width, low), min(t + width, high)
        if sign_beyond(blossom(b, x, x, x), error) * sign_beyond(blossom(b, y, y, y), error) < 0:
            return x, y
        width *= 8.0
    return low, high


@njit(cache=True, nogil=True)
def passages(start: Corners, end: Corners, placing: float) -> tuple[int, int, tuple[Vector, Vector, Vector], int]:
    """Return whether one moving edge passes through another, and where.

    Parameters
    ----------
    start, end : Corners
        a, b, c, d at both ends, Å.
    placing : float
        Rounding of a difference of two positions, Å; 0 for stored coordinates.

    Returns
    -------
    state : int
        FREE: the edges never meet. PASSES: all meetings are passages, and listed. UNSURE: not decided.
    count : int
        How many passages are listed, in order of time; with UNSURE none.
    found : tuple of three (t, s, r)
        Time and parameters on the two edges.
    signs : int
        Bit k is set where f rises at passage k.

    Guarantee
    ---------
    Proven, whatever the positions are within `placing`.
    """
    pair = moving_pair(start, end, placing)
    b, error = coplanarity(pair)
    greatest = max(max(abs(b[0]), abs(b[1])), max(abs(b[2]), abs(b[3])))
    error += 32.0 * UNIT_ROUNDOFF * greatest  # of the polar form
    none = (0.0, 0.0, 0.0)
    if not greatest < np.inf:
        return UNSURE, 0, (none, none, none), 0
    s0, s3 = sign_beyond(b[0], error), sign_beyond(b[3], error)
    roots = variations(s0, sign_beyond(b[1], error), sign_beyond(b[2], error), s3)
    if roots == 0:
        return FREE, 0, (none, none, none), 0
    if roots == 1:
        state, event = passage_within(pair, b, error, 0.0, 1.0)
        return state, int(state == PASSES), (event, none, none), int(s3 > 0)
    return passages_in_pieces(pair, b, error)


@njit(cache=True, nogil=True)
def passage_within(pair: MovingPair, b: Cubic, error: float, low: float, high: float) -> tuple[int, Vector]:
    """Return whether the edges meet at the one root of f in (low, high), and time and parameters there."""
    x, y = bracketed_root(b, error, pair.share, low, high)
    state, s, r = meeting(pair, x, y)
    if state == PASSES and y - x > pair.width:
        state = UNSURE
    return state, (0.5 * (x + y), s, r)


@njit(cache=True, nogil=True)
def passages_in_pieces(pair: MovingPair, b: Cubic, error: float) -> tuple[int, int, tuple[Vector, Vector, Vector], int]:
    """Return what `passages` does where the signs over the whole step do not tell how many roots f has."""
    lows, highs, none = np.empty(MOST_PIECES), np.empty(MOST_PIECES), (0.0, 0.0, 0.0)
    found, count, signs = (none, none, none), 0, 0
    depth = 1
    lows[0], highs[0] = 0.0, 1.0
    for _ in range(MOST_PIECES):
        if depth == 0:
            return (PASSES if count > 0 else FREE), count, found, signs
        depth -= 1
        low, high = lows[depth], highs[depth]
        b0, b3 = blossom(b, low, low, low), blossom(b, high, high, high)
        s0, s3 = sign_beyond(b0, error), sign_beyond(b3, error)
        s1 = sign_beyond(blossom(b, low, low, high), error)
        s2 = sign_beyond(blossom(b, low, high, high), error)
        roots = variations(s0, s1, s2, s3)
        if roots == 0:
            continue
        if roots == 1:
            state, event = passage_within(pair, b, error, low, high)
            if state == FREE:
                continue
            if state == UNSURE or count == MOST_PASSAGES:
                return UNSURE, 0, found, 0
            found = (
                event if count == 0 else found[0],
                event if count == 1 else found[1],
                event if count == 2 else found[2],
            )
            signs |= (1 << count) if s3 > 0 else 0
            count += 1
            continue
        state, _, _ = meeting(pair, low, high)
        if state == FREE:
            continue
        if high - low < 1e-12 or depth + 2 > MOST_PIECES:
            return UNSURE, 0, found, 0
        middle = low + OFF_CENTRE * (high - low)
        lows[depth], highs[depth] = middle, high  # the earlier half is looked at first
        lows[depth + 1], highs[depth + 1] = low, middle
        depth += 2
    return UNSURE, 0, found, 0
