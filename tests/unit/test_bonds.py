"""Reference lengths, limits on both of their sides, and how long an edge must be too long."""

import numpy as np
import pytest

from mdtopo.bonds import BondLimits, BondState, reference_lengths
from mdtopo.records import MonitorConfig, ReferenceLengths

CONFIG = MonitorConfig()


def reference(spread: float, lengths: tuple[float, ...] = (1.0, 1.0)) -> ReferenceLengths:
    return ReferenceLengths(np.array(lengths), 1.0, spread, 10)


def test_the_reference_is_the_median_of_each_edge() -> None:
    samples = np.array([[1.0, 3.8], [1.1, 3.9], [9.0, 3.7]])
    assert reference_lengths(samples).lengths.tolist() == [1.1, 3.8]


def test_frames_that_cannot_be_used_do_not_count() -> None:
    found = reference_lengths(np.array([[1.0, 2.0], [np.nan, np.nan], [1.2, 2.2]]))
    assert found.n_frames == 2
    assert found.lengths == pytest.approx([1.1, 2.1])


def test_without_a_usable_frame_no_edge_is_ever_too_long() -> None:
    limits = BondLimits.of(reference_lengths(np.full((3, 2), np.nan)), CONFIG)
    assert not (np.array([1e9, 1e9]) >= limits.stretch).any()


def test_the_spread_of_normal_lengths_is_their_standard_deviation() -> None:
    samples = np.random.default_rng(1).normal(3.8, 0.05, size=(10, 2000))
    assert reference_lengths(samples).spread == pytest.approx(0.05, rel=0.03)


def test_one_bond_that_breaks_at_once_does_not_make_the_limits_blunt() -> None:
    samples = np.random.default_rng(1).normal(1.0, 0.03, size=(10, 100))
    broken = samples.copy()
    broken[6:, 7] = 2.0
    before, after = (BondLimits.of(reference_lengths(s), CONFIG).stretch.max() for s in (samples, broken))
    assert after == pytest.approx(before, rel=0.05)


@pytest.mark.parametrize(
    ("spread", "stretch", "fracture"), [(0.0, 1.2, 1.5), (0.019, 1.2, 1.5), (0.03, 1.3, 1.5), (0.1, 2.0, 2.5)]
)
def test_the_greater_of_the_two_limits_rules(spread: float, stretch: float, fracture: float) -> None:
    limits = BondLimits.of(reference(spread), CONFIG)
    assert limits.stretch == pytest.approx([stretch, stretch])
    assert limits.fracture == pytest.approx([fracture, fracture])


def test_an_edge_is_held_against_its_own_length() -> None:
    limits = BondLimits.of(reference(0.0, (1.0, 3.0)), CONFIG)
    assert limits.reference.tolist() == [1.0, 3.0]
    assert limits.stretch == pytest.approx([1.2, 1.2])


def state_after(*frames: float) -> BondState:
    state, limits = BondState.intact(1), BondLimits.of(reference(0.0, (1.0,)), CONFIG)
    for ratio in frames:
        state = state.after(np.array([ratio]), limits, CONFIG.fracture_frames)
    return state


@pytest.mark.parametrize(
    ("frames", "broken"),
    [
        ((1.5, 1.5, 1.5), True),
        ((1.5, 1.5, 1.499), False),
        ((1.5, 1.5), False),
        ((1.5, 1.0, 1.5, 1.5), False),
        ((1.5, np.nan, 1.5, 1.5), True),
        ((np.nan, np.nan, np.nan), False),
        ((1.5, 1.5, 1.5, 1.0), True),
    ],
)
def test_an_edge_breaks_when_it_is_too_long_for_three_frames_in_a_row(frames: tuple[float, ...], broken: bool) -> None:
    assert bool(state_after(*frames).broken[0]) is broken


def test_intact_means_nothing_broken_and_nothing_on_the_way() -> None:
    assert state_after(1.0).is_intact
    assert not state_after(1.5).is_intact
    assert not state_after(1.5, 1.5, 1.5, 1.0).is_intact
