"""Local pairs that are left out of a step change none of its numbers."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo import Strands
from mdtopo.curves import StepMotion
from mdtopo.extremes import Extremes, fresh_extremes
from mdtopo.geometry.pairlanes import fresh_workbench
from mdtopo.geometry.windows import WIDE
from mdtopo.localpairs import SAMPLE, SHORTEST, length_of_piece, near_local_pairs
from mdtopo.records import Traces
from mdtopo.rungs import climb_pairs

Points = NDArray[np.float64]
Whole = NDArray[np.int64]

SLACK = 1e-12
BENCH = fresh_workbench()
SYSTEMS = {
    "one chain": ([900], False, ()),
    "chains": ([150, 80, 300, 5, 68], False, ()),
    "rings": ([150, 3, 4, 5, 90, 200], True, ()),
    "broken": ([400, 200], False, (3, 100, 101, 250, 420)),
    "broken rings": ([300, 100], True, (0, 150, 299, 350)),
    "short chains": ([4] * 60 + [12] * 30, False, ()),
}


def traces_of(name: str) -> Traces:
    lengths, closed, broken = SYSTEMS[name]
    return Traces.of(Strands.from_lengths(lengths, closed=closed), list(broken))


def motion_of(traces: Traces, rng: np.random.Generator) -> StepMotion:
    """Return a motion of a random walk with edges of unit length."""
    n = int(traces.vertices.max()) + 1
    bonds = rng.normal(size=(n, 3))
    x0 = np.cumsum(bonds / np.linalg.norm(bonds, axis=1, keepdims=True), axis=0)
    x1 = x0 + 0.03 * rng.normal(size=x0.shape)
    return StepMotion(x0, x1, np.zeros((3, 3)), np.zeros((3, 3)), False, (0.0, 0.0, 0.0), True, 0.0)


def climbed(pairs: Whole, motion: StepMotion, t: Traces) -> tuple[Extremes, set[tuple[int, int]]]:
    best, is_open = fresh_extremes(), np.zeros(len(pairs), np.bool_)
    none, lists = np.empty((0, 3), np.int64), (t.edges, t.following, t.trace)
    climb_pairs(pairs, none, True, motion, *lists, SLACK, 0.0, 0.0, BENCH, best, is_open)
    return best, set(map(tuple, pairs[is_open].tolist()))


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_extremes_are_those_of_all_local_pairs(name: str) -> None:
    """Bit for bit, with the pairs that stay open and the counts of the rungs."""
    t, left_out = traces_of(name), 0
    for seed in range(5):
        motion = motion_of(t, np.random.default_rng(seed))
        near = near_local_pairs(t.local_pairs, motion, t.edges, t.following, t.trace, SLACK, 0.0, fresh_workbench())
        assert set(map(tuple, near.tolist())) <= set(map(tuple, t.local_pairs.tolist()))
        left_out += len(t.local_pairs) - len(near)
        (one, some_open), (other, all_open) = climbed(near, motion, t), climbed(t.local_pairs, motion, t)
        assert some_open == all_open
        for few, everything in zip(one, other, strict=True):
            assert few.tolist() == everything.tolist()
    assert name == "short chains" or left_out > len(t.local_pairs)  # of five times as many


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_piece_has_consecutive_vertices(name: str) -> None:
    """As few pieces as can be, and each pair in one of them."""
    t, first, lengths = traces_of(name), 0, []
    while first < len(t.local_pairs):
        length = length_of_piece(t.local_pairs, t.edges, first)
        corners = t.edges[t.local_pairs[first : first + length]].reshape(-1, 4)
        if length > 1:
            assert (corners == corners[0, 0] + np.arange(4) + np.arange(length)[:, np.newaxis]).all()
        lengths.append(length)
        first += length
    assert first == len(t.local_pairs)
    if name == "one chain":
        assert lengths == [WIDE] * (first // WIDE) + [first % WIDE]
    if name == "short chains":
        assert lengths == [1] * 60 + [9] * 30
        assert 1 < SHORTEST <= 9


def test_few_pairs_are_all_climbed() -> None:
    t = Traces.of(Strands.from_lengths([2 * SAMPLE + 3]))
    motion = motion_of(t, np.random.default_rng(0))
    assert len(t.local_pairs) == 2 * SAMPLE
    near = near_local_pairs(t.local_pairs, motion, t.edges, t.following, t.trace, SLACK, 0.0, BENCH)
    assert near.tolist() == t.local_pairs.tolist()
