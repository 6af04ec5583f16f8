"""Cells against brute force: reduced bases, nearest images, whole strands and windings."""

from itertools import product

import numpy as np
import oracles
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.lattice import (
    Basis,
    basis_of,
    combine,
    inverse_heights,
    inverse_of,
    nearest_image,
    reduced_basis,
    store_basis,
    volume,
    whole_counts,
)

Points = NDArray[np.float64]
Generator = np.random.Generator


def array_of(basis: Basis) -> Points:
    cell = np.empty((3, 3))
    store_basis(basis, cell)
    return cell


def cube(rng: Generator) -> Points:
    return rng.uniform(3.0, 9.0) * np.eye(3)


def truncated_octahedron(rng: Generator) -> Points:
    third = 2 * np.sqrt(2) / 3
    return rng.uniform(3.0, 9.0) * np.array([[1, 0, 0], [1 / 3, third, 0], [-1 / 3, third / 2, np.sqrt(6) / 3]])


def general(rng: Generator) -> Points:
    return rng.uniform(3.0, 9.0) * (np.eye(3) + rng.uniform(-0.45, 0.45, (3, 3)))


def flat(rng: Generator) -> Points:
    return general(rng) * np.array([1.0, 1.0, 0.2])[:, np.newaxis]


def left_handed(rng: Generator) -> Points:
    return general(rng)[[1, 0, 2]]


def skewed(rng: Generator) -> Points:
    cell = general(rng)
    cell[1] += rng.integers(-4, 5) * cell[0]
    cell[2] += rng.integers(-4, 5) * cell[0] + rng.integers(-4, 5) * cell[1]
    return cell


CELLS = {f.__name__: f for f in (cube, truncated_octahedron, general, flat, left_handed, skewed)}


@pytest.mark.parametrize("cell", CELLS)
def test_a_reduced_basis_is_a_basis_of_the_same_lattice(cell: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        given = CELLS[cell](rng)
        change = array_of(reduced_basis(basis_of(given))) @ np.linalg.inv(given)
        np.testing.assert_allclose(change, np.rint(change), atol=1e-9)
        assert abs(np.linalg.det(np.rint(change))) == pytest.approx(1.0)


@pytest.mark.parametrize("cell", CELLS)
def test_a_reduced_basis_has_the_three_shortest_vectors_of_its_lattice(cell: str) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        basis = array_of(reduced_basis(basis_of(CELLS[cell](rng))))
        counts = np.array(list(product(range(-3, 4), repeat=3)))
        lengths = np.linalg.norm(counts @ basis, axis=1)
        chosen: list[int] = []
        for k in np.argsort(lengths, kind="stable"):
            if np.linalg.matrix_rank(counts[[*chosen, k]]) == len(chosen) + 1:
                chosen.append(k)
        np.testing.assert_allclose(np.linalg.norm(basis, axis=1), lengths[chosen[:3]], rtol=1e-9)


@pytest.mark.parametrize("cell", CELLS)
def test_the_nearest_image_is_that_of_brute_force(cell: str) -> None:
    rng, moved = np.random.default_rng(3), 0
    for _ in range(60):
        basis = reduced_basis(basis_of(CELLS[cell](rng)))
        h = array_of(basis)
        # brute force looks two cells far, from a start within one cell
        v = rng.uniform(-1.0, 1.0, 3) @ h
        counts = nearest_image(tuple(v.tolist()), basis, inverse_of(basis))
        nearest, _ = oracles.nearest_image_brute(v, h)
        assert np.linalg.norm(v + np.array(counts) @ h) == pytest.approx(np.linalg.norm(nearest), rel=1e-12)
        moved += any(counts)
        shift = rng.integers(-50, 51, 3)
        far = nearest_image(tuple((v + shift @ h).tolist()), basis, inverse_of(basis))
        assert np.linalg.norm(v + (shift + np.array(far)) @ h) == pytest.approx(np.linalg.norm(nearest), rel=1e-9)
    assert 10 < moved < 60


@pytest.mark.parametrize("cell", CELLS)
def test_inverse_heights_and_volume(cell: str) -> None:
    h = CELLS[cell](np.random.default_rng(4))
    basis = basis_of(h)
    np.testing.assert_allclose(array_of(inverse_of(basis)) @ h, np.eye(3), atol=1e-12)
    assert volume(basis) == pytest.approx(np.linalg.det(h), rel=1e-12)
    np.testing.assert_allclose(combine((1.0, -2.0, 3.0), basis), np.array([1.0, -2.0, 3.0]) @ h)
    faces = [np.linalg.norm(np.cross(h[(k + 1) % 3], h[(k + 2) % 3])) for k in range(3)]
    np.testing.assert_allclose(inverse_heights(inverse_of(basis)), faces / abs(np.linalg.det(h)), rtol=1e-12)


def chain(rng: Generator, n: int, bond: float) -> Points:
    step = rng.normal(size=(n, 3))
    return np.cumsum(bond * step / np.linalg.norm(step, axis=1, keepdims=True), axis=0)


@pytest.mark.parametrize("cell", CELLS)
def test_strands_are_made_whole_as_by_brute_force(cell: str) -> None:
    rng, offsets = np.random.default_rng(5), np.array([0, 12, 20])
    for _ in range(10):
        basis = reduced_basis(basis_of(CELLS[cell](rng)))
        h = array_of(basis)
        whole = np.concatenate([chain(rng, 12, 0.3 * np.linalg.norm(h[0])), chain(rng, 8, 0.3 * np.linalg.norm(h[0]))])
        x = whole + rng.integers(-1, 2, (20, 3)).astype(float) @ h
        counts, winding = whole_counts(x, basis, np.arange(20), offsets, np.zeros(2, dtype=np.bool_))
        _, expected = oracles.make_whole_brute(x, offsets, h, reach=3)
        np.testing.assert_array_equal(counts, expected)
        assert not winding.any()
        for start, stop in ((0, 12), (12, 20)):
            kept = x[start:stop] + counts[start:stop] @ h - whole[start:stop]
            np.testing.assert_allclose(kept, np.tile(kept[0], (stop - start, 1)), atol=1e-9)


@pytest.mark.parametrize(("a", "b", "c"), [(1, 0, 0), (0, -1, 0), (0, 0, 2), (0, 0, 0)])
def test_a_ring_that_closes_through_the_boundary_has_its_winding(a: int, b: int, c: int) -> None:
    h = np.array([[6.0, 0, 0], [1.0, 7.0, 0], [-1.0, 0.5, 8.0]])
    n, way = 12, np.array([a, b, c]) @ h
    angle = 2 * np.pi * np.arange(n)[:, np.newaxis] / n
    ring = np.arange(n)[:, np.newaxis] / n * way + np.cos(angle) * [0, 0.5, 0.5] + np.sin(angle) * [0.5, 0.5, 0]
    basis = reduced_basis(basis_of(h))
    wrapped = ring - np.floor(ring @ np.linalg.inv(h)) @ h
    closed = np.ones(1, dtype=np.bool_)
    for x in (ring, wrapped):
        _, winding = whole_counts(x, basis, np.arange(n), np.array([0, n]), closed)
        np.testing.assert_allclose(winding[0] @ array_of(basis), way, atol=1e-9)


def test_a_trace_may_visit_vertices_in_any_order() -> None:
    x = np.array([[9.5, 0, 0], [0.5, 0, 0], [8.5, 0, 0]])
    basis = basis_of(10.0 * np.eye(3))
    counts, _ = whole_counts(x, basis, np.array([2, 0, 1]), np.array([0, 3]), np.zeros(1, dtype=np.bool_))
    assert counts.tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 0]]
