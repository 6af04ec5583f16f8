"""How far edges are apart, by trying: ν at a time, and the least distance over many times."""

import numpy as np

from mdtopo.referee.paths import LinearPath, Piece
from mdtopo.referee.search import Pairs, near_pairs, points_at
from mdtopo.typing import Indices, Lengths, Points

LOCAL, SELF, INTER = 0, 1, 2
"""Classes of pairs: one edge between them; further apart on one piece, or an image of it; different pieces."""

SAMPLES = 33
"""Times within a step at which distances are looked at."""

REFINEMENTS = 3
"""Rounds of projecting back and forth between two edges that are nearly parallel."""


def edge_distances(points: Points) -> Lengths:
    """Return the distance of each pair of segments ab and cd, Å.

    Parameters
    ----------
    points : ndarray, shape (n, 4, 3)
        The ends a, b, c, d.

    Notes
    -----
    The least over the distances of several pairs of points that lie on the segments: each end with its foot on the
    other segment, and the nearest points of the two lines, brought back onto the segments. Rounding of a place can only
    make it larger.
    """
    a, b, c, d = np.moveaxis(points, 1, 0)
    found = [_to_segment(p, q, r) for p, q, r in ((a, c, d), (b, c, d), (c, a, b), (d, a, b))]
    u, v, w = b - a, d - c, c - a
    normal = np.cross(u, v)  # keeps its digits where the edges are nearly parallel, unlike products of lengths
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.einsum("nk,nk->n", np.cross(w, v), normal) / np.einsum("nk,nk->n", normal, normal)
    s = np.clip(np.nan_to_num(place), 0.0, 1.0)
    for _ in range(REFINEMENTS):
        p = a + s[:, np.newaxis] * u
        q = c + _foot(p, c, v)[:, np.newaxis] * v
        found.append(np.linalg.norm(p - q, axis=1))
        s = _foot(q, a, u)
    return np.asarray(np.min(found, axis=0), dtype=np.float64)


def _foot(p: Points, q: Points, along: Points) -> Lengths:
    """Return where on the segment q + r·along the nearest point to p is."""
    with np.errstate(divide="ignore", invalid="ignore"):
        r = np.einsum("nk,nk->n", p - q, along) / np.einsum("nk,nk->n", along, along)
    return np.asarray(np.clip(np.nan_to_num(r), 0.0, 1.0), dtype=np.float64)


def _to_segment(p: Points, q: Points, r: Points) -> Lengths:
    foot = q + _foot(p, q, r - q)[:, np.newaxis] * (r - q)
    return np.asarray(np.linalg.norm(p - foot, axis=1), dtype=np.float64)


def separation(path: LinearPath, pieces: list[Piece], edges: Indices) -> float | None:
    """Return ν at the start of a step, Å: the least distance of disjoint vertices and edges, in all images.

    Infinite where there is no such pair; None where the images cannot be counted.
    """
    least = _end_terms(path.ends[0], pieces)
    if not len(edges):
        return least
    lengths = np.linalg.norm(np.diff(path.ends[0][edges], axis=1), axis=2)
    extent = float(np.linalg.norm(np.ptp(path.ends[0], axis=0))) + path.scale
    reach = min(max(float(lengths.mean()), 1e-3 * extent), least)
    while True:
        pairs = near_pairs(path, edges, reach, (0.0, 0.0))
        if pairs is None:
            return None
        if len(pairs):
            least = min(least, float(edge_distances(points_at(path, edges, pairs, 0.0)).min()))
        # every pair within reach has been seen; further ones are further apart than that
        if least <= reach or reach > extent:
            return least
        reach = min(2.0 * reach, least)


def _end_terms(x: Points, pieces: list[Piece]) -> float:
    """Return the least of ν's terms besides pairs of edges: two at each open end, vertex against edge in a triangle."""
    terms: list[tuple[int, int, int]] = []
    for piece in pieces:
        v = piece.vertices.tolist()
        if piece.is_closed:
            terms += [(v[0], v[1], v[2]), (v[1], v[2], v[0]), (v[2], v[0], v[1])] if len(v) == 3 else []
        elif len(v) > 1:
            terms += [(v[0], v[1], v[1]), (v[-1], v[-2], v[-2])]
            terms += [(v[0], v[1], v[2]), (v[-1], v[-2], v[-3])] if len(v) > 2 else []
    if not terms:
        return np.inf
    p, q, r = (x[list(column)] for column in zip(*terms, strict=True))
    return float(_to_segment(p, q, r).min())


def classes(pairs: Pairs, pieces: list[Piece]) -> Indices:
    """Return the class of each pair; -1 for neighbours, which cannot be apart."""
    piece = np.concatenate([np.full(len(part.edges), g) for g, part in enumerate(pieces)])
    place = np.concatenate([np.arange(len(part.edges)) for part in pieces])
    around = np.array([len(part.edges) if part.is_closed else 0 for part in pieces])
    same = piece[pairs.first] == piece[pairs.second]
    apart = np.abs(place[pairs.first] - place[pairs.second])
    ring = around[piece[pairs.first]]
    apart = np.where(ring > 0, np.minimum(apart, ring - apart), apart)
    local = same & (apart == 2) & ~pairs.image.any(axis=1)
    found: Indices = np.where(local, LOCAL, np.where(same, SELF, INTER)).astype(np.int64)
    return found


def least_distances(path: LinearPath, pieces: list[Piece], edges: Indices, reach: Lengths) -> Lengths | None:
    """Return the least distance of the pairs of each class over some times of the step, as far as it is within reach.

    Parameters
    ----------
    path, pieces, edges
        The step.
    reach : ndarray, shape (3,)
        How near pairs of each class are to be, Å; NaN for a class that is of no interest.

    Returns
    -------
    ndarray, shape (3,), or None
        Local, self, inter, Å; infinite where no pair comes so near. None where the images cannot be counted.
    """
    least, furthest = np.full(3, np.inf), float(np.nan_to_num(reach).max(initial=0.0))
    pairs = near_pairs(path, edges, furthest)
    if pairs is None:
        return None
    kind = classes(pairs, pieces) if len(pairs) else np.empty(0, dtype=np.int64)
    wanted = np.nan_to_num(reach)[kind] > 0.0
    pairs, kind = pairs.chosen(wanted), kind[wanted]
    for t in np.linspace(0.0, 1.0, SAMPLES):
        points = points_at(path, edges, pairs, float(t))
        between = points[:, :2].mean(axis=1) - points[:, 2:].mean(axis=1)
        halves = 0.5 * np.linalg.norm(points[:, [1, 3]] - points[:, [0, 2]], axis=2).sum(axis=1)
        rows = np.flatnonzero(np.linalg.norm(between, axis=1) <= (halves + reach[kind]) * (1.0 + 1e-9))
        if len(rows):
            np.minimum.at(least, kind[rows], edge_distances(points[rows]))
    return least


def vertex_distances(path: LinearPath, edges: Indices, reach: float) -> Lengths | None:
    """Return how near the edges of each vertex come to any other over some times of the step, within reach.

    Parameters
    ----------
    path, edges
        The step.
    reach : float
        How near edges are to be, Å.

    Returns
    -------
    ndarray, shape (n_vertices,), or None
        Å; infinite where no edge comes so near. None where the images cannot be counted.
    """
    pairs, least = near_pairs(path, edges, reach), np.full(len(path.ends[0]), np.inf)
    if pairs is None:
        return None
    for t in np.linspace(0.0, 1.0, SAMPLES):
        points = points_at(path, edges, pairs, float(t))
        between = points[:, :2].mean(axis=1) - points[:, 2:].mean(axis=1)
        halves = 0.5 * np.linalg.norm(points[:, [1, 3]] - points[:, [0, 2]], axis=2).sum(axis=1)
        rows = np.flatnonzero(np.linalg.norm(between, axis=1) <= (halves + reach) * (1.0 + 1e-9))
        if len(rows):
            found = edge_distances(points[rows])[:, np.newaxis]
            for edge in (pairs.first[rows], pairs.second[rows]):
                np.minimum.at(least, edges[edge], found)
    return least
