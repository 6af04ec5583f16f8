"""Pairs that are measured side by side: each as if it were alone, and nothing claimed that is not so."""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import oracles
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.distances import closest_points
from mdtopo.geometry.pairlanes import (
    ALONG,
    END,
    GAP,
    LOW0,
    LOW1,
    NEAR0,
    NEAR1,
    NEAREST,
    RHO,
    ROOM,
    START,
    TURN,
    copy_lane,
    flag_far,
    fresh_lanes,
    measure_lanes,
    shift_edge,
    write_edge,
)
from mdtopo.geometry.vectors import norm

Points = NDArray[np.float64]
Pairs = NDArray[np.float64]
"""Shape (n, 2, 4, 3): start and end, then a, b, c, d."""

TWO_EDGES = np.array([[0, 1], [2, 3]])
RESULTS = NEAR0, NEAR1, LOW0, LOW1, RHO, GAP, ALONG, TURN


def anywhere(rng: np.random.Generator, n: int) -> Pairs:
    start = rng.normal(size=(n, 4, 3))
    start[:, 2:] += 2.0 * rng.normal(size=(n, 1, 3))
    return np.stack([start, start + rng.uniform(0.0, 0.7, size=(n, 1, 1)) * rng.normal(size=start.shape)], axis=1)


def parallel(rng: np.random.Generator, n: int) -> Pairs:
    """Edges that are parallel, or almost, or points."""
    pairs = anywhere(rng, n)
    pairs[:, 0, 3] = pairs[:, 0, 2] + rng.choice([0.0, 1.0, -2.0], size=(n, 1)) * (pairs[:, 0, 1] - pairs[:, 0, 0])
    pairs[::2, 0, 3] += 1e-9 * rng.normal(size=pairs[::2, 0, 3].shape)
    pairs[::3, :, 1] = pairs[::3, :, 0]
    return pairs


def far_away(rng: np.random.Generator, n: int) -> Pairs:
    return anywhere(rng, n) + 1e6 * rng.normal(size=(n, 1, 1, 3))


def tiny(rng: np.random.Generator, n: int) -> Pairs:
    return 1e-9 * anywhere(rng, n)


FAMILIES = pytest.mark.parametrize("family", [anywhere, parallel, far_away, tiny])


def filled(pairs: Pairs, nearest: float = 0.0) -> Points:
    """Return a batch with these pairs in its first lanes."""
    lanes = fresh_lanes()
    for k, (start, end) in enumerate(pairs):
        x0, x1 = np.ascontiguousarray(start), np.ascontiguousarray(end)
        write_edge(lanes, 0, np.uint64(k), x0, x1, TWO_EDGES, 0)
        write_edge(lanes, 6, np.uint64(k), x0, x1, TWO_EDGES, 1)
        lanes[NEAREST * ROOM + k] = nearest
    return lanes


def slack_of(pairs: Pairs) -> float:
    return float(64 * 2.0**-53 * np.abs(pairs).max())


def measured(pairs: Pairs) -> Points:
    """Return what is measured of each pair, shape (n, 8), as of stored coordinates."""
    lanes = filled(pairs)
    measure_lanes(lanes, len(pairs), slack_of(pairs), 0.0)
    return np.stack([lanes[row * ROOM :][: len(pairs)] for row in RESULTS], axis=1)


def exact_squared_distance(corners: Points) -> Fraction:
    differences = [[Fraction(float(p)) - Fraction(float(q)) for p, q in zip(a, c, strict=True)]
                   for a in corners[:2] for c in corners[2:]]  # fmt: skip
    return oracles.squared_hull_distance_exact(differences)


@FAMILIES
def test_what_is_proved_of_a_pair_is_so(family: Callable[..., Pairs]) -> None:
    """Against distances in rational arithmetic, at both ends and at times between them."""
    pairs = family(np.random.default_rng(1), ROOM)
    slack = slack_of(pairs)
    for (start, end), row in zip(pairs, measured(pairs), strict=True):
        _, _, low0, low1, rho, gap, along, turn = row
        squared = [exact_squared_distance(x) for x in (start, end)]
        assert all(Fraction(low) ** 2 <= d for low, d in zip((low0, low1), squared, strict=True))
        move = [[Fraction(float(v)) - Fraction(float(u)) for u, v in zip(p, q, strict=True)]
                for p, q in zip(start, end, strict=True)]  # fmt: skip
        moves = [sum((a - c) ** 2 for a, c in zip(move[p], move[q], strict=True)) for p in (0, 1) for q in (2, 3)]
        assert Fraction(rho) ** 2 >= max(moves)
        for t in (0.0, 0.3, 0.5, 1.0):
            least = oracles.edge_distance(*((1.0 - t) * start + t * end))
            assert max(gap, along - slack, turn) <= least + slack


@FAMILIES
def test_distances_are_those_of_closest_points_bit_for_bit(family: Callable[..., Pairs]) -> None:
    pairs = family(np.random.default_rng(2), ROOM)
    for corners, row in zip(pairs, measured(pairs), strict=True):
        alone = [norm(closest_points(*(tuple(p.tolist()) for p in x))[2]) for x in corners]
        assert row[:2].tolist() == alone


@FAMILIES
@pytest.mark.parametrize("count", [1, 7, 17])
def test_a_pair_is_measured_the_same_in_any_lane(family: Callable[..., Pairs], count: int) -> None:
    """Whoever else is in the batch, bit for bit: a number of a run must not depend on how its pairs were listed."""
    pairs = family(np.random.default_rng(3), ROOM)
    pairs[0] = pairs[np.abs(pairs).max(axis=(1, 2, 3)).argmax()]  # with the same slack in each batch
    order = np.concatenate([[0], 1 + np.random.default_rng(4).permutation(ROOM - 1)[: count - 1]])
    assert (measured(pairs)[order] == measured(pairs[order])).all()


@pytest.mark.parametrize(("share", "far"), [(1.0 - 1e-9, True), (1.0 + 1e-9, False)])
def test_a_pair_is_far_from_its_limit_on(share: float, far: bool) -> None:
    """Two bars that cross at right angles, 1 Å apart, and do not move: the slabs are exactly as far apart."""
    bars = np.array([[[-1, 0, 0], [1, 0, 0], [0, -1, 1], [0, 1, 1]]] * 2, dtype=float)[np.newaxis]
    flags = np.zeros(ROOM, dtype=np.uint8)
    flag_far(filled(bars, share), 1.0, 1e-15, flags)
    assert bool(flags[0]) == far


@pytest.mark.parametrize(("share", "far"), [(1.0 + 1e-9, True), (1.0 - 1e-9, False)])
def test_a_pair_of_the_greatest_ratio_is_never_far(share: float, far: bool) -> None:
    """The same bars, one of which grows by 0.1 Å at both ends: ρ/(d0 + d1) is 0.05."""
    bars = np.array([[[-1, 0, 0], [1, 0, 0], [0, -1, 1], [0, 1, 1]]] * 2, dtype=float)[np.newaxis]
    bars[0, 1, :2, 0] += [-0.1, 0.1]
    flags = np.zeros(ROOM, dtype=np.uint8)
    flag_far(filled(bars, 0.1), 0.05 * share, 1e-15, flags)
    assert bool(flags[0]) == far


def test_a_far_pair_changes_nothing() -> None:
    rng, slack, count = np.random.default_rng(5), 1e-14, 0
    for nearest, ratio in ((0.1, 0.3), (0.5, 0.2), (1.0, 5.0)):
        pairs, flags = anywhere(rng, ROOM), np.zeros(ROOM, dtype=np.uint8)
        flag_far(filled(pairs, nearest), ratio, slack, flags)
        near0, near1, low0, low1, rho, gap, along, _ = measured(pairs)[flags == 1].T
        count += len(near0)
        assert (np.minimum(near0, near1) > nearest).all()
        assert (np.maximum(gap, along) > nearest).all()
        assert (rho < ratio * (low0 + low1)).all()
    assert count > ROOM // 2


def test_no_number_proves_nothing() -> None:
    """NaN in a coordinate: the pair is not far."""
    pairs = anywhere(np.random.default_rng(6), 12)
    pairs[:, :, 2:] += 50.0
    flags = np.zeros(ROOM, dtype=np.uint8)
    flag_far(filled(pairs, 0.1), 1.0, 1e-14, flags)
    assert flags[:12].all()
    for k in range(12):
        pairs[k, k % 2, k % 4, k % 3] = np.nan
    flag_far(filled(pairs, 0.1), 1.0, 1e-14, flags)
    assert not flags[:12].any()


def test_an_image_is_moved_and_a_lane_copied() -> None:
    pairs = anywhere(np.random.default_rng(7), 2)
    lanes, other = filled(pairs), fresh_lanes()
    shift_edge(lanes, np.uint64(1), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    copy_lane(lanes, np.uint64(1), other, np.uint64(3))
    rows = other.reshape(-1, ROOM)[:, 3]
    expected = pairs[1].copy()
    expected[0, 2:] += [1.0, 2.0, 3.0]
    expected[1, 2:] += [4.0, 5.0, 6.0]
    assert rows[START : START + 12].tolist() == expected[0].ravel().tolist()
    assert rows[END : END + 12].tolist() == expected[1].ravel().tolist()
    assert lanes.reshape(-1, ROOM)[START : START + 12, 0].tolist() == pairs[0, 0].ravel().tolist()
