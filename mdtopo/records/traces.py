"""The edges that a step is measured on, laid out for the kernels."""

from collections.abc import Collection
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from mdtopo.records.strands import Strands
from mdtopo.typing import Flags, Indices


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """The strands with their broken edges taken out: what is left of them, piece by piece.

    Attributes
    ----------
    vertices : ndarray of int, shape (n,)
        All vertices, piece after piece, in the order in which the trace visits them.
    offsets : ndarray of int, shape (n_traces + 1,)
        Trace g visits ``vertices[offsets[g]:offsets[g + 1]]``.
    closed : ndarray of bool, shape (n_traces,)
        Whether the trace returns to its first vertex.
    edges : ndarray of int, shape (m, 2)
        Tail and head of each edge that is left, in trace order.
    edge_index : ndarray of int, shape (m,)
        Index of the edge in ``Strands.edges``.
    following : ndarray of int, shape (m,)
        The edge that starts where this one ends; -1 at an open end.
    trace : ndarray of int, shape (m,)
        The trace of each edge.
    local_pairs : ndarray of int, shape (p, 2)
        Pairs of edges with one edge between them.
    end_terms : ndarray of int, shape (q, 4)
        Pairs of a vertex and a vertex or edge, as [a, a, b, b] or [a, a, b, c]: the terms that ν has besides pairs of
        edges (two at each open end; vertex against opposite edge in a triangle).
    """

    vertices: Indices
    offsets: Indices
    closed: Flags
    edges: Indices
    edge_index: Indices
    following: Indices
    trace: Indices
    local_pairs: Indices
    end_terms: Indices

    @classmethod
    def of(cls, strands: Strands, broken: Collection[int] = ()) -> "Traces":
        """Return the traces of the strands without the broken edges, given by their index in ``Strands.edges``."""
        if not broken and strands in _WHOLE:
            return _WHOLE[strands]
        pieces = _pieces(strands, frozenset(broken))
        vertices = np.concatenate([piece for piece, _ in pieces])
        offsets = np.concatenate([[0], np.cumsum([len(piece) for piece, _ in pieces])])
        closed = np.array([ring for _, ring in pieces], dtype=np.bool_)
        edges, following, trace = _edges(pieces)
        edge_of_tail = np.full(strands.n_vertices, -1, dtype=np.int64)  # a vertex is the tail of one edge at most
        edge_of_tail[strands.edges[:, 0]] = np.arange(len(strands.edges))
        edge_index = edge_of_tail[edges[:, 0]]
        local = _local_pairs(following)
        traces = cls(vertices, offsets, closed, edges, edge_index, following, trace, local, _end_terms(pieces))
        if not broken:
            _WHOLE[strands] = traces
        return traces


_WHOLE: WeakKeyDictionary[Strands, Traces] = WeakKeyDictionary()
"""Of strands that have been seen, the traces with no edge broken: who measures step by step asks again and again."""


def _pieces(strands: Strands, broken: frozenset[int]) -> list[tuple[Indices, bool]]:
    """Return (vertices in order, closed) of each piece."""
    pieces: list[tuple[Indices, bool]] = []
    first_edge = 0
    for start, stop, ring in zip(strands.offsets[:-1], strands.offsets[1:], strands.closed, strict=True):
        vertices = np.arange(start, stop, dtype=np.int64)
        n_edges = len(vertices) if ring else len(vertices) - 1
        cuts = [k - first_edge + 1 for k in range(first_edge, first_edge + n_edges) if k in broken]
        first_edge += n_edges
        if not cuts:
            pieces.append((vertices, bool(ring)))
            continue
        if ring:  # begin behind the first cut; the closing edge is then an edge like any other
            vertices = np.roll(vertices, -cuts[0])
            cuts = [cut - cuts[0] for cut in cuts[1:]]
        pieces.extend((part, False) for part in np.split(vertices, cuts))
    return pieces


def _edges(pieces: list[tuple[Indices, bool]]) -> tuple[Indices, Indices, Indices]:
    edges, following, trace = [np.empty((0, 2), dtype=np.int64)], [np.empty(0, dtype=np.int64)], []
    count = 0
    for g, (vertices, ring) in enumerate(pieces):
        n_edges = len(vertices) if ring else len(vertices) - 1
        if n_edges == 0:
            continue
        edges.append(np.stack([vertices[:n_edges], np.roll(vertices, -1)[:n_edges]], axis=1))
        nexts = np.arange(count + 1, count + n_edges + 1, dtype=np.int64)
        nexts[-1] = count if ring else -1
        following.append(nexts)
        trace.append(np.full(n_edges, g, dtype=np.int64))
        count += n_edges
    return (
        np.concatenate(edges),
        np.concatenate(following),
        np.concatenate([*trace, np.empty(0, dtype=np.int64)]),
    )


def _local_pairs(following: Indices) -> Indices:
    """Return the pairs (i, edge after the next), each once, without those that share a vertex."""
    after = np.where(following >= 0, following[following], -1)
    first = np.flatnonzero(after >= 0)
    second = after[first]
    apart = (following[second] != first) & (second != first)  # a triangle's edges all touch
    mirrored = (after[second] == first) & (second < first)  # in a ring of four each pair is met twice
    keep = apart & ~mirrored
    return np.stack([first[keep], second[keep]], axis=1)


def _end_terms(pieces: list[tuple[Indices, bool]]) -> Indices:
    terms: set[tuple[int, int, int, int]] = set()
    for vertices, ring in pieces:
        if ring and len(vertices) > 3:
            continue
        v = vertices.tolist() if len(vertices) < 6 else [*vertices[:3].tolist(), *vertices[-3:].tolist()]
        if ring and len(v) == 3:
            terms |= {(v[0], v[0], v[1], v[2]), (v[1], v[1], v[2], v[0]), (v[2], v[2], v[0], v[1])}
        if ring or len(v) < 2:
            continue
        terms |= {(v[0], v[0], v[1], v[1]), (v[-2], v[-2], v[-1], v[-1])}
        if len(v) > 2:
            terms |= {(v[0], v[0], v[1], v[2]), (v[-1], v[-1], v[-3], v[-2])}
    return np.array(sorted(terms), dtype=np.int64).reshape(-1, 4)
