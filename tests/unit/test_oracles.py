"""The judges themselves, by hand values and invariances: distances, ν, images, invariants, roots."""

from fractions import Fraction
from itertools import combinations, product
from math import sqrt
from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.exact import determinant, solve
from oracles.lattice import shifts_within
from oracles.polynomials import at, multiplied, sign_at, simplest_between, unit_roots

Points = NDArray[np.float64]

HOPF_A = [[2, 0, 0], [0, 2, 0], [-2, 0, 0], [0, -2, 0]]
HOPF_B = [[0, 0, 1], [4, 0, 1], [4, 0, -1], [0, 0, -1]]
TREFOIL = [[-4, -1, 1], [1, 0, -4], [4, 1, 0], [-3, -2, -3], [-1, 4, -2], [3, -4, -3]]

grid = st.integers(-4, 4)
real = st.floats(-4, 4, allow_subnormal=False)


def points(number: int | st.SearchStrategy[int], coordinate: st.SearchStrategy[Any] = real, dimension: int = 3) -> Any:
    point = st.lists(coordinate, min_size=dimension, max_size=dimension)
    if isinstance(number, int):
        return st.lists(point, min_size=number, max_size=number)
    return number.flatmap(lambda n: st.lists(point, min_size=n, max_size=n))


def rotation(seed: int) -> Points:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.linalg.det(q)


def curve(formula: Any, n: int) -> Points:
    return np.array([formula(2 * np.pi * k / n) for k in range(n)])


@pytest.mark.parametrize(
    ("edges", "expected"),
    [
        ([[-1, 0, 0], [1, 0, 0], [0, -1, 1], [0, 1, 1]], 1),  # inside both
        ([[0, 0, 0], [1, 0, 0], [0, 3, 4], [1, 3, 4]], 5),  # parallel
        ([[0, 0, 0], [1, 0, 0], [3, 0, 0], [9, 0, 0]], 2),  # on one line, apart
        ([[0, 0, 0], [2, 0, 0], [1, 0, 0], [9, 0, 0]], 0),  # on one line, overlapping
        ([[0, 0, 0], [4, 0, 0], [1, 3, 0], [1, 9, 0]], 3),  # end against inside
        ([[0, 0, 0], [1, 0, 0], [4, 4, 0], [9, 9, 0]], 5),  # end against end
        ([[1, 3, 0], [1, 3, 0], [0, 0, 0], [4, 0, 0]], 3),  # a point and an edge
        ([[0, 0, 0], [0, 0, 0], [3, 4, 0], [3, 4, 0]], 5),  # two points
        ([[0, 0, 0], [2, 2, 0], [0, 2, 0], [2, 0, 0]], 0),  # an X in the plane
    ],
)
def test_edge_distance_by_hand(edges: list[list[int]], expected: int) -> None:
    assert oracles.edge_distance(*edges) == pytest.approx(expected, abs=1e-15)
    assert oracles.squared_edge_distance_exact(*edges) == expected**2


@given(points(4))
def test_edge_distance_in_floats_is_the_exact_one(edges: list[list[float]]) -> None:
    exact = sqrt(oracles.squared_edge_distance_exact(*edges))
    assert oracles.edge_distance(*edges) == pytest.approx(exact, rel=1e-9, abs=1e-12)


@given(points(4, grid))
def test_edge_distance_is_that_of_the_hull_of_differences(edges: list[list[int]]) -> None:
    a, b, c, d = np.array(edges)
    corners = [a - c, a - d, b - c, b - d]
    exact = oracles.squared_edge_distance_exact(*edges)
    assert oracles.squared_hull_distance_exact(corners) == exact
    assert oracles.hull_distance(corners) == pytest.approx(sqrt(exact), abs=1e-12)


@given(points(4), st.integers(0, 99))
def test_edge_distance_does_not_depend_on_order_or_place(edges: list[list[float]], seed: int) -> None:
    a, b, c, d = np.array(edges) @ rotation(seed).T + 1.0
    expected = oracles.edge_distance(*edges)
    for order in ((a, b, c, d), (b, a, c, d), (c, d, a, b), (d, c, b, a)):
        assert oracles.edge_distance(*order) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("vectors", "expected_square"),
    [
        ([[3, 4]], 25),
        ([[1, -2], [1, 5]], 1),
        ([[1, 1], [3, 1], [1, 3]], 2),
        ([[1, 0], [-1, 1], [-1, -1]], 0),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], Fraction(1, 3)),
        ([[1, 1, 1], [-1, -1, 1], [1, -1, -1], [-1, 1, -1]], 0),  # the origin inside a tetrahedron
        ([[1, 1, 2], [-1, -1, 2], [1, -1, 2], [-1, 1, 2]], 4),  # above a square
        ([[1, 0, 1], [1, 0, 1], [1, 0, -1], [1, 0, 0]], 1),  # on one line, one of them twice
        ([[1, 0, 0], [-1, 0, 0], [0, 5, 5]], 0),  # on an edge
    ],
)
def test_hull_distance_by_hand(vectors: list[list[int]], expected_square: Fraction) -> None:
    assert oracles.squared_hull_distance_exact(vectors) == expected_square
    assert oracles.hull_distance(vectors) == pytest.approx(sqrt(expected_square), abs=1e-12)


@settings(max_examples=50)
@given(st.sampled_from([2, 3]).flatmap(lambda dimension: points(st.integers(1, 7), grid, dimension)))
def test_hull_distance_in_floats_is_the_exact_one(vectors: list[list[int]]) -> None:
    exact = oracles.squared_hull_distance_exact(vectors)
    assert oracles.hull_distance(vectors) == pytest.approx(sqrt(exact), abs=1e-9)


def test_hull_distance_stays_below_every_direction_it_could_be_refuted_by() -> None:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(20000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for place in np.linspace(0.5, 5, 10):
        vectors = rng.normal(loc=(place, 0, 0), size=(8, 3))
        distance = oracles.hull_distance(vectors)
        widest = max(0.0, (directions @ vectors.T).min(axis=1).max())  # the dual: the best separating plane
        assert widest - 1e-12 <= distance <= widest + 0.01 * np.linalg.norm(vectors, axis=1).max()


def test_terms_of_an_open_strand_by_hand() -> None:
    found = {(term.first, term.second): term.kind for term in oracles.disjoint_terms([0, 5], [False])}
    assert found == {
        ((0, 1), (2, 3)): "local",
        ((1, 2), (3, 4)): "local",
        ((0, 1), (3, 4)): "self",
        ((0, 0), (1, 1)): "local",
        ((0, 0), (1, 2)): "local",
        ((4, 4), (3, 3)): "local",
        ((4, 4), (2, 3)): "local",
    }


@pytest.mark.parametrize(
    ("offsets", "closed", "count"),
    [
        ([0, 2], [False], 1),
        ([0, 3], [False], 4),
        ([0, 3], [True], 3),
        ([0, 4], [True], 2),
        ([0, 6], [True], 9),
        ([0, 2, 4], [False, False], 3),
        ([0, 3, 6], [True, True], 15),
    ],
)
def test_number_of_terms(offsets: list[int], closed: list[bool], count: int) -> None:
    terms = oracles.disjoint_terms(offsets, closed)
    assert len(terms) == len({frozenset({term.first, term.second}) for term in terms}) == count


def test_classes_of_a_ring() -> None:
    kinds = {(term.first, term.second): term.kind for term in oracles.disjoint_terms([0, 7], [True])}
    assert kinds[(0, 1), (2, 3)] == kinds[(0, 1), (5, 6)] == kinds[(1, 2), (6, 0)] == "local"
    assert kinds[(0, 1), (3, 4)] == "self"


def simplices(offsets: list[int], closed: list[bool]) -> list[tuple[int, ...]]:
    found: list[tuple[int, ...]] = [(v,) for v in range(offsets[-1])]
    for start, stop, ring in zip(offsets[:-1], offsets[1:], closed, strict=True):
        found += [(i, i + 1) for i in range(start, stop - 1)] + ([(stop - 1, start)] if ring else [])
    return found


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.integers(2, 5), st.booleans()), min_size=1, max_size=2),
    st.data(),
)
def test_nu_is_the_least_over_all_disjoint_simplices(strands: list[tuple[int, bool]], data: st.DataObject) -> None:
    lengths = [max(length, 3) if ring else length for length, ring in strands]
    offsets, closed = np.cumsum([0, *lengths]).tolist(), [ring for _, ring in strands]
    x = np.array(data.draw(points(offsets[-1], grid)), dtype=np.float64)
    pairs = [(p, q) for p, q in combinations(simplices(offsets, closed), 2) if not set(p) & set(q)]
    least = min(oracles.edge_distance(x[p[0]], x[p[-1]], x[q[0]], x[q[-1]]) for p, q in pairs)
    assert oracles.nu(x, offsets, closed).value == pytest.approx(least, abs=1e-12)


def test_nu_names_the_pair_across_the_boundary() -> None:
    x = [[1.0, 4, 4], [1.0, 5, 4], [9.5, 4, 4.25], [9.5, 5, 4.25]]
    alone = oracles.nu(x, [0, 2, 4], [False, False])
    assert (alone.value, alone.kind) == (1.0, "local")
    found = oracles.nu(x, [0, 2, 4], [False, False], np.diag([9.0, 20, 20]))
    assert found == (sqrt(0.25**2 + 0.5**2), (0, 1), (2, 3), (-1, 0, 0), "inter")


def test_nu_sees_a_strand_and_its_own_image() -> None:
    x = [[0.0, 0, 0], [4.0, 0, 0], [8.0, 0.5, 0]]
    found = oracles.nu(x, [0, 3], [False], np.diag([9.0, 20, 20]))
    assert found == (sqrt(1 + 0.5**2), (0, 1), (1, 2), (-1, 0, 0), "self")


def test_nu_in_a_cell_is_nu_among_explicit_copies() -> None:
    rng = np.random.default_rng(5)
    cell = np.array([[3.0, 0, 0], [1.2, 2.8, 0], [-0.9, 0.7, 2.5]])
    copies = [np.array(shift) @ cell for shift in product((-2, -1, 0, 1, 2), repeat=3)]
    for _ in range(3):
        x = np.cumsum(rng.normal(size=(4, 3)), axis=0)
        edges = [(x[i], x[i + 1]) for i in range(3)]
        other = [
            oracles.edge_distance(*e, f[0] + shift, f[1] + shift)
            for e, f in product(edges, repeat=2)
            for shift in copies
            if shift.any()
        ]
        expected = min([oracles.nu(x, [0, 4], [False]).value, *other])
        assert oracles.nu(x, [0, 4], [False], cell).value == pytest.approx(expected, rel=1e-12)


def test_nearest_image_by_hand() -> None:
    cell = np.array([[10.0, 0, 0], [5, 8, 0], [0, 0, 6]])
    vector, shift = oracles.nearest_image_brute([9.0, 7.0, -5.0], cell)
    np.testing.assert_allclose(vector, [4.0, -1.0, 1.0])
    assert shift == (0, -1, 1)


def test_strands_torn_by_the_box_become_whole() -> None:
    rng = np.random.default_rng(2)
    cell = np.array([[10.0, 0, 0], [3, 9, 0], [-2, 4, 8]])
    steps = rng.normal(size=(60, 3))
    whole = np.concatenate([np.cumsum(steps[:30], axis=0), np.cumsum(steps[30:], axis=0)])
    wrapped = whole - np.floor(whole @ np.linalg.inv(cell)) @ cell
    found, shifts = oracles.make_whole_brute(wrapped, [0, 30, 60], cell)
    np.testing.assert_allclose(found, wrapped + shifts @ cell)
    for part in (slice(0, 30), slice(30, 60)):
        np.testing.assert_allclose(found[part] - found[part][0], whole[part] - whole[part][0], atol=1e-12)
    assert np.abs(np.diff(wrapped[:30], axis=0)).max() > 5  # it had been torn


def test_images_within_reach_are_all_there() -> None:
    rng = np.random.default_rng(8)
    cell0 = np.array([[4.0, 0, 0], [2, 4, 0], [1, -1, 3]])
    cell1 = cell0 * 1.1
    pair0, pair1 = rng.normal(scale=3, size=(2, 2, 2, 3))
    near = set()
    for shift in product(range(-5, 6), repeat=3):
        for t in np.linspace(0, 1, 21):
            a, b, c, d = ((1 - t) * pair0 + t * pair1).reshape(4, 3)
            image = np.array(shift) @ ((1 - t) * cell0 + t * cell1)
            if oracles.edge_distance(a, b, c + image, d + image) <= 1.5:
                near.add(shift)
    assert near
    assert near <= set(shifts_within(pair0, pair1, cell0, cell1, 1.5))


def test_linking_number_of_a_hopf_link() -> None:
    assert oracles.linking_number(HOPF_A, HOPF_B) == pytest.approx(1, abs=1e-12)
    assert oracles.linking_number_exact(HOPF_A, HOPF_B) == 1
    assert oracles.linking_number_exact(HOPF_A, HOPF_B[::-1]) == -1
    assert oracles.linking_number_exact(HOPF_A, np.add(HOPF_B, (3, 0, 0))) == 0


def test_linking_number_is_the_gauss_double_integral() -> None:
    # the midpoint rule over both curves converges fast for closed curves; it knows no solid angles
    n = 400
    x = (np.arange(n) + 0.5) * 2 * np.pi / n
    r1, d1 = np.stack([np.cos(x), np.sin(x), 0 * x], 1), np.stack([-np.sin(x), np.cos(x), 0 * x], 1)
    r2, d2 = np.stack([1 + np.cos(x), 0 * x, np.sin(x)], 1), np.stack([-np.sin(x), 0 * x, np.cos(x)], 1)
    gap = r1[:, None] - r2[None]
    kernel = np.einsum("ijk,ijk->ij", gap, np.cross(d1[:, None], d2[None])) / np.linalg.norm(gap, axis=2) ** 3
    integral = kernel.sum() * (2 * np.pi / n) ** 2 / (4 * np.pi)
    assert oracles.linking_number(r1[::10], r2[::10]) == pytest.approx(integral, abs=1e-9)
    assert oracles.linking_number_exact(r1[::10], r2[::10]) == round(integral) != 0


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_both_linking_numbers_agree(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 8, 3))
    exact = oracles.linking_number_exact(a, b)
    assert oracles.linking_number(a, b) == pytest.approx(exact, abs=1e-9)
    assert oracles.linking_number(b, a) == pytest.approx(exact, abs=1e-9)
    assert oracles.linking_number_exact(a[::-1], b) == -exact
    assert oracles.linking_number_exact(-a, -b) == -exact  # the mirror image


def test_writhe() -> None:
    pentagon = curve(lambda t: [np.cos(t), np.sin(t), 0.0], 5)
    assert oracles.writhe(pentagon) == pytest.approx(0, abs=1e-15)
    wave = curve(lambda t: [np.cos(t), np.sin(t), 0.3 * np.sin(2 * t) + 0.1 * np.cos(t)], 12)
    assert abs(oracles.writhe(TREFOIL)) > 2
    assert oracles.writhe(np.array(TREFOIL) * [1, 1, -1]) == pytest.approx(-oracles.writhe(TREFOIL))
    assert oracles.writhe(wave[::-1]) == pytest.approx(oracles.writhe(wave))
    assert oracles.writhe(wave @ rotation(1).T) == pytest.approx(oracles.writhe(wave))


@pytest.mark.parametrize(
    ("polygon", "expected"),
    [
        (curve(lambda t: [np.cos(t), np.sin(t), 0.0], 6), 1),
        (curve(lambda t: [np.cos(t) + np.cos(2 * t), np.sin(t) - np.sin(2 * t), np.sin(t)], 30), 1),
        (TREFOIL, 3),
        (
            curve(lambda t: [(2 + np.cos(2 * t)) * f(3 * t) for f in (np.cos, np.sin)] + [np.sin(4 * t)], 60),
            5,
        ),
        (
            curve(lambda t: [(2 + np.cos(5 * t)) * f(2 * t) for f in (np.cos, np.sin)] + [np.sin(5 * t)], 60),
            5,
        ),
        (
            curve(lambda t: [(2 + np.cos(7 * t)) * f(2 * t) for f in (np.cos, np.sin)] + [np.sin(7 * t)], 80),
            7,
        ),
        (
            curve(lambda t: [(2 + np.cos(4 * t)) * f(3 * t) for f in (np.cos, np.sin)] + [np.sin(4 * t)], 80),
            3,
        ),
    ],
    ids=["circle", "wave", "trefoil", "figure eight", "torus 2,5", "torus 2,7", "torus 3,4"],
)
def test_knot_determinant(polygon: Any, expected: int) -> None:
    assert oracles.knot_determinant(polygon) == expected
    assert oracles.knot_determinant(np.array(polygon)[::-1] @ rotation(4).T) == expected


def test_best_rotation_comes_back_and_never_mirrors() -> None:
    rng = np.random.default_rng(6)
    x, r = rng.normal(size=(20, 3)), rotation(7)
    found = oracles.best_rotation(x, x @ r.T + [1, 2, 3])
    np.testing.assert_allclose(found, r.T, atol=1e-12)
    mirrored = oracles.best_rotation(x, x * [1, 1, -1])
    assert np.linalg.det(mirrored) == pytest.approx(1)


def test_best_rotation_is_better_than_its_neighbours() -> None:
    rng = np.random.default_rng(9)
    x0 = rng.normal(size=(12, 3))
    for x1 in (x0 + 0.3 * rng.normal(size=(12, 3)), -x0 + 0.1 * rng.normal(size=(12, 3))):
        best = oracles.best_rotation(x0, x1)
        p, q = x0 - x0.mean(axis=0), x1 - x1.mean(axis=0)
        least = np.sum((q @ best.T - p) ** 2)
        assert all(np.sum((q @ (rotation(k) @ best).T - p) ** 2) >= least for k in range(200))
        small = [np.linalg.qr(np.eye(3) + 1e-3 * rng.normal(size=(3, 3)))[0] for _ in range(200)]
        near = [s @ np.diag(np.sign(np.diag(s))) for s in small]
        assert all(np.sum((q @ (s @ best).T - p) ** 2) >= least for s in near)


def test_linear_algebra_by_hand() -> None:
    matrix = [[Fraction(0), Fraction(2)], [Fraction(3), Fraction(4)]]
    assert solve(matrix, [Fraction(2), Fraction(10)]) == [2, 1]
    assert solve([[Fraction(1), Fraction(2)], [Fraction(2), Fraction(4)]], [Fraction(1), Fraction(1)]) is None
    assert determinant(matrix) == -6
    assert determinant([]) == 1


def polynomial(*roots: Fraction | int) -> list[Fraction]:
    product_ = [Fraction(1)]
    for root in roots:
        product_ = multiplied(product_, [-Fraction(root), Fraction(1)])
    return product_


@pytest.mark.parametrize(
    ("roots", "expected"),
    [
        ([0, 1], [0, 1]),
        ([Fraction(1, 3), Fraction(1, 3), 2], [Fraction(1, 3)]),
        (
            [Fraction(1, 2), Fraction(1, 2) + Fraction(1, 2**60)],
            [Fraction(1, 2), Fraction(1, 2) + Fraction(1, 2**60)],
        ),
        ([-Fraction(1, 10**9), 1 + Fraction(1, 10**9)], []),
        (
            [Fraction(59, 95), Fraction(2, 7), Fraction(3, 4)],
            [Fraction(2, 7), Fraction(59, 95), Fraction(3, 4)],
        ),
    ],
)
def test_roots_in_the_unit_interval(roots: list[Fraction], expected: list[Fraction]) -> None:
    found = unit_roots(polynomial(*roots))
    assert [root.low for root in found] == expected
    assert [root.high for root in found] == expected


def test_sign_at_an_irrational_root_is_exact() -> None:
    half_square = [Fraction(-1, 2), Fraction(0), Fraction(1)]
    (root,) = unit_roots(half_square)
    assert root.low**2 < Fraction(1, 2) < root.high**2
    assert sign_at(multiplied(half_square, [Fraction(7), Fraction(1)]), root) == 0
    convergent, next_one = Fraction(8119, 11482), Fraction(19601, 27720)  # of 1/sqrt(2), from both sides
    assert {sign_at([-c, Fraction(1)], root) for c in (convergent, next_one)} == {-1, 1}
    for k in range(1, 8):  # numbers so near that the enclosure holds them too
        near = root.low + k * (root.high - root.low) / 8
        assert sign_at([-near, Fraction(1)], root) == (1 if near**2 < Fraction(1, 2) else -1)
    assert sign_at([Fraction(-1, 3), Fraction(1)], at(Fraction(1, 3))) == 0


def test_simplest_fraction_between() -> None:
    assert simplest_between(Fraction(3, 10), Fraction(4, 10)) == Fraction(1, 3)
    assert simplest_between(Fraction(314, 100), Fraction(315, 100)) == Fraction(22, 7)
    assert simplest_between(Fraction(1, 3), Fraction(1, 3)) == Fraction(1, 3)
