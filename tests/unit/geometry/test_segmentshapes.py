"""Where segments are, and how far apart at least: hand values, and never more than sampling finds."""

from math import comb

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.segmentshapes import (
    AWAY,
    HALF0,
    HALF1,
    MID0,
    MID1,
    RADIUS,
    across_chords,
    chord_separation,
    mean_chord,
    pair_separation,
    separation_along,
    shapes_of,
    vector_of,
)

Points = NDArray[np.float64]
ZERO = (0.0, 0.0, 0.0)

STRAIGHT = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])
ARCH = np.array([[0.0, 0, 2], [1, 0.5, 2], [2, 0.5, 2], [3, 0, 2]])
TWO = np.stack([STRAIGHT, ARCH])
RISE = np.array([0.0, 0, 1])


def test_shapes_by_hand() -> None:
    shapes, boxes = shapes_of(TWO, TWO + RISE)
    assert vector_of(shapes, 0, MID0) == (1.5, 0.0, 0.0)
    assert vector_of(shapes, 0, MID1) == (1.5, 0.0, 1.0)
    assert vector_of(shapes, 1, HALF0) == vector_of(shapes, 1, HALF1) == (1.5, 0.0, 0.0)
    assert shapes[:, AWAY].tolist() == pytest.approx([0.0, 0.5], abs=1e-15)
    assert shapes[:, RADIUS].tolist() == [1.5, 1.5]
    assert boxes.tolist() == [[0, 0, 0, 3, 0, 1], [0, 0, 2, 3, 0.5, 3]]
    assert mean_chord(shapes) == 3.0


def test_separations_by_hand() -> None:
    """One stands still above the other: the chords are 2 apart, the arch strays 0.5, but all its points are 2 up."""
    shapes, _ = shapes_of(TWO, TWO)
    low, w = chord_separation(shapes, 0, 1, ZERO, ZERO, 0.0)
    assert low == pytest.approx(1.5, abs=1e-11)
    assert w == (0.0, 0.0, 4.0)
    assert separation_along(TWO, TWO, 0, 1, ZERO, ZERO, w, 0.0) == 2.0
    assert separation_along(TWO, TWO, 0, 1, ZERO, ZERO, w, 0.01) == pytest.approx(1.96, abs=1e-12)
    assert separation_along(TWO, TWO, 0, 1, (0, 0, -1.5), (0, 0, 7), w, 0.0) == 0.5
    assert separation_along(TWO, TWO, 0, 1, ZERO, ZERO, ZERO, 0.0) == 0.0
    assert across_chords(shapes, 0, 1, ZERO, ZERO)[2] == 2.0


@pytest.mark.parametrize(("wanted", "expected"), [(1.4, 1.5), (1.6, 2.0), (9.0, 2.0)])
def test_no_dearer_bound_is_asked_for_than_is_wanted(wanted: float, expected: float) -> None:
    shapes, _ = shapes_of(TWO, TWO)
    assert pair_separation(TWO, TWO, shapes, 0, 1, ZERO, ZERO, 0.0, wanted) == pytest.approx(expected, abs=1e-11)


def test_two_that_meet_are_not_separated() -> None:
    shapes, _ = shapes_of(TWO, TWO)
    below = (0.0, 0.0, -2.0)
    assert pair_separation(TWO, TWO, shapes, 0, 1, below, below, 0.0, 1.0) <= 0.0
    assert pair_separation(TWO, TWO, shapes, 0, 1, ZERO, (0.0, 0.0, -4.0), 0.0, 1.0) <= 0.0


@pytest.mark.parametrize("seed", range(30))
def test_no_separation_is_above_the_sampled_distance(seed: int) -> None:
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 5))
    c0 = random.normal(size=(2, n + 1, 3)) + np.array([[[0.0, 0, 0]], [[4.0, 0, 0]]])
    c1 = c0 + random.normal(size=c0.shape) * 10.0 ** random.uniform(-2, 0)
    shift0, shift1 = (tuple(random.normal(size=3).tolist()) for _ in range(2))
    shapes, boxes = shapes_of(c0, c1)
    u, least = np.linspace(0, 1, 17), np.inf
    for t in np.linspace(0, 1, 9):
        a, b = (1 - t) * c0 + t * c1
        b = b + (1 - t) * np.array(shift0) + t * np.array(shift1)
        basis = np.stack([comb(n, k) * u**k * (1 - u) ** (n - k) for k in range(n + 1)], axis=1)
        least = min(least, float(np.linalg.norm((basis @ a)[:, None] - (basis @ b)[None], axis=2).min()))
    low, w = chord_separation(shapes, 0, 1, shift0, shift1, 0.0)
    assert low <= least
    assert separation_along(c0, c1, 0, 1, shift0, shift1, w, 0.0) <= least + 1e-12
    assert low - 1e-9 <= pair_separation(c0, c1, shapes, 0, 1, shift0, shift1, 0.0, 99.0) <= least + 1e-12
    both = np.concatenate([c0, c1], axis=1)
    np.testing.assert_array_equal(boxes, np.concatenate([both.min(axis=1), both.max(axis=1)], axis=1))
