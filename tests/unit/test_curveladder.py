"""A step of a curve with periodic images, against the same system with its images written out."""

from itertools import pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.curves import following_of

from mdtopo.curveladder import CurveMeasure, measure_curve
from mdtopo.records import Rung

Points = NDArray[np.float64]
LAB = np.zeros((3, 3))

CUBE = 6.0 * np.eye(3)
SKEWED = np.array([[6.0, 0, 0], [2.5, 5.5, 0], [-1.5, 2.0, 6.5]])
CELLS = {"cube": (CUBE, CUBE), "skewed": (SKEWED, SKEWED), "moving": (SKEWED, SKEWED * 1.01 + 0.03)}
IMAGES = [np.array(counts) for counts in product((-1, 0, 1), repeat=3)]


def strand(ends: Points) -> Points:
    """Return straight cubics from one place to the next."""
    share = np.linspace(0, 1, 4)[:, None]
    return np.stack([(1 - share) * a + share * b for a, b in pairwise(ends)])


def system(seed: int) -> tuple[Points, Points, list[int]]:
    """Return two strands across each other, one of which rises through the boundary, up to the other or through it."""
    random = np.random.default_rng(seed)
    lengths = [4, 3]
    one = np.array([-1.0, 1.0, 0.5]) + np.arange(5)[:, None] * [1.2, 0.0, 0.0]
    other = np.array([1.5, 3.0, 5.5]) + np.arange(4)[:, None] * [0.0, -1.2, 0.0]
    ends = [x + random.normal(scale=0.2, size=x.shape) for x in (one, other)]
    rise = [np.zeros(3), np.array([0.0, 0.0, 1.8 if seed % 2 else 0.4])]
    moved = [x + random.normal(scale=0.1, size=x.shape) + up for x, up in zip(ends, rise, strict=True)]
    bend = random.normal(scale=0.1, size=(sum(lengths), 4, 3)) * np.array([0.0, 1.0, 1.0, 0.0])[None, :, None]
    c0, c1 = (np.concatenate([strand(x) for x in both]) + bend for both in (ends, moved))
    return c0, c1, following_of(lengths, [False, False])


def periodic(c0: Points, c1: Points, following: list[int], cells: tuple[Points, Points]) -> CurveMeasure:
    return measure_curve(c0, c1, np.array(following), *cells, True, 0.0)  # type: ignore[no-any-return]


def written_out(c0: Points, c1: Points, following: list[int], cells: tuple[Points, Points]) -> CurveMeasure:
    """Measure the system and all its images around it, without periodicity; the home image comes first."""
    order = sorted(IMAGES, key=lambda counts: bool(counts.any()))
    ends = [np.concatenate([c + counts @ cell for counts in order]) for c, cell in zip((c0, c1), cells, strict=True)]
    m, after = len(c0), np.array(following)
    shifted = [np.where(after < 0, -1, after + k * m) for k in range(len(order))]
    return measure_curve(*ends, np.concatenate(shifted), LAB, LAB, False, 0.0)  # type: ignore[no-any-return]


def passages(found: Points, m: int, images: list[Points] | None) -> set[tuple[int, ...]]:
    """Return pairs with the image of the second as seen from the first, and their times in 1e-9; each once."""
    rows = set()
    for i, j, *rest in found.tolist():
        shift, t, sign = np.array(rest[:3]), rest[3], int(rest[6])
        if images is not None:
            shift = images[int(j) // m] - images[int(i) // m]
        one = (int(i) % m, int(j) % m, *(int(s) for s in shift))
        other = (one[1], one[0], *(-s for s in one[2:]))
        rows.add((*min(one, other), round(t * 1e9), sign))
    return rows


@pytest.mark.parametrize("name", CELLS)
@pytest.mark.parametrize("seed", range(12))
def test_images_are_measured_as_if_they_were_written_out(name: str, seed: int) -> None:
    c0, c1, following = system(seed)
    one, other = periodic(c0, c1, following, CELLS[name]), written_out(c0, c1, following, CELLS[name])
    order = sorted(IMAGES, key=lambda counts: bool(counts.any()))
    assert one.countable
    assert other.n_open == one.n_open * len(order)
    assert passages(one.found, len(c0), None) == passages(other.found, len(c0), order)
    if not len(one.found) and not one.n_open:
        assert one.clearance == pytest.approx(other.clearance, abs=1e-9)
        for measure in (one, other):  # the same pair, or one as close: two that are joined may both be nearest there
            pair = sorted({int(k) % len(c0) for k in measure.pair})
            alone = periodic(c0[pair], c1[pair], [-1] * len(pair), CELLS[name])
            assert alone.clearance == pytest.approx(one.clearance, abs=1e-9)
    assert one.d_star == pytest.approx(other.d_star, rel=1e-12)
    assert one.bezier_ratio == pytest.approx(other.bezier_ratio, rel=1e-9)


def test_the_systems_above_have_passages_and_clearances_through_the_boundary() -> None:
    through, certified, crossed = 0, 0, 0
    for name, seed in product(CELLS, range(12)):
        c0, c1, following = system(seed)
        measure = periodic(c0, c1, following, CELLS[name])
        through += int(measure.found[:, 2:5].any(axis=1).sum())
        crossed += len(measure.found) > 0
        certified += measure.rung != Rung.OPEN and not len(measure.found)
    assert through > 5
    assert crossed > 5
    assert certified > 5


BAR = np.array([[[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]]])
RISE = np.array([0.0, 0, 1])


@pytest.mark.parametrize(("reach", "passes"), [(0.49, False), (0.51, True)])
def test_two_bars_pass_through_the_boundary_or_do_not(reach: float, passes: bool) -> None:
    """One at the bottom of the cell, one at the top, which rises up to and through the bottom one's image."""
    across = np.array([[[0.5, -0.5, 5.5], [0.5, 0, 5.5], [0.5, 0.5, 5.5]]])
    c0 = np.concatenate([BAR, across])
    c1 = np.concatenate([BAR, across + reach * RISE])
    measure = periodic(c0, c1, [-1, -1], (CUBE, CUBE))
    assert len(measure.found) == passes
    if passes:
        row = measure.found[0].tolist()
        assert row[2:5] in ([0, 0, -1], [0, 0, 1])
        assert row[5] == pytest.approx(0.5 / reach, rel=1e-12)
        assert row[6:8] == pytest.approx([0.5, 0.5], abs=1e-12)
    else:
        assert measure.clearance == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize(("length", "clearance"), [(5.5, 0.5), (5.9, 0.1)])
def test_a_strand_keeps_its_distance_from_its_own_image(length: float, clearance: float) -> None:
    line = np.array([[[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]]]) * length
    measure = periodic(line, line, [-1], (CUBE, CUBE))
    assert measure.rung != Rung.OPEN
    assert measure.pair.tolist() == [0, 0]
    assert measure.clearance == pytest.approx(clearance, rel=1e-9)


def test_a_strand_passes_through_its_own_image() -> None:
    """A bar along x whose middle part juts out by more than a cell, beside its ends: then it comes down."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 6.5, 0.3], [0.2, 5.5, 0.3]])
    c0 = strand(corners)
    lowered = corners * [1.0, 1.0, -1.0]
    c1 = strand(lowered)
    measure = periodic(c0, c1, [1, 2, -1], (CUBE, CUBE))
    assert len(measure.found) >= 1
    assert measure.found[:, 2:5].any(axis=1).all()
    assert passages(measure.found, 3, None) == passages(
        written_out(c0, c1, [1, 2, -1], (CUBE, CUBE)).found, 3, sorted(IMAGES, key=lambda counts: bool(counts.any()))
    )


def test_a_single_segment_of_its_own_is_infinitely_clear_and_in_a_wide_cell_as_far_as_was_looked() -> None:
    assert measure_curve(BAR, BAR, np.array([-1]), LAB, LAB, False, 0.0).clearance == np.inf
    assert periodic(BAR, BAR, [-1], (CUBE, CUBE)).clearance == pytest.approx(1.0, rel=1e-12)
