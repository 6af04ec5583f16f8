"""Profiles: joined in any order and from any pieces they are the same, and a bound stays one in float32."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdtopo.records import Profile
from mdtopo.records.profile import rounded_down


def profile_of(steps: list[int], least: list[float], length: int = 4, stride: int = 1, n: int = 3) -> Profile:
    """One window for each step at most: the row of the least clearance; values of a row tell its step."""
    window = np.array(steps, dtype=np.int64) * stride // (length * stride)
    rows = [
        Profile(
            length * stride,
            window[k : k + 1],
            np.array([step]),
            np.array([least[k]]),
            np.full((1, n), step, dtype=np.float32),
        )
        for k, step in enumerate(steps)
    ]
    return Profile.joined(rows)


def assert_same(found: Profile, expected: Profile) -> None:
    assert found.window_frames == expected.window_frames
    for name in ("window", "step", "least", "clearance"):
        one, other = getattr(found, name), getattr(expected, name)
        assert one.dtype == other.dtype
        assert one.tobytes() == other.tobytes(), name


def test_a_window_keeps_the_row_of_least_clearance_and_of_equals_the_first() -> None:
    found = profile_of([0, 1, 2, 5, 6, 7], [0.5, 0.2, 0.2, 0.9, 0.3, 0.4])
    assert found.window.tolist() == [0, 1]
    assert found.step.tolist() == [1, 6]
    assert found.least.tolist() == [0.2, 0.3]
    assert found.clearance.tolist() == [[1, 1, 1], [6, 6, 6]]


@given(
    least=st.lists(st.sampled_from([0.0, 0.1, 0.2, 0.3]), min_size=1, max_size=40),
    cuts=st.lists(st.integers(0, 40), max_size=4),
    order=st.randoms(use_true_random=False),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_it_does_not_matter_where_it_is_cut_nor_in_which_order_it_is_joined(least, cuts, order) -> None:  # type: ignore[no-untyped-def]
    steps = list(range(len(least)))
    bounds = [0, *sorted(min(cut, len(least)) for cut in cuts), len(least)]
    pieces = [profile_of(steps[a:b], least[a:b]) if b > a else Profile.none(3) for a, b in pairwise(bounds)]
    order.shuffle(pieces)
    whole = profile_of(steps, least)
    assert_same(Profile.joined(pieces), whole)
    for most in (1, 6, 7, 12):  # pieces that had to be shortened before are shortened to the same
        assert_same(Profile.joined([piece.within(most) for piece in pieces]).within(most), whole.within(most))


@pytest.mark.parametrize(("most", "length", "rows"), [(30, 4, 10), (29, 8, 5), (15, 8, 5), (14, 16, 3), (2, 64, 1)])
def test_a_profile_too_large_gets_windows_twice_as_long(most: int, length: int, rows: int) -> None:
    steps = list(range(40))
    whole = profile_of(steps, [1.0 / (1 + step) for step in steps])
    found = whole.within(most)
    assert (found.window_frames, len(found)) == (length, rows)
    assert_same(found, profile_of(steps, [1.0 / (1 + step) for step in steps], length=length))


def test_profiles_of_other_windows_are_joined_to_the_least_common_multiple() -> None:
    one, other = profile_of([0, 5], [0.5, 0.5], length=4), profile_of([12, 20], [0.3, 0.4], length=6)
    found = Profile.joined([one, other])
    assert found.window_frames == 12
    assert found.window.tolist() == [0, 1]
    assert found.step.tolist() == [0, 12]


def test_rows_of_some_steps_and_under_other_numbers() -> None:
    whole = profile_of(list(range(12)), [0.1] * 12)
    assert whole.step.tolist() == [0, 4, 8]
    assert whole.between(4, 8).step.tolist() == [4]
    assert whole.between(1, 4).clearance.shape == (0, 3)
    assert whole.moved_by(100).step.tolist() == [100, 104, 108]
    assert whole.moved_by(100).window.tolist() == whole.window.tolist()


def test_nothing_joined_is_nothing() -> None:
    assert len(Profile.joined([])) == 0
    assert Profile.joined([Profile.none(7), Profile.none(7)]).clearance.shape == (0, 7)
    assert Profile.none(7).within(1).clearance.shape == (0, 7)


@given(st.lists(st.floats(0.0, 1e6, allow_nan=False), min_size=1))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_a_lower_bound_stays_one_in_float32_and_is_the_greatest_of_them(values: list[float]) -> None:
    exact = np.array(values)
    found = rounded_down(exact)
    assert found.dtype == np.float32
    assert (found <= exact).all()
    assert (np.nextafter(found, np.float32(np.inf)).astype(np.float64) > exact).all()


def test_no_value_stays_no_value_in_float32() -> None:
    assert np.isnan(rounded_down(np.array([np.nan]))).all()
    assert rounded_down(np.array([0.0])).tolist() == [0.0]
