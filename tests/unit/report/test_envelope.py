"""Bins keep their extremes: a single step among a million cannot vanish."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdtopo.report.envelope import MOST_BINS, bin_starts, envelope, worst_states


def test_by_hand() -> None:
    values = np.array([3.0, 1.0, np.nan, 2.0, np.nan])
    found = envelope(values, bin_starts(5, most=3))
    assert found.least.tolist()[:2] == [1.0, 2.0]
    assert found.greatest.tolist()[:2] == [3.0, 2.0]
    assert found.least_row.tolist() == [1, 3, -1]
    assert found.greatest_row.tolist() == [0, 3, -1]
    assert np.isnan(found.least[2])


@pytest.mark.parametrize("row", [0, 1, 499_999, 999_999])
def test_one_step_in_a_million(row: int) -> None:
    values = np.full(1_000_000, 0.1)
    values[row] = 0.85
    starts = bin_starts(len(values))
    found = envelope(values, starts)
    assert len(starts) <= MOST_BINS
    assert found.greatest.max() == 0.85
    assert found.greatest_row[found.greatest.argmax()] == row
    states = np.zeros(len(values), dtype=np.int8)
    states[row] = 2
    assert worst_states(states, starts).sum() == 2


@given(st.lists(st.one_of(st.floats(allow_nan=True, allow_infinity=True)), max_size=40), st.integers(1, 12))
def test_extremes_are_those_of_the_values(numbers: list[float], most: int) -> None:
    values = np.array(numbers, dtype=float)
    starts = bin_starts(len(values), most)
    found = envelope(values, starts)
    for k, part in enumerate(np.split(values, starts[1:]) if len(values) else []):
        known = part[~np.isnan(part)]
        if not len(known):
            assert found.least_row[k] == found.greatest_row[k] == -1
            continue
        assert found.least[k] == known.min() == values[found.least_row[k]]
        assert found.greatest[k] == known.max() == values[found.greatest_row[k]]
        assert starts[k] <= found.least_row[k] < starts[k] + len(part)
