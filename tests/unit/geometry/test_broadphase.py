"""No pair of moving spheres is missed, in no image; the grid against trying everything."""

import sys
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import all_pairs, candidate_pairs, images_can_meet
from mdtopo.geometry.lattice import basis_of

Points = NDArray[np.float64]
Generator = np.random.Generator
Pair = tuple[int, int, int, int, int]

NONE = np.zeros((3, 3))


def normal(i: int, j: int, s: tuple[int, ...]) -> Pair:
    """Return one of the two descriptions of a pair: (i, j + s) and (j, i - s)."""
    first, second = (i, j, *s), (j, i, *(-k for k in s))
    return min(first, second)  # type: ignore[return-value]


def as_set(pairs: NDArray[np.int64], images: NDArray[np.int64]) -> set[Pair]:
    images = images if len(images) else np.zeros((len(pairs), 3), dtype=np.int64)  # left out where all are 0
    listed = [normal(int(i), int(j), tuple(int(k) for k in s)) for (i, j), s in zip(pairs, images, strict=True)]
    assert len(set(listed)) == len(listed), "a pair is listed twice"
    return set(listed)


def both(
    mid0: Points, mid1: Points, radii: Points, cell: Points | None = None, span: int = 3
) -> tuple[set[Pair], set[Pair]]:
    h = NONE if cell is None else cell
    pairs, images, complete = candidate_pairs(mid0, mid1, radii, h, h, cell is not None)
    assert complete
    return as_set(pairs, images), as_set(*all_pairs(mid0, mid1, radii, h, h, cell is not None, span))


def radii_of(rng: Generator, kind: str, n: int) -> Points:
    if kind == "equal":
        return np.full(n, 0.8)
    if kind == "spread":
        return rng.uniform(0.05, 0.8, n)
    radii = rng.uniform(0.2, 0.4, n)
    radii[rng.integers(n, size=2)] = 2.0  # some are far larger than the others
    return radii


KINDS = ("equal", "spread", "some large")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2, 3, 10, 60, 150])
def test_without_a_cell_the_grid_finds_what_trying_all_pairs_finds(n: int, kind: str) -> None:
    rng = np.random.default_rng([n, len(kind)])
    for move in (0.0, 0.2, 2.0):
        mid0 = rng.uniform(0, 1.5 * n ** (1 / 3) + 0.5, (n, 3))
        found, expected = both(mid0, mid0 + rng.normal(0, move, (n, 3)), radii_of(rng, kind, n))
        assert found == expected
        assert expected or n < 60


CELLS = {
    "cube": np.eye(3),
    "skewed": np.array([[1, 0, 0], [0.4, 0.9, 0], [-0.45, 0.4, 0.8]]),
    "flat": np.diag([1.0, 1.2, 0.4]),
    "left-handed": np.array([[0, 1.0, 0], [1.1, 0.2, 0], [0.1, 0.3, 0.9]]),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cell", CELLS)
def test_in_a_constant_cell_the_grid_finds_what_trying_all_images_finds(cell: str, kind: str) -> None:
    rng, through = np.random.default_rng([len(cell), len(kind)]), 0
    for n, edge in ((1, 2.5), (2, 3.0), (25, 3.0), (25, 9.0)):
        h = edge * CELLS[cell]
        radii = np.minimum(radii_of(rng, kind, n), 0.3 * edge)
        mid0 = rng.uniform(0, 1, (n, 3)) @ h
        found, expected = both(mid0, mid0 + rng.normal(0, 0.1, (n, 3)), radii, h, span=4)
        assert found == expected
        through += sum(any(pair[2:]) for pair in expected)
    assert through > 0


def test_spheres_stored_many_cells_apart_have_the_pairs_of_those_stored_in_one() -> None:
    rng, n = np.random.default_rng(5), 25
    h = 5.0 * CELLS["skewed"]
    mid0, radii = rng.uniform(0, 1, (n, 3)) @ h, rng.uniform(0.2, 0.6, n)
    mid1, away = mid0 + rng.normal(0, 0.1, (n, 3)), rng.integers(-9, 10, (n, 3))
    _, expected = both(mid0, mid1, radii, h)
    pairs, images, complete = candidate_pairs(mid0 + away @ h, mid1 + away @ h, radii, h, h, True)
    assert complete
    assert as_set(pairs, images + away[pairs[:, 1]] - away[pairs[:, 0]]) == expected


@pytest.mark.parametrize("change", [0.005, 0.05, 0.15])
def test_in_a_moving_cell_no_pair_that_meets_at_some_time_is_missing(change: float) -> None:
    rng, n, seen = np.random.default_rng(int(1000 * change)), 12, 0
    shifts = np.array(list(product(range(-3, 4), repeat=3)))
    for name in CELLS:
        cell0 = 6.0 * CELLS[name]
        cell1 = cell0 @ (np.eye(3) + rng.uniform(-change, change, (3, 3)))
        radii = rng.uniform(0.3, 0.6, n)
        fractions = rng.uniform(-0.5, 1.5, (n, 3))
        mid0, mid1 = fractions @ cell0, fractions @ cell1 + rng.normal(0, 0.5, (n, 3))
        pairs, images, complete = candidate_pairs(mid0, mid1, radii, cell0, cell1, True)
        assert complete
        found = as_set(pairs, images)
        for t in np.linspace(0, 1, 41):
            x, h = (1 - t) * mid0 + t * mid1, (1 - t) * cell0 + t * cell1
            for i, j in product(range(n), repeat=2):
                close = np.linalg.norm(x[j] + shifts @ h - x[i], axis=1) <= radii[i] + radii[j]
                met = {normal(i, j, tuple(s)) for s in shifts[close].tolist() if i != j or any(s)}
                assert met <= found
                seen += any(any(pair[2:]) for pair in met)
    assert seen > 100


def test_where_images_cannot_meet_none_does() -> None:
    rng, answers = np.random.default_rng(7), []
    for _ in range(150):
        n, edge = int(rng.integers(1, 8)), rng.uniform(2.0, 12.0)
        cell0 = edge * CELLS[rng.choice(list(CELLS))]
        cell1 = cell0 @ (np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3)))
        mid0 = rng.uniform(0, 2.5, (n, 3))
        mid1, radii = mid0 + rng.normal(0, 0.2, (n, 3)), rng.uniform(0.1, 0.4, n)
        answers.append(images_can_meet(mid0, mid1, radii, basis_of(cell0), basis_of(cell1)))
        if not answers[-1]:
            shifts = np.array([s for s in product(range(-3, 4), repeat=3) if any(s)])
            for t in np.linspace(0, 1, 11):
                x, h = (1 - t) * mid0 + t * mid1, (1 - t) * cell0 + t * cell1
                apart = np.linalg.norm(x[:, None, None] - x[None, :, None] - shifts @ h, axis=-1)
                assert (apart > (radii[:, None] + radii)[..., None]).all()
    assert 20 < sum(answers) < 130


@pytest.mark.parametrize(("edge", "meets"), [(2.001, False), (1.999, True)])
def test_a_sphere_meets_its_own_image_when_the_cell_is_as_wide_as_it(edge: float, meets: bool) -> None:
    h, mid = edge * np.eye(3), np.array([[0.3, 0.2, 0.1]])
    assert images_can_meet(mid, mid, np.ones(1), basis_of(h), basis_of(h)) == meets
    found, expected = both(mid, mid, np.ones(1), h)
    assert found == expected
    assert len(found) == (3 if meets else 0)


@pytest.mark.parametrize("away", [1e3, 1e7, 1e12])
def test_far_outliers_keep_the_memory_bounded(away: float) -> None:
    resource = pytest.importorskip("resource")
    rng = np.random.default_rng(8)
    mid = rng.uniform(0, 8, (200, 3))
    mid[[0, 77]] = [[away, -away, away], [-away, away, 0]]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found, expected = both(mid, mid, np.full(200, 0.5))
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert found == expected
    assert expected
    assert grown < 100_000 * (1024 if sys.platform == "darwin" else 1)  # kB; bytes there


def test_all_spheres_at_one_point_all_meet() -> None:
    mid = np.ones((20, 3))
    found, expected = both(mid, mid, np.zeros(20))
    assert found == expected
    assert len(found) == 190


@pytest.mark.parametrize(("radius", "complete"), [(2.49, True), (2.51, False)])
def test_images_beyond_the_furthest_are_not_listed_and_that_is_said(radius: float, complete: bool) -> None:
    h, mid = np.eye(3), np.array([[0.1, 0.2, 0.3]])
    pairs, images, found = candidate_pairs(mid, mid, np.array([radius]), h, h, True)
    assert found == complete
    assert len(pairs) == len(images)
    if complete:
        assert as_set(pairs, images) == as_set(*all_pairs(mid, mid, np.array([radius]), h, h, True, 6))
    else:
        assert len(pairs) == 0
