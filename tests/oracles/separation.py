"""Moving edges that provably never meet: a fast judge of the many clear cases, and exact in what it says.

Edges ab and cd are apart during a piece of the step if one direction w has w·p > w·q for p in {a, b} and q in {c, d} at
both ends of the piece, because every w·(p - q) is linear in time. Floats only propose w; the inequalities are decided
in integers, in the unit in which a pair's coordinates are whole numbers. What is not shown apart here may be so still:
`oracles.passages` decides.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Whole = NDArray[Any]  # of Python integers

MANTISSA_BITS = 53
DIRECTION_BITS = 52


def apart(x0: Points, x1: Points, *, halvings: int = 3) -> NDArray[np.bool_]:
    """Return where the edges ab and cd are shown to be apart all the time from x0 to x1.

    Parameters
    ----------
    x0, x1 : ndarray, shape (n, 4, 3)
        Points a, b, c, d at the start and at the end.
    halvings : int
        How often a piece of the step that is not settled is cut in two.

    Guarantee
    ---------
    Proven where True. False says nothing.
    """
    whole = _whole_numbers(np.stack([x0, x1], axis=1))
    corners = _corners(x0, x1)
    settled = np.ones(len(x0), dtype=np.bool_)
    pair, piece = np.arange(len(x0)), np.zeros(len(x0), dtype=np.int64)
    for level in range(halvings + 1):
        ends = [(piece + k) / 2**level for k in (0, 1)]
        direction = _direction(*(_between(corners[pair], t) for t in ends))
        points = [_at(whole[pair], piece + k, 2**level) for k in (0, 1)]
        is_open = ~(_on_one_side(points[0], direction) & _on_one_side(points[1], direction))
        pair, piece = np.repeat(pair[is_open], 2), np.repeat(2 * piece[is_open], 2)
        piece[1::2] += 1
        if not len(pair):
            break
    settled[pair] = False
    return settled


def _whole_numbers(x: Points) -> Whole:
    """Return all coordinates of each pair as integers, in the greatest power of two that does for it."""
    mantissa, exponent = np.frexp(x)
    digits = (mantissa * 2.0**MANTISSA_BITS).astype(np.int64)
    lowest = np.where(digits != 0, exponent, np.iinfo(exponent.dtype).max).min(axis=(1, 2, 3), keepdims=True)
    shift = np.where(digits != 0, exponent - lowest, 0)
    return np.asarray(digits.astype(object) << shift.astype(object))


def _at(whole: Whole, numerator: NDArray[np.int64], denominator: int) -> Whole:
    """Return the points at the time numerator / denominator, times the denominator: (n, 4, 3)."""
    k = numerator.astype(object)[:, np.newaxis, np.newaxis]
    return np.asarray(whole[:, 0] * (denominator - k) + whole[:, 1] * k)


def _on_one_side(points: Whole, direction: Whole) -> NDArray[np.bool_]:
    height = (points * direction[:, np.newaxis]).sum(axis=2)
    return (height[:, :2].min(axis=1) > height[:, 2:].max(axis=1)).astype(np.bool_)


def _corners(x0: Points, x1: Points) -> Points:
    """Return {a-c, a-d, b-c, b-d} at both ends, each pair in its own unit: (n, 2, 4, 3)."""
    x = np.stack([x0, x1], axis=1)
    corners = (x[:, :, :2, np.newaxis] - x[:, :, np.newaxis, 2:]).reshape(-1, 2, 4, 3)
    size = np.abs(corners).max(axis=(1, 2, 3), keepdims=True)
    return np.asarray(corners / np.where(size > 0, size, 1.0))


def _between(corners: Points, t: Points) -> Points:
    t = t[:, np.newaxis, np.newaxis]
    return np.asarray((1.0 - t) * corners[:, 0] + t * corners[:, 1])


def _direction(start: Points, end: Points) -> Whole:
    """Return the most promising direction for each piece, in integers: (n, 3)."""
    tries = np.concatenate([_nearest(v) for v in (start, 0.5 * (start + end), end)], axis=1)
    tries = _divided(tries, np.linalg.norm(tries, axis=2, keepdims=True))
    margins = (tries @ np.concatenate([start, end], axis=1).transpose(0, 2, 1)).min(axis=2)
    best = tries[np.arange(len(tries)), margins.argmax(axis=1)]
    return np.asarray(np.rint(best * 2.0**DIRECTION_BITS).astype(np.int64).astype(object))


def _nearest(v: Points) -> Points:
    """Return nine vectors, (n, 9, 3), among them the one to the point of the parallelogram v nearest to the origin.

    It is perpendicular to the plane, or to one of the four sides, or goes to a corner.
    """
    one, other = v[:, 2] - v[:, 0], v[:, 1] - v[:, 0]
    normal = np.cross(one, other)[:, np.newaxis]
    normal = normal * np.where((normal * v).sum(axis=2).sum(axis=1) < 0, -1.0, 1.0)[:, np.newaxis, np.newaxis]
    sides = [_across(v[:, k], side) for k, side in ((0, one), (1, one), (0, other), (2, other))]
    return np.concatenate([normal, np.stack(sides, axis=1), v], axis=1)


def _across(p: Points, side: Points) -> Points:
    """Return the part of p that is perpendicular to a side."""
    share = _divided((p * side).sum(axis=1, keepdims=True), (side * side).sum(axis=1, keepdims=True))
    return np.asarray(p - share * side)


def _divided(x: Points, y: Points) -> Points:
    return np.divide(x, y, out=np.zeros_like(x), where=y > 0)
