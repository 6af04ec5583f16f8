"""Distances by going through every active set, and ν with the terms it runs over."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import combinations, pairwise
from math import comb, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oracles.exact import Number, dot, exact_points, minus, plus, scaled, solve
from oracles.lattice import Shift, shifts_within

ROUND = 1e-12
"""Barycentric coordinates this far below zero are still zero: a few hundred units in the last place of 1."""

Edge = tuple[int, int]


def squared_edge_distance(a: Sequence[Any], b: Sequence[Any], c: Sequence[Any], d: Sequence[Any]) -> Any:
    """Return the squared distance of the segments ab and cd in whatever numbers come in.

    The nearest points are both inside their segments, or one is an end, or both are; so the least distance is
    the least of one, four and four candidates, each of which is the distance of two points of the segments.
    """
    ends = [(p, q) for p in (a, b) for q in (c, d)]
    candidates = [_squared(minus(p, q)) for p, q in ends]
    candidates += [_squared_to_foot(p, c, d) for p in (a, b)] + [_squared_to_foot(q, a, b) for q in (c, d)]
    candidates.append(_squared_inside(a, b, c, d))
    return min(value for value in candidates if value is not None)


def _squared(v: Sequence[Any]) -> Any:
    return dot(v, v)


def _squared_to_foot(p: Sequence[Any], q: Sequence[Any], r: Sequence[Any]) -> Any:
    """Return the squared distance of p to its foot on the line qr, None where that is not on the segment."""
    e = minus(r, q)
    length, along = _squared(e), dot(minus(p, q), e)
    if not 0 < along < length:
        return None
    return _squared(minus(p, plus(q, scaled(along / length, e))))


def _squared_inside(a: Sequence[Any], b: Sequence[Any], c: Sequence[Any], d: Sequence[Any]) -> Any:
    """Return the squared distance of the two lines, None where their nearest points are not on the segments.

    Least squares of a + s·u = c + r·v, by Cramer's rule; w = c - a.
    """
    u, v, w = minus(b, a), minus(d, c), minus(c, a)
    uu, uv, vv, uw, vw = dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)
    det = uu * vv - uv * uv
    if det <= 0:
        return None
    s, r = (uw * vv - vw * uv) / det, (uw * uv - vw * uu) / det
    if not (0 <= s <= 1 and 0 <= r <= 1):
        return None
    return _squared(minus(plus(a, scaled(s, u)), plus(c, scaled(r, v))))


def edge_distance(p0: ArrayLike, p1: ArrayLike, q0: ArrayLike, q1: ArrayLike) -> float:
    """Return the distance of the segments p0p1 and q0q1 in floating point."""
    points = (np.asarray(p, dtype=np.float64).tolist() for p in (p0, p1, q0, q1))
    return sqrt(squared_edge_distance(*points))


def squared_edge_distance_exact(
    p0: Sequence[Number], p1: Sequence[Number], q0: Sequence[Number], q1: Sequence[Number]
) -> Fraction:
    """Return the squared distance of the two segments exactly."""
    return Fraction(squared_edge_distance(*exact_points([p0, p1, q0, q1])))


def hull_distance(points: ArrayLike) -> float:
    """Return the distance of the origin to conv(points) in 2D or 3D, by all small enough subsets.

    The nearest point lies inside the hull of an affinely independent subset and is the point of least norm of
    its affine hull, λ0 p0 + … with λ ≥ 0; so it is the least norm over all subsets for which λ ≥ 0 comes out.
    """
    p = np.asarray(points, dtype=np.float64)
    sizes = range(1, min(len(p), p.shape[1] + 1) + 1)
    return float(min(_least_norms(p, size).min(initial=np.inf) for size in sizes))


def _least_norms(p: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return the norms of the points of least norm for all subsets of one size that hold them."""
    index = np.fromiter(combinations(range(len(p)), size), dtype=(np.int64, size), count=comb(len(p), size))
    base, spread = p[index[:, 0]], np.swapaxes(p[index[:, 1:]] - p[index[:, :1]], 1, 2)
    weights = -(np.linalg.pinv(spread) @ base[:, :, None])[:, :, 0] if size > 1 else np.zeros((len(p), 0))
    weights = np.column_stack([1 - weights.sum(axis=1), weights])
    inside = (weights >= -ROUND).all(axis=1)
    clipped = np.clip(weights[inside], 0, None)
    clipped /= clipped.sum(axis=1, keepdims=True)
    return np.linalg.norm(np.einsum("nk,nkd->nd", clipped, p[index[inside]]), axis=1)


def squared_hull_distance_exact(points: Sequence[Sequence[Number]]) -> Fraction:
    """Return the squared distance of the origin to conv(points): `hull_distance` in rational numbers."""
    exact = exact_points(points)
    sizes = range(1, min(len(exact), len(exact[0]) + 1) + 1)
    subsets = (subset for size in sizes for subset in combinations(exact, size))
    return min(value for value in map(_squared_least_norm, subsets) if value is not None)


def _squared_least_norm(points: Sequence[Sequence[Fraction]]) -> Fraction | None:
    """Return the squared least norm over the affine hull; None where outside conv or the points dependent."""
    spread = [minus(p, points[0]) for p in points[1:]]
    weights = solve([[dot(e, f) for f in spread] for e in spread], [-dot(e, points[0]) for e in spread])
    if weights is None or min([1 - sum(weights), *weights]) < 0:
        return None
    nearest = points[0]
    for weight, e in zip(weights, spread, strict=True):
        nearest = plus(nearest, scaled(weight, e))
    return Fraction(_squared(nearest))


def sampled_distance_during(pair0: ArrayLike, pair1: ArrayLike, *, n: int = 201) -> float:
    """Return the least edge distance over n times in [0, 1]: an upper bound of a moving pair's clearance.

    A pair is its two edges, [[a, b], [c, d]], shape (2, 2, 3), at the start and at the end.
    """
    return min(_distance_at(pair0, pair1, t) for t in np.linspace(0, 1, n))


def least_distance_during(pair0: ArrayLike, pair1: ArrayLike, *, tolerance: float = 1e-6) -> tuple[float, float]:
    """Return a lower and an upper bound of the least distance during the motion, `tolerance` apart at most.

    Branch and bound: the distance is ρ-Lipschitz in t with ρ the greatest relative displacement of the corner
    differences, so a piece of length h stays above (d0 + d1 - ρh)/2.
    """
    ends = np.asarray(pair0, dtype=np.float64), np.asarray(pair1, dtype=np.float64)
    move = ends[1] - ends[0]
    rho = max(float(np.linalg.norm(p - q)) for p in move[0] for q in move[1])
    times = np.linspace(0, 1, 33)
    start = [_distance_at(*ends, t) for t in times]
    pieces = list(zip(times[:-1], times[1:], start[:-1], start[1:], strict=True))
    low, high = np.inf, min(start)
    while pieces:
        t0, t1, d0, d1 = pieces.pop()
        bound = max((d0 + d1 - rho * (t1 - t0)) / 2, 0.0)
        if bound >= high - tolerance:
            low = min(low, bound)
            continue
        t = (t0 + t1) / 2
        d = _distance_at(*ends, t)
        high = min(high, d)
        pieces += [(t0, t, d0, d), (t, t1, d, d1)]
    return float(min(low, high)), float(high)


def _distance_at(pair0: ArrayLike, pair1: ArrayLike, t: float) -> float:
    (a, b), (c, d) = (1 - t) * np.asarray(pair0, dtype=np.float64) + t * np.asarray(pair1, dtype=np.float64)
    return edge_distance(a, b, c, d)


class Term(NamedTuple):
    """Two disjoint members of strands, each as the pair of its vertices; a vertex v is (v, v)."""

    first: Edge
    second: Edge
    kind: str  # "local", "self" or "inter"


class Separation(NamedTuple):
    """ν, the pair that has it, the image of the second member, and the pair's class."""

    value: float
    first: Edge
    second: Edge
    shift: Shift
    kind: str


def strand_edges(start: int, stop: int, closed: bool) -> list[Edge]:
    """Return the edges of one strand in order; a ring's closing edge comes last."""
    edges = [(i, i + 1) for i in range(start, stop - 1)]
    return [*edges, (stop - 1, start)] if closed else edges


def disjoint_terms(offsets: Sequence[int], closed: Sequence[bool]) -> list[Term]:
    """Return the pairs over which ν is the least distance.

    Non-adjacent edges of each strand; of an open strand also its four end terms (each end vertex against its
    neighbour, and against the edge from that neighbour onwards); of a triangle each vertex against the
    opposite edge; every two edges of different strands. Local: pairs two edges apart, end and triangle terms.
    """
    strands = [range(int(i), int(j)) for i, j in pairwise(offsets)]
    edges = [strand_edges(s.start, s.stop, bool(ring)) for s, ring in zip(strands, closed, strict=True)]
    terms: list[Term] = []
    for vertices, own, ring in zip(strands, edges, closed, strict=True):
        terms += _edge_terms(own, bool(ring))
        terms += (_triangle_terms(vertices) if len(vertices) == 3 else []) if ring else _end_terms(vertices)
    for one, other in combinations(edges, 2):
        terms += [Term(e, f, "inter") for e in one for f in other]
    return terms


def _edge_terms(edges: list[Edge], ring: bool) -> Iterator[Term]:
    for i, j in combinations(range(len(edges)), 2):
        apart = min(j - i, len(edges) - (j - i)) if ring else j - i
        if not set(edges[i]) & set(edges[j]):
            yield Term(edges[i], edges[j], "local" if apart == 2 else "self")


def _end_terms(vertices: range) -> Iterator[Term]:
    for order in (vertices, vertices[::-1]):
        end, neighbour = order[0], order[1]
        if end < neighbour or len(vertices) > 2:  # the one edge of two vertices has one term, not two
            yield Term((end, end), (neighbour, neighbour), "local")
        if len(vertices) > 2:
            low, high = sorted(order[1:3])
            yield Term((end, end), (low, high), "local")


def _triangle_terms(vertices: range) -> list[Term]:
    i, j, k = vertices
    return [Term((v, v), e, "local") for v, e in ((i, (j, k)), (j, (k, i)), (k, (i, j)))]


def image_terms(offsets: Sequence[int], closed: Sequence[bool]) -> Iterator[Term]:
    """Yield the pairs that are tested under nonzero shifts: all edges, each with itself too.

    An edge and an image of its own strand are "self", however near they are along the strand.
    """
    bounds = zip(offsets[:-1], offsets[1:], closed, strict=True)
    edges = [(e, k) for k, (i, j, ring) in enumerate(bounds) for e in strand_edges(int(i), int(j), bool(ring))]
    for n, (e, k) in enumerate(edges):
        for f, m in edges[n:]:
            yield Term(e, f, "self" if k == m else "inter")


def nu(x: ArrayLike, offsets: Sequence[int], closed: Sequence[bool], cell: ArrayLike | None = None) -> Separation:
    """Return ν by brute force: the least distance over all terms, with a cell over all images in range."""
    points = np.asarray(x, dtype=np.float64)
    best = min(
        (_separation(points, term, (0, 0, 0), np.zeros((3, 3))) for term in disjoint_terms(offsets, closed)),
        key=lambda found: found.value,
    )
    if cell is None:
        return best
    h = np.asarray(cell, dtype=np.float64)
    for term in image_terms(offsets, closed):
        pair = points[[term.first, term.second]]
        for shift in shifts_within(pair, pair, h, h, best.value):
            if shift != (0, 0, 0) and (term.first != term.second or shift > (0, 0, 0)):
                best = min(best, _separation(points, term, shift, h), key=lambda found: found.value)
    return best


def _separation(points: NDArray[np.float64], term: Term, shift: Shift, cell: NDArray[np.float64]) -> Separation:
    (a, b), (c, d) = points[list(term.first)], points[list(term.second)] + np.array(shift) @ cell
    return Separation(edge_distance(a, b, c, d), term.first, term.second, shift, term.kind)
