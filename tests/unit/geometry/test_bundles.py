"""No pair of edges whose boxes meet is missed; the grid of bundles against trying every pair."""

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo import Strands
from mdtopo.geometry.boxgrid import meeting_boxes
from mdtopo.geometry.bundles import (
    BUNDLE,
    bundle_starts,
    edge_boxes,
    joint_boxes,
    meetings_of,
    narrowed_boxes,
    near_boxes,
    pairs_of_meetings,
)
from mdtopo.records import Traces

Points = NDArray[np.float64]
Indices = NDArray[np.int64]


def all_near(x0: Points, x1: Points, t: Traces, pads: Points) -> set[tuple[int, int]]:
    ends = np.stack([x0[t.edges], x1[t.edges]], axis=1).reshape(len(t.edges), 4, 3)
    low, high = ends.min(axis=1) - pads[:, None], ends.max(axis=1) + pads[:, None]
    return {
        (i, j)
        for i in range(len(low))
        for j in range(i + 1, len(low))
        if not (t.trace[i] == t.trace[j] and j - i <= 2) and (low[i] <= high[j]).all() and (low[j] <= high[i]).all()
    }


def near_edges(x0: Points, x1: Points, edges: Indices, pads: Points, trace: Indices) -> Indices:
    starts = bundle_starts(trace)
    boxes = edge_boxes(x0, x1, edges, pads, starts)
    return pairs_of_meetings(boxes, meetings_of(joint_boxes(boxes, starts)), starts, trace)


def found_near(x0: Points, x1: Points, t: Traces, pads: Points) -> set[tuple[int, int]]:
    listed = [(int(i), int(j)) for i, j in near_edges(x0, x1, t.edges, pads, t.trace)]
    assert len(set(listed)) == len(listed), "a pair is listed twice"
    ends = np.stack([x0[t.edges], x1[t.edges]], axis=1).reshape(len(t.edges), 4, 3)
    boxes = np.concatenate([ends.min(axis=1) - pads[:, None], ends.max(axis=1) + pads[:, None]], axis=1)
    assert set(listed) == {(int(i), int(j)) for i, j in near_boxes(boxes, t.trace)}
    return set(listed)


@pytest.mark.parametrize("lengths", [[2], [3], [6], [2, 2, 2], [5, 6, 7], [64], [150, 31], [2] * 80])
@pytest.mark.parametrize("pad", [0.01, 0.5, 3.0])
@pytest.mark.parametrize("stretched", [False, True])
def test_every_pair_whose_boxes_meet_is_listed_once(lengths: Sequence[int], pad: float, stretched: bool) -> None:
    t = Traces.of(Strands.from_lengths(lengths, closed=[n > 4 for n in lengths]))
    rng = np.random.default_rng([len(lengths), sum(lengths), int(100 * pad), stretched])
    expected = set()
    for _ in range(3):
        x0 = np.cumsum(rng.normal(size=(sum(lengths), 3)), axis=0) % (1.5 * sum(lengths) ** (1 / 3) + 1.0)
        if stretched:  # a few edges that are far longer than the others
            x0[rng.integers(len(x0), size=2)] *= 9.0
        x1, pads = x0 + rng.normal(scale=0.3, size=x0.shape), pad * rng.uniform(0.5, 1.5, len(t.edges))
        expected = all_near(x0, x1, t, pads)
        assert found_near(x0, x1, t, pads) == expected
    assert expected or sum(lengths) < 20


@pytest.mark.parametrize(("shift", "scale"), [(0.0, 1.0), (1e9, 3.0), (-1e12, 50.0), (1e3, 1e-7)])
def test_boxes_are_found_in_single_precision_wherever_they_are(shift: float, scale: float) -> None:
    """Each pair of boxes that meet is listed once, those that touch too; far from the origin perhaps a few more."""
    rng = np.random.default_rng(int(scale))
    low = scale * rng.integers(0, 30, size=(150, 3)) + shift
    boxes = np.concatenate([low, low + scale * rng.integers(1, 5, size=(150, 3))], axis=1)
    starts = bundle_starts(np.arange(len(boxes)))
    joint = joint_boxes(narrowed_boxes(boxes, starts), starts)
    found, order = meeting_boxes(joint, joint.shape[1], True)
    listed = {(int(i), int(j)) for i, j in np.sort(order[found], axis=1)}
    one, other = boxes[:, np.newaxis], boxes[np.newaxis]
    meet = ((one[..., :3] <= other[..., 3:]) & (other[..., :3] <= one[..., 3:])).all(axis=2)
    assert len(listed) == len(found)
    assert listed >= {(int(i), int(j)) for i, j in np.argwhere(meet) if i + 1 < j}
    if shift == 0.0:  # whole numbers below 2^22 that do not touch are told apart
        assert len(listed) == np.triu(meet, 2).sum()


@pytest.mark.parametrize(("gap", "meet"), [(0.99, True), (1.01, False)])
def test_two_bars_are_near_when_their_padded_boxes_touch(gap: float, meet: bool) -> None:
    t = Traces.of(Strands.from_lengths([2, 2]))
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 0, gap], [1, 0, gap]], dtype=float)
    assert found_near(x, x, t, np.array([0.5, 0.5])) == ({(0, 1)} if meet else set())


def test_a_bundle_holds_edges_of_one_trace() -> None:
    t = Traces.of(Strands.from_lengths([4, BUNDLE + 3], closed=[True, False]))
    starts = bundle_starts(t.trace)
    assert starts[0] == 0
    assert starts[-1] == len(t.edges)
    for first, stop in itertools.pairwise(starts):
        assert len(set(t.trace[first:stop])) == 1
        assert 0 < stop - first <= BUNDLE


@pytest.mark.parametrize("away", [1e3, 1e7, 1e12])
def test_far_outliers_are_no_trouble(away: float) -> None:
    t = Traces.of(Strands.from_lengths([2] * 100))
    rng = np.random.default_rng(3)
    x = rng.uniform(0, 8, (200, 3))
    x[[0, 1]] += away
    pads = np.full(100, 0.5)
    assert found_near(x, x, t, pads) == all_near(x, x, t, pads)


def test_edges_of_a_trace_that_do_not_follow_each_other_are_refused() -> None:
    edges, x = np.array([[0, 1], [2, 3], [3, 4]]), np.zeros((5, 3))
    with pytest.raises(ValueError, match="do not follow each other"):
        near_edges(x, x, edges, np.ones(3), np.zeros(3, dtype=np.int64))
