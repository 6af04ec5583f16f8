"""Strands with broken edges taken out, as the kernels see them; local pairs and end terms against the oracle."""

import numpy as np
import oracles
import pytest

from mdtopo.records import Strands, Traces

SHAPES = {
    "open": ([6], [False]),
    "two vertices": ([2], [False]),
    "three vertices": ([3], [False]),
    "triangle": ([3], [True]),
    "square": ([4], [True]),
    "pentagon": ([5], [True]),
    "mixed": ([5, 3, 2, 4], [False, True, False, True]),
}


def traces(lengths: list[int], closed: list[bool], broken: tuple[int, ...] = ()) -> Traces:
    return Traces.of(Strands.from_lengths(lengths, closed=closed), broken)


def pieces(t: Traces) -> list[list[int]]:
    return [part.tolist() for part in np.split(t.vertices, t.offsets[1:-1])]


def members(first: tuple[int, int], second: tuple[int, int]) -> frozenset[frozenset[int]]:
    return frozenset({frozenset(first), frozenset(second)})


@pytest.mark.parametrize("shape", SHAPES)
def test_local_pairs_and_end_terms_are_the_local_terms_of_nu(shape: str) -> None:
    lengths, closed = SHAPES[shape]
    t = traces(lengths, closed)
    found = [members(tuple(t.edges[i]), tuple(t.edges[j])) for i, j in t.local_pairs]
    found += [members((a, b), (c, d)) for a, b, c, d in t.end_terms]
    terms = oracles.disjoint_terms(np.concatenate([[0], np.cumsum(lengths)]), closed)
    expected = [members(term.first, term.second) for term in terms if term.kind == "local"]
    assert len(set(found)) == len(found)
    assert set(found) == set(expected)


@pytest.mark.parametrize("shape", SHAPES)
def test_intact_strands_have_all_their_edges_in_order(shape: str) -> None:
    lengths, closed = SHAPES[shape]
    strands, t = Strands.from_lengths(lengths, closed=closed), traces(lengths, closed)
    assert t.edges.tolist() == strands.edges.tolist()
    assert t.edge_index.tolist() == list(range(len(strands.edges)))
    assert t.closed.tolist() == closed
    assert t.vertices.tolist() == list(range(strands.n_vertices))
    for k, after in enumerate(t.following):
        if after >= 0:
            assert t.edges[after, 0] == t.edges[k, 1]
        else:
            assert t.edges[k, 1] in strands.offsets[1:] - 1
    assert t.trace.tolist() == strands.strand_of_vertex[t.edges[:, 0]].tolist()


def test_an_open_strand_splits_at_its_broken_edge() -> None:
    t = traces([6], [False], (2,))
    assert pieces(t) == [[0, 1, 2], [3, 4, 5]]
    assert t.edges.tolist() == [[0, 1], [1, 2], [3, 4], [4, 5]]
    assert t.edge_index.tolist() == [0, 1, 3, 4]
    assert t.following.tolist() == [1, -1, 3, -1]
    assert t.trace.tolist() == [0, 0, 1, 1]
    assert t.local_pairs.tolist() == []
    ends = [[0, 0, 1, 1], [0, 0, 1, 2], [1, 1, 2, 2], [2, 2, 0, 1]]
    assert t.end_terms.tolist() == sorted(ends + (np.array(ends) + 3).tolist())


@pytest.mark.parametrize(
    ("broken", "expected"),
    [
        (4, [0, 1, 2, 3, 4]),  # the closing edge
        (0, [1, 2, 3, 4, 0]),
        (2, [3, 4, 0, 1, 2]),
    ],
)
def test_a_ring_opens_at_its_broken_edge_and_its_closing_edge_becomes_one_like_any_other(
    broken: int, expected: list[int]
) -> None:
    t = traces([5], [True], (broken,))
    assert pieces(t) == [expected]
    assert t.closed.tolist() == [False]
    assert t.edge_index.tolist() == [(broken + 1 + k) % 5 for k in range(4)]
    assert t.following.tolist() == [1, 2, 3, -1]
    assert t.local_pairs.tolist() == [[0, 2], [1, 3]]


@pytest.mark.parametrize(
    ("broken", "expected"),
    [
        ((1, 3), [[2, 3], [4, 5, 0, 1]]),
        ((5, 2), [[3, 4, 5], [0, 1, 2]]),
        ((0, 1), [[1], [2, 3, 4, 5, 0]]),
        ((4, 5), [[5], [0, 1, 2, 3, 4]]),
    ],
)
def test_a_ring_with_two_cuts_is_two_strands(broken: tuple[int, int], expected: list[list[int]]) -> None:
    t = traces([6], [True], broken)
    assert sorted(pieces(t)) == sorted(expected)
    assert len(t.edges) == 4
    assert not set(t.edge_index.tolist()) & set(broken)
    assert not t.closed.any()


def test_pieces_of_one_vertex_have_no_edge_and_no_end_term() -> None:
    t = traces([4], [False], (0, 1, 2))
    assert pieces(t) == [[0], [1], [2], [3]]
    assert (t.edges.shape, t.local_pairs.shape, t.end_terms.shape) == ((0, 2), (0, 2), (0, 4))
    t = traces([4], [False], (0,))
    assert pieces(t) == [[0], [1, 2, 3]]
    assert t.trace.tolist() == [1, 1]
    assert 0 not in t.end_terms


def test_a_break_leaves_other_strands_as_they_were() -> None:
    t = traces([4, 5], [True, False], (5,))  # edges 0-3 are the ring's
    assert pieces(t) == [[0, 1, 2, 3], [4, 5], [6, 7, 8]]
    assert t.closed.tolist() == [True, False, False]
    assert t.edge_index.tolist() == [0, 1, 2, 3, 4, 6, 7]


@pytest.mark.parametrize("seed", range(20))
def test_edges_follow_each_other_within_a_trace_and_nowhere_else(seed: int) -> None:
    """Whatever breaks: pieces of strands are laid out by it."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(2, 30, size=12).tolist()
    strands = Strands.from_lengths(lengths, closed=[n > 2 and bool(rng.integers(2)) for n in lengths])
    t = Traces.of(strands, np.flatnonzero(rng.random(len(strands.edges)) < 0.1 * (seed % 4)).tolist())
    follows = t.edges[:-1, 1] == t.edges[1:, 0]
    assert follows.tolist() == (t.trace[:-1] == t.trace[1:]).tolist()
