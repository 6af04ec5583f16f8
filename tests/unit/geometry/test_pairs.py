"""What is known of two moving edges without a search for closest points."""

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.pairs import Corners, axis_gap, hull_clearance
from mdtopo.geometry.vectors import Vector

Points = NDArray[np.float64]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def halves(start: Points, end: Points) -> tuple[Vector, Vector, Vector, Vector, Vector, Vector]:
    """Return centres and half edges, as the bounds take them, of edges (2, 2, 3) at both ends of a step."""
    middles = [0.5 * (x[1].sum(axis=0) - x[0].sum(axis=0)) for x in (start, end)]
    spans = [0.5 * (x[:, 1] - x[:, 0]) for x in (start, end)]
    c0, c1, f0, g0, f1, g1 = (tuple(map(float, v)) for v in (*middles, *spans[0], *spans[1]))
    return c0, c1, f0, g0, f1, g1  # type: ignore[return-value]


def corners(x: Points) -> Corners:
    a, b, c, d = (tuple(map(float, p)) for p in x.reshape(4, 3))
    return a, b, c, d  # type: ignore[return-value]


def moving_pair(rng: np.random.Generator) -> tuple[Points, Points]:
    """Return two edges, mostly a little apart, before and after a motion."""
    start = rng.normal(size=(2, 2, 3))
    start[1] += rng.uniform(0.0, 3.0) * rng.normal(size=3)
    return start, start + rng.uniform(0.0, 0.7) * rng.normal(size=start.shape)


@pytest.mark.parametrize("gap", [1.0, 1e-3, 1e-12, 0.0, -1e-12, -1e-3])
def test_the_gap_across_an_axis_is_that_of_the_nearer_end(gap: float) -> None:
    """Bars along x and y, one above the other: apart by the lesser height, on either side."""
    for sign in (1.0, -1.0):
        low, high = (0.0, 0.0, sign * gap), (0.0, 0.0, sign * (gap + 0.5))
        assert axis_gap(low, high, X, Y, X, Y) == gap
        assert axis_gap(high, low, X, Y, X, Y) == gap


def test_slabs_that_change_sides_or_axes_are_not_apart() -> None:
    assert axis_gap((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), X, Y, X, Y) == -1.0
    assert axis_gap((3.0, 0.0, 0.0), (0.0, 0.0, 3.0), X, Y, X, Y) == 0.0
    assert axis_gap((0.0, 0.0, 1.5), (0.0, 0.0, 1.5), Z, X, Z, X) == 0.5


def test_a_gap_of_slabs_is_never_above_the_hull() -> None:
    """So a pair whose boxes are apart by more than the reach has a clearance beyond it, whatever the axes are."""
    rng, positive = np.random.default_rng(1), 0
    for _ in range(400):
        start, end = moving_pair(rng)
        gap = axis_gap(*halves(start, end))
        if gap > 0.0:
            positive += 1
            assert gap <= hull_clearance(corners(start), corners(end), np.inf) + 1e-12
    assert positive > 100


def test_a_hull_that_proves_enough_need_not_be_the_best() -> None:
    """It is d* unless that is more than was asked for, and then above what was asked for and not above d*."""
    rng, early = np.random.default_rng(2), 0
    for _ in range(300):
        start, end = (corners(x) for x in moving_pair(rng))
        best = hull_clearance(start, end, np.inf)
        for enough in (0.0, 0.3 * best, 0.999 * best, best, 1.5 * abs(best)):
            found = hull_clearance(start, end, enough)
            if best <= enough:
                assert found == best
            else:
                assert enough < found <= best + 1e-12
                early += found < best - 1e-9
    assert early > 100
