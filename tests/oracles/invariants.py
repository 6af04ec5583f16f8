"""Invariants that know nothing of motion: linking number, writhe, knot determinant; and the best rotation."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import combinations
from math import atan2, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oracles.exact import Number, cross, determinant, dot, exact_points, minus, plus, scaled, sign

Segment = tuple[list[Fraction], list[Fraction]]

SLOPES = [(Fraction(p, 1009), Fraction(q, 1013)) for p, q in ((37, 201), (-411, 89), (173, -307), (503, 61))]
"""Directions of projection (slope, slope, 1) to try; a generic one is wanted, and one in four will be."""


class NotGenericError(ValueError):
    """The projection has a crossing at a vertex or edges on top of each other: look from another side."""


def linking_number(a: ArrayLike, b: ArrayLike) -> float:
    """Return the Gauss linking number of two closed polygons, an integer up to rounding.

    (1/4π) ∬ (r1 - r2)·(dr1 × dr2)/|r1 - r2|³, edge by edge as the solid angle of a parallelogram.
    """
    one, other = _closed_edges(a), _closed_edges(b)
    return sum(_gauss_integral(*e, *f) for e in one for f in other)


def writhe(a: ArrayLike) -> float:
    """Return the writhe of a closed polygon: the Gauss integral of the polygon with itself.

    A self crossing of sign ±1 changes it by ±2 at its instant. Adjacent edges share a plane and add nothing.
    """
    edges = _closed_edges(a)
    n = len(edges)
    apart = ((i, j) for i, j in combinations(range(n), 2) if j - i not in (1, n - 1))
    return 2 * sum(_gauss_integral(*edges[i], *edges[j]) for i, j in apart)


def _closed_edges(points: ArrayLike) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    x = np.asarray(points, dtype=np.float64)
    return [(x[i - 1], x[i]) for i in range(len(x))]


def _gauss_integral(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], d: NDArray[np.float64]
) -> float:
    """Return (1/4π) of the Gauss integral of two edges.

    r1 - r2 runs over the parallelogram a-c, b-c, b-d, a-d; dr2 counts backwards in it, hence the minus.
    """
    corner = [p / np.linalg.norm(p) for p in (a - c, b - c, b - d, a - d)]
    angle = _solid_angle(corner[0], corner[1], corner[2]) + _solid_angle(corner[0], corner[2], corner[3])
    return -angle / (4 * pi)


def _solid_angle(p: NDArray[np.float64], q: NDArray[np.float64], r: NDArray[np.float64]) -> float:
    """Return the signed solid angle of three unit vectors (van Oosterom and Strackee, 1983)."""
    return 2 * atan2(float(p @ np.cross(q, r)), float(1 + p @ q + q @ r + r @ p))


class _Crossing(NamedTuple):
    """A crossing of a projection: the edges, their parameters, which is nearer, and the handedness."""

    edges: tuple[int, int]
    parameters: tuple[Fraction, Fraction]
    over: int  # 0 or 1
    sign: int


def linking_number_exact(a: Sequence[Sequence[Number]], b: Sequence[Sequence[Number]]) -> int:
    """Return the linking number as half the sum of the signs of the crossings in a projection, exactly."""
    one, other = _exact_edges(a), _exact_edges(b)
    for slopes in SLOPES:
        try:
            pairs = [(e, f, i, j) for i, e in enumerate(one) for j, f in enumerate(other)]
            total = sum(found.sign for found in _crossings(pairs, slopes))
        except NotGenericError:
            continue
        assert total % 2 == 0
        return total // 2
    raise NotGenericError("no generic direction among those tried")


def knot_determinant(a: Sequence[Sequence[Number]]) -> int:
    """Return |Δ(-1)| of a closed polygon: 1 for the unknot, 3 for the trefoil, 5 for the figure eight.

    The minor of the colouring matrix: 2·over - before - after = 0 at every crossing, one unknown for each arc
    from one undercrossing to the next. Exact.
    """
    edges = _exact_edges(a)
    n = len(edges)
    apart = [(i, j) for i, j in combinations(range(n), 2) if j - i not in (1, n - 1)]
    for slopes in SLOPES:
        try:
            found = list(_crossings([(edges[i], edges[j], i, j) for i, j in apart], slopes))
        except NotGenericError:
            continue
        return _colouring_determinant(found)
    raise NotGenericError("no generic direction among those tried")


def _colouring_determinant(found: list[_Crossing]) -> int:
    places = [tuple(zip(c.edges, c.parameters, strict=True)) for c in found]
    unders = sorted(place[1 - c.over] for c, place in zip(found, places, strict=True))
    n = len(unders)
    rows = []
    for c, place in zip(found, places, strict=True):
        row = [Fraction(0)] * n
        before = unders.index(place[1 - c.over])
        row[sum(under < place[c.over] for under in unders) % n] += 2
        row[before] -= 1
        row[(before + 1) % n] -= 1
        rows.append(row)
    return abs(int(determinant([row[1:] for row in rows[1:]])))


def _exact_edges(points: Sequence[Sequence[Number]]) -> list[Segment]:
    x = exact_points(points)
    return [(x[i], x[(i + 1) % len(x)]) for i in range(len(x))]


def _crossings(
    pairs: Sequence[tuple[Segment, Segment, int, int]], slopes: tuple[Fraction, Fraction]
) -> Iterator[_Crossing]:
    for e, f, i, j in pairs:
        found = _crossing_parameters(e, f, slopes)
        if found is not None:
            s, r = found
            u, v = minus(e[1], e[0]), minus(f[1], f[0])
            gap = minus(plus(e[0], scaled(s, u)), plus(f[0], scaled(r, v)))
            if gap[2] == 0:
                raise ValueError("the polygon meets itself or the other one")
            yield _Crossing((i, j), (s, r), int(gap[2] < 0), sign(dot(gap, cross(u, v))))


def _crossing_parameters(e: Segment, f: Segment, slopes: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction] | None:
    """Return where two edges cross in the projection along (slope, slope, 1), or None."""
    (a, b), (c, d) = ([_projected(p, slopes) for p in segment] for segment in (e, f))
    u, v, w = minus(b, a), minus(d, c), minus(c, a)
    area = _cross2(u, v)
    if area == 0:
        if _cross2(w, u) == 0 and _cross2(w, v) == 0:
            raise NotGenericError
        return None
    s, r = _cross2(w, v) / area, _cross2(w, u) / area
    if not (0 <= s <= 1 and 0 <= r <= 1):
        return None
    if s in (0, 1) or r in (0, 1):
        raise NotGenericError
    return s, r


def _projected(p: Sequence[Fraction], slopes: tuple[Fraction, Fraction]) -> list[Fraction]:
    return [p[0] - slopes[0] * p[2], p[1] - slopes[1] * p[2]]


def _cross2(p: Sequence[Fraction], q: Sequence[Fraction]) -> Fraction:
    return p[0] * q[1] - p[1] * q[0]


def best_rotation(x0: ArrayLike, x1: ArrayLike) -> NDArray[np.float64]:
    """Return R, det = +1, that makes Σ |R·(x1 - c1) - (x0 - c0)|² least (Kabsch; c are the centroids)."""
    p, q = (np.asarray(x, dtype=np.float64) - np.mean(x, axis=0) for x in (x0, x1))
    left, _, right = np.linalg.svd(p.T @ q)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return left @ flip @ right
