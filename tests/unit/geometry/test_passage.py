"""Passages of two moving edges: float kernel, exact arithmetic and bisection against the oracle."""

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles import least_distance_during, pair_passages

from mdtopo.geometry.bisection import bisected_clearance
from mdtopo.geometry.pairs import relative_motion
from mdtopo.geometry.passage import FREE, PASSES, moving_pair, passages
from mdtopo.geometry.rational import exact_passages

Points = NDArray[np.float64]


def corners(x: Points) -> Any:
    return tuple(map(tuple, x.tolist()))


def exact(x: Points) -> Any:
    return tuple(tuple(Fraction(v) for v in p) for p in x.tolist())


def motions(seed: int, n: int, grid: float) -> Iterator[tuple[Points, Points]]:
    """Yield random moving pairs, on a grid where it is not 0: there contacts at ends and in one plane are common."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        x0 = rng.normal(size=(4, 3))
        x1 = x0 + rng.normal(size=(4, 3)) * rng.choice([0.1, 1.0, 2.0])
        yield (np.round(x0 / grid) * grid, np.round(x1 / grid) * grid) if grid else (x0, x1)


@pytest.mark.parametrize("grid", [0.0, 0.5, 1.0])
def test_the_kernel_agrees_with_the_oracle_wherever_it_is_sure(grid: float) -> None:
    n_sure = 0
    for x0, x1 in motions(1, 400, grid):
        state, count, found, signs = passages(corners(x0), corners(x1), 0.0)
        truth = pair_passages(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3))
        if state == FREE:
            n_sure += 1
            assert not truth.events
            assert not truth.contacts
        if state == PASSES:
            n_sure += 1
            assert count == len(truth.events)
            assert not truth.contacts
            for k, event in enumerate(truth.events):
                assert found[k] == pytest.approx((event.t, float(event.s), float(event.r)), abs=1e-7)
                assert event.sign == (1 if signs >> k & 1 else -1)
    assert n_sure > 300


@pytest.mark.parametrize("grid", [0.0, 0.5, 1.0])
def test_exact_arithmetic_agrees_with_the_oracle(grid: float) -> None:
    for x0, x1 in motions(2, 120, grid):
        state, meetings = exact_passages(exact(x0), exact(x1))
        truth = pair_passages(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3))
        if state == "sliding":
            continue
        assert [m.sign for m in meetings] == [event.sign for event in truth.events]
        assert [m.t for m in meetings] == pytest.approx([event.t for event in truth.events], abs=1e-12)
        assert (state in ("free", "passage")) == (not truth.contacts)


@pytest.mark.parametrize("grid", [0.0, 1.0])
def test_bisection_proves_only_what_stays_apart(grid: float) -> None:
    n_proved = 0
    for x0, x1 in motions(3, 200, grid):
        start, end = corners(x0), corners(x1)
        clearance = bisected_clearance(moving_pair(start, end, 0.0), relative_motion(start, end), np.inf)
        _, above = least_distance_during(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3), tolerance=1e-4)
        assert clearance <= above
        n_proved += clearance > 0.0
    assert n_proved > 100


def test_a_passage_at_a_known_time() -> None:
    x0 = np.array([[-8.0, 0, 0], [8, 0, 0], [0, -8, -3], [0, 8, -3]])
    x1 = np.array([[-8.0, 0, 0], [8, 0, 0], [0, -8, 5], [0, 8, 5]])
    state, count, found, _ = passages(corners(x0), corners(x1), 0.0)
    assert (state, count) == (PASSES, 1)
    assert found[0] == pytest.approx((3 / 8, 1 / 2, 1 / 2), abs=1e-12)


@pytest.mark.parametrize("placing", [1e-13, 1e-11])
def test_a_time_is_as_good_where_positions_may_be_off(placing: float) -> None:
    """The bound of their error is far above it, and must not be what the root is refined to."""
    n_sure = n_events = 0
    for x0, x1 in motions(4, 400, 0.0):
        truth = pair_passages(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3))
        n_events += len(truth.events) > 0
        state, count, found, _ = passages(corners(x0), corners(x1), placing)
        if state == PASSES:
            n_sure += 1
            assert [found[k][0] for k in range(count)] == pytest.approx([e.t for e in truth.events], abs=1e-12)
    assert n_events > 20
    assert n_sure > 0.95 * n_events


@pytest.mark.parametrize(("placing", "is_known"), [(0.0, True), (6.2e-8, True), (6.4e-8, False)])
def test_a_time_that_is_not_known_well_is_left_open(placing: float, is_known: bool) -> None:
    """f may be off by 2·(16·16 + 2·16·12.37) times that, its slope is 16·16·8; the bracket, 2.5 of both, has 1e-7."""
    x0 = np.array([[-8.0, 0, 0], [8, 0, 0], [0, -8, -3], [0, 8, -3]])
    x1 = np.array([[-8.0, 0, 0], [8, 0, 0], [0, -8, 5], [0, 8, 5]])
    assert (passages(corners(x0), corners(x1), placing)[0] == PASSES) == is_known


def test_a_rounding_error_as_large_as_the_gap_leaves_it_open() -> None:
    x0 = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 1e-3], [0, 1, 1e-3]])
    x1 = x0.copy()
    x1[2:, 2] = 2e-3
    assert passages(corners(x0), corners(x1), 0.0)[0] == FREE
    assert passages(corners(x0), corners(x1), 2e-3)[0] not in (FREE, PASSES)
