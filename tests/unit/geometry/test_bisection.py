"""Bisection of a step: what it proves is true, clear gaps are proved, and passages are not."""

from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mdtopo.geometry.bisection import bisected_clearance, distance_bound
from mdtopo.geometry.pairs import relative_motion
from mdtopo.geometry.passage import moving_pair

Points = NDArray[np.float64]


def corners(x: Points) -> Any:
    return tuple(map(tuple, np.asarray(x, dtype=float).tolist()))


def clearance(x0: Points, x1: Points, placing: float = 0.0, enough: float = np.inf) -> float:
    start, end = corners(x0), corners(x1)
    return float(bisected_clearance(moving_pair(start, end, placing), relative_motion(start, end) + placing, enough))


def sampled(x0: Points, x1: Points) -> float:
    times = np.linspace(0.0, 1.0, 401)
    return min(oracles.edge_distance(*((1.0 - t) * x0 + t * x1)) for t in times)


def swinging(gap: float) -> tuple[Points, Points]:
    """An edge along x that rests, and one along y that swings past its end at a distance, from above to below."""
    first = [[-1.0, 0, 0], [1.0, 0, 0]]
    return (
        np.array([*first, [1.0 + gap, -1, 4], [1.0 + gap, 1, 4]]),
        np.array([*first, [1.0 + gap, -1, -4], [1.0 + gap, 1, -4]]),
    )


@pytest.mark.parametrize("gap", [1.0, 0.1, 1e-3, 1e-6, 1e-9])
def test_a_clear_gap_is_proved_however_narrow(gap: float) -> None:
    found = clearance(*swinging(gap))
    assert 0.0 < found <= gap


@pytest.mark.parametrize("gap", [0.0, -1e-9, -0.5])
def test_a_contact_or_a_passage_is_never_proved_apart(gap: float) -> None:
    assert clearance(*swinging(gap)) == 0.0


def test_a_wide_gap_is_proved_with_much_of_its_width() -> None:
    assert clearance(*swinging(1.0)) > 0.3


def test_contact_at_an_end_of_the_step_is_not_proved_apart() -> None:
    x0, x1 = swinging(-0.5)
    x1[2:, 2] = 0.0
    assert clearance(x0, x1) == 0.0
    assert clearance(x1, x0) == 0.0
    x1[2:, 2] = 1e-9
    assert 0.0 < clearance(x0, x1) <= 1e-9


def test_an_error_of_placing_as_large_as_the_gap_proves_nothing() -> None:
    x0, x1 = swinging(0.01)
    assert clearance(x0, x1, 1e-3) > 0.0
    assert clearance(x0, x1, 0.01) == 0.0


def test_positions_that_are_no_numbers_prove_nothing() -> None:
    x0, x1 = swinging(1.0)
    x1[3, 1] = np.nan
    assert clearance(x0, x1) == 0.0


def test_edges_at_rest_have_their_distance_as_clearance() -> None:
    x0, _ = swinging(1.0)
    found = clearance(x0, x0)
    assert found == pytest.approx(np.sqrt(17.0), rel=1e-12)
    assert found <= np.sqrt(17.0)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.1, 1.0, 3.0]))
@settings(max_examples=60)
def test_a_clearance_is_below_the_sampled_distance_and_is_found_where_that_is_wide(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    x0 = rng.normal(size=(4, 3))
    x1 = x0 + size * rng.normal(size=(4, 3))
    found, above = clearance(x0, x1), sampled(x0, x1)
    assert found <= above
    truth = oracles.pair_passages(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3))
    if truth.events or truth.contacts:
        assert found == 0.0
    # the least distance may lie half a sample away
    elif above > relative_motion(corners(x0), corners(x1)) / 400.0:
        assert found > 0.0


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
@settings(max_examples=60)
def test_the_bound_of_a_distance_is_sharp_and_below_it(seed: int, t: float) -> None:
    x0, x1 = np.random.default_rng(seed).normal(size=(2, 4, 3))
    exact = oracles.edge_distance(*((1.0 - t) * x0 + t * x1))
    bound = distance_bound(moving_pair(corners(x0), corners(x1), 0.0), t)
    assert bound <= exact
    assert bound == pytest.approx(exact, abs=1e-6)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_time_and_the_order_of_the_edges_can_be_turned_round(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x0 = rng.normal(size=(4, 3))
    x1 = x0 + rng.normal(size=(4, 3))
    found = clearance(x0, x1)
    swap = [2, 3, 0, 1]
    for other in (clearance(x1, x0), clearance(x0[swap], x1[swap])):
        assert (found > 0.0) == (other > 0.0)


def test_a_clearance_that_is_enough_need_not_be_sharp() -> None:
    """It is the sharp one unless that is more than was asked for, and then above what was asked for, and no more."""
    rng, early = np.random.default_rng(3), 0
    for _ in range(200):
        x0 = rng.normal(size=(4, 3))
        x1 = x0 + rng.normal(size=(4, 3))
        sharp = clearance(x0, x1)
        for enough in (0.0, 0.3 * sharp, 0.9 * sharp, sharp, 2.0 * sharp):
            found = clearance(x0, x1, enough=enough)
            if sharp <= enough:
                assert found == sharp
            else:
                assert enough < found
                assert found <= sampled(x0, x1)
                early += found != sharp
    assert early > 50
