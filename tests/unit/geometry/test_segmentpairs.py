"""What chords leave to be settled: nothing that may meet is missing, and along a strand each pair is named once."""

from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.curves import following_of

from mdtopo.geometry.segmenthulls import JOINT, PAIR, SELF
from mdtopo.geometry.segmentpairs import lone_checks, pair_checks
from mdtopo.geometry.segmentshapes import shapes_of

Points = NDArray[np.float64]
LAB = np.zeros((3, 3))
ROUNDING = 1e-12


def lone(c0: Points, c1: Points, following: list[int]) -> set[tuple[int, int, int]]:
    rows, lows = lone_checks(c0, c1, shapes_of(c0, c1)[0], np.array(following), ROUNDING)
    listed = [(int(kind), int(i), int(j)) for kind, i, j, *_ in rows]
    assert len(set(listed)) == len(listed) == len(lows)
    assert sorted(listed, key=lambda check: check[0] == PAIR) == listed, "segments and joints come first"
    return set(listed)


def pairs(c0: Points, c1: Points, following: list[int], reach: float, cell: Points = LAB) -> set[tuple[int, ...]]:
    rows, lows, complete = pair_checks(
        *shapes_of(c0, c1), np.array(following), cell, cell, bool(cell.any()), reach, ROUNDING
    )
    assert complete
    assert (lows <= reach).all()
    assert not len(lows) or lows[0] == lows.min(), "the closest pair comes first"
    assert (rows[:, 0] == PAIR).all()
    listed = [tuple(row[1:].tolist()) for row in rows]
    assert len(set(listed)) == len(listed)
    return set(listed)


def line(n: int) -> Points:
    """Return n cubics in a row along x, each 1 long."""
    return np.arange(n)[:, None, None] + np.array([[0.0, 0, 0], [1 / 3, 0, 0], [2 / 3, 0, 0], [1, 0, 0]])


def ring(n: int) -> Points:
    angle = 2 * np.pi * np.arange(n) / n
    corners = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    share = np.linspace(0, 1, 4)[:, None]
    return np.stack([(1 - share) * a + share * b for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7])
def test_along_a_straight_strand_only_pairs_with_one_between_are_left(n: int) -> None:
    x = line(n) * [1.0, 0.0, 0.0]
    assert lone(x, x, following_of([n], [False])) == {(PAIR, k, k + 2) for k in range(n - 2)}


@pytest.mark.parametrize(
    ("n", "expected"),
    [(3, set()), (4, {(0, 2), (1, 3)}), (5, {(0, 2), (1, 3), (2, 4), (3, 0), (4, 1)})],
)
def test_in_a_ring_each_pair_with_one_between_is_named_once(n: int, expected: set[tuple[int, int]]) -> None:
    x = ring(n)
    assert {(i, j) for kind, i, j in lone(x, x, following_of([n], [True])) if kind == PAIR} == expected


@pytest.mark.parametrize(("back", "named"), [(0.01, False), (-0.01, True)])
def test_a_segment_that_turns_back_on_its_chord_is_left_to_hulls(back: float, named: bool) -> None:
    x = line(1) * [1.0, 0.0, 0.0]
    x[0, 2, 0] = x[0, 1, 0] + back
    assert lone(x, x, [-1]) == ({(SELF, 0, 0)} if named else set())
    straight = line(1) * [1.0, 0.0, 0.0]
    assert lone(straight, x, [-1]) == ({(SELF, 0, 0)} if named else set())  # at either end of the step


@pytest.mark.parametrize(("angle", "named"), [(119.0, False), (121.0, False), (179.9, False), (180.0, True)])
def test_a_joint_that_folds_back_is_left_to_hulls(angle: float, named: bool) -> None:
    """Of straight segments of one length, the two chords together tell all but a fold by 180°."""
    x = line(2) * [1.0, 0.0, 0.0]
    turn = np.deg2rad(angle)
    x[1] = x[0, -1] + np.linspace(0, 1, 4)[:, None] * [np.cos(turn), np.sin(turn), 0.0]
    assert ((JOINT, 0, 1) in lone(x, x, [1, -1])) is named


def test_a_joint_bent_out_of_its_chords_is_left_to_hulls() -> None:
    x = line(2) * [1.0, 0.0, 0.0]
    x[1, 1, 0] -= 0.5
    assert lone(x, x, [1, -1]) == {(SELF, 1, 1), (JOINT, 0, 1)}


# --- pairs that share no point ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gap", "named"), [(0.99, True), (1.01, False)])
def test_two_bars_are_named_within_reach(gap: float, named: bool) -> None:
    x = np.concatenate([line(1), line(1)]) * [1.0, 0.0, 0.0]
    x[1, :, 2] = gap
    assert pairs(x, x, [-1, -1], 1.0) == ({(0, 1, 0, 0, 0)} if named else set())


def test_what_comes_near_during_the_step_is_named() -> None:
    x = np.concatenate([line(1), line(1)]) * [1.0, 0.0, 0.0]
    x0, x1 = x.copy(), x.copy()
    x0[1, :, 2], x1[1, :, 2] = 5.0, -5.0
    assert pairs(x0, x1, [-1, -1], 0.1) == {(0, 1, 0, 0, 0)}


def random_curves(seed: int) -> tuple[Points, Points, list[int]]:
    """Return crowded strands, one of them a ring."""
    random = np.random.default_rng(seed)
    lengths, closed = [12, 9, 1], [False, True, False]
    m = sum(lengths)
    c0 = random.normal(size=(m, 4, 3)) * 0.4 + np.cumsum(random.normal(size=(m, 1, 3)), axis=0)
    return c0, c0 + 0.3 * random.normal(size=c0.shape), following_of(lengths, closed)


def sampled_distance(a0: Points, a1: Points, b0: Points, b1: Points) -> float:
    """Return the least distance of sampled points at sampled times; infinite where boxes are more than 2 apart."""
    a, b = np.concatenate([a0, a1]), np.concatenate([b0, b1])
    if max((a.min(axis=0) - b.max(axis=0)).max(), (b.min(axis=0) - a.max(axis=0)).max()) > 2.0:
        return np.inf
    u = np.linspace(0, 1, 9)
    basis = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3], axis=1)
    least = np.inf
    for t in np.linspace(0, 1, 5):
        a, b = basis @ ((1 - t) * a0 + t * a1), basis @ ((1 - t) * b0 + t * b1)
        least = min(least, float(np.linalg.norm(a[:, None] - b[None], axis=2).min()))
    return least


def near_along(i: int, j: int, following: list[int]) -> bool:
    after = [following[k] if k >= 0 else -1 for k in (i, j)]
    return j in (after[0], following[after[0]] if after[0] >= 0 else -1) or i in (
        after[1],
        following[after[1]] if after[1] >= 0 else -1,
    )


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("reach", [0.0, 0.7])
def test_every_pair_that_comes_within_reach_is_named(seed: int, reach: float) -> None:
    c0, c1, following = random_curves(seed)
    named = {row[:2] for row in pairs(c0, c1, following, reach)}
    assert all(i < j for i, j in named)
    for i, j in combinations(range(len(c0)), 2):
        if near_along(i, j, following):
            assert (i, j) not in named
        elif sampled_distance(c0[i], c1[i], c0[j], c1[j]) <= reach:
            assert (i, j) in named
    assert named


@pytest.mark.parametrize("seed", range(4))
def test_every_pair_of_images_that_comes_within_reach_is_named(seed: int) -> None:
    c0, c1, following = random_curves(seed)
    cell = np.array([[7.0, 0, 0], [2.0, 8, 0], [-1.0, 1.5, 9]])
    named = pairs(c0, c1, following, 1.0, cell)
    found = 0
    for counts in np.ndindex(5, 5, 5):
        image = np.array(counts) - 2
        for i, j in np.ndindex(len(c0), len(c0)):
            if not image.any() and (i >= j or near_along(i, j, following)):
                continue
            if sampled_distance(c0[i], c1[i], c0[j] + image @ cell, c1[j] + image @ cell) <= 1.0:
                found += 1
                assert (i, j, *image.tolist()) in named or (j, i, *(-image).tolist()) in named
    assert found > 5
