"""Linking number, writhe and knot determinant: hand values, moves with a known jump, and slow oracles."""

from fractions import Fraction
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from mdtopo.errors import InputError, MdtopoError
from mdtopo.geometry import linking
from mdtopo.geometry.linking import boxes_apart, gauss_linking, knot_determinant, linking_number, writhe

Points = NDArray[np.float64]

SQUARE = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
THROUGH = np.array([[0.0, 0, 1], [0, 0, -1], [3, 0, -1], [3, 0, 1]])
# six sticks suffice for a trefoil: case T8
STICK_TREFOIL = np.array([[-24.0, -4, 17], [6, 2, -13], [24, 8, 11], [-18, -10, -7], [-6, 26, -1], [18, -22, -7]]) / 6


def turned(x: Points, seed: int) -> Points:
    matrix, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return x @ (matrix * np.sign(np.linalg.det(matrix)))


def turns(n: int) -> Points:
    return np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)


def torus_curve(p: int, q: int, n: int, phase: float = 0.0) -> Points:
    """Return a curve that runs p times around the axis and q times around the core of a torus."""
    t = turns(n)
    radius = 2.0 + np.cos(q * t + phase)
    return np.column_stack([radius * np.cos(p * t), radius * np.sin(p * t), -np.sin(q * t + phase)])


def figure_eight(n: int) -> Points:
    t = turns(n)
    return np.column_stack([(2 + np.cos(2 * t)) * np.cos(3 * t), (2 + np.cos(2 * t)) * np.sin(3 * t), np.sin(4 * t)])


def long_trefoil(mirrored: bool) -> Points:
    """Return an open trefoil from (-3, 0, 0) to (3, 0, 0), which can be tied in a row with others."""
    t = np.linspace(-2.2, 2.2, 40)
    x = np.column_stack([t**3 - 3 * t, t**4 - 4 * t**2, t**5 / 5 - 2 * t])
    return np.vstack([[-8.0, 20, 0], x if not mirrored else x * [1, 1, -1], [8.0, 20, 0]])


def closed_sum(*signs: bool) -> Points:
    """Return trefoils tied in a row, closed far above."""
    parts = [long_trefoil(s) + np.array([40.0 * k, 0, 0]) for k, s in enumerate(signs)]
    return np.vstack([*parts, [[40.0 * len(signs), 60, 0], [-40, 60, 0]]])


def random_ring(seed: int, n: int, spread: float = 1.0) -> Points:
    return np.random.default_rng(seed).normal(size=(n, 3)) * spread


# Oracles: projections along z in exact arithmetic, and linear algebra on fractions.

Place = tuple[int, Fraction, int, Fraction, bool, int]


def exact(x: Points) -> list[tuple[Fraction, ...]]:
    return [tuple(Fraction(float(v)) for v in row) for row in x]


def crossings_seen_along_z(p: Points, q: Points, skip: set[tuple[int, int]]) -> list[Place]:
    """Return edge and place on p, edge and place on q, whether p is above, and the sign, of all crossings seen."""
    x, y, found = exact(p), exact(q), []
    for i in range(len(x)):
        for j in range(len(y)):
            if (i, j) in skip:
                continue
            a, b, c, d = x[i], x[(i + 1) % len(x)], y[j], y[(j + 1) % len(y)]
            e, f, r = ([v - u for u, v in zip(*ends, strict=True)] for ends in ((a, b), (c, d), (a, c)))
            turn = e[0] * f[1] - e[1] * f[0]
            if turn == 0:
                continue  # parallel in projection: they pass each other by
            s, t = (r[0] * f[1] - r[1] * f[0]) / turn, (r[0] * e[1] - r[1] * e[0]) / turn
            if 0 <= s <= 1 and 0 <= t <= 1:
                assert not {s, t} & {0, 1}
                height = a[2] + s * e[2] - c[2] - t * f[2]
                assert height != 0
                found.append((i, s, j, t, height > 0, 1 if turn * height > 0 else -1))
    return found


def linking_seen(p: Points, q: Points) -> Fraction:
    return Fraction(sum(place[5] for place in crossings_seen_along_z(p, q, set())), 2)


def determinant_seen(p: Points) -> int:
    """Return the knot determinant from the unreduced diagram seen along z, by elimination of fractions."""
    n = len(p)
    skip = {(i, j) for i in range(n) for j in range(n) if j <= i + 1 or (i == 0 and j == n - 1)}
    places = crossings_seen_along_z(p, p, skip)
    passages = sorted(
        [(i, s, k, over) for k, (i, s, _, _, over, _) in enumerate(places)]
        + [(j, t, k, not over) for k, (_, _, j, t, over, _) in enumerate(places)]
    )
    m, arc = len(places), 0
    rows = [[Fraction(0)] * m for _ in range(m)]
    for _, _, k, over in passages:
        if over:
            rows[k][arc] += 2
        else:
            rows[k][arc] -= 1
            arc = (arc + 1) % m
            rows[k][arc] -= 1
    return abs(int(exact_determinant([row[:-1] for row in rows[:-1]])))


def exact_determinant(rows: list[list[Fraction]]) -> Fraction:
    value, rows = Fraction(1), [row[:] for row in rows]
    for k in range(len(rows)):
        pivot = next((i for i in range(k, len(rows)) if rows[i][k]), None)
        if pivot is None:
            return Fraction(0)
        if pivot != k:
            rows[k], rows[pivot], value = rows[pivot], rows[k], -value
        value *= rows[k][k]
        for i in range(k + 1, len(rows)):
            if rows[i][k]:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [u - factor * v for u, v in zip(rows[i], rows[k], strict=True)]
    return value


# Hand values


def test_a_hopf_link_is_one_by_orientation() -> None:
    """The square runs anticlockwise seen from above, and the other comes down through it."""
    assert gauss_linking(SQUARE, THROUGH) == pytest.approx(-1.0, abs=1e-14)
    assert linking_number(SQUARE, THROUGH) == -1
    assert linking_number(SQUARE[::-1], THROUGH) == 1
    assert linking_number(SQUARE, THROUGH[::-1]) == 1
    assert linking_number(SQUARE[::-1], THROUGH[::-1]) == -1
    assert linking_number(SQUARE * [1, 1, -1], THROUGH * [1, 1, -1]) == 1


@pytest.mark.parametrize("gap", [0.5, 1e-6, 1e-11])
def test_a_loop_that_just_reaches_through_is_linked_and_its_near_miss_is_not(gap: float) -> None:
    through = np.array([[1 - gap, 0, 1], [1 - gap, 0, -1], [3, 0, -1], [3, 0, 1]])
    beside = np.array([[1 + gap, 0, 1], [1 + gap, 0, -1], [3, 0, -1], [3, 0, 1]])
    assert linking_number(SQUARE, through) == -1
    assert linking_number(SQUARE, beside) == 0


def test_unlinked_polygons_have_zero() -> None:
    assert linking_number(SQUARE, SQUARE + np.array([0.5, 0.5, 1])) == 0
    assert linking_number(SQUARE, 0.5 * SQUARE) == 0  # one in the other, in one plane
    assert linking_number(SQUARE, SQUARE + np.array([0, 0, 1e9])) == 0
    assert gauss_linking(SQUARE, SQUARE + np.array([5.0, 3, 1])) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("n_turns", [1, 2, 3, 5])
def test_torus_links(n_turns: int) -> None:
    p, q = torus_curve(1, n_turns, 120), torus_curve(1, n_turns, 120, phase=np.pi)
    value = linking_number(p, q)
    assert abs(value) == n_turns
    assert linking_number(p, q[::-1]) == -value
    assert value == linking_seen(turned(p[::3], 1), turned(q[::3], 1))


def test_a_whitehead_link_is_not_seen() -> None:
    t = turns(90)
    clasp = np.column_stack([2 * np.cos(t), np.sin(2 * t), 0.6 * np.sin(3 * t)])
    ring = np.column_stack([0.5 * np.cos(t), 1.2 * np.sin(t), 0 * t])
    assert not boxes_apart(clasp, ring)
    assert linking_number(ring, clasp) == linking_seen(turned(ring, 3), turned(clasp, 3)) == 0


def test_boxes_apart() -> None:
    assert boxes_apart(SQUARE, SQUARE + np.array([0, 0, 1e-300]))
    assert not boxes_apart(SQUARE, SQUARE + np.array([2.0, 0, 0]))
    assert boxes_apart(SQUARE, SQUARE + np.array([np.nextafter(2.0, 3.0), 0, 0]))
    assert boxes_apart(SQUARE + np.array([0, 5, 0]), SQUARE)


@pytest.mark.parametrize("height", [0.25, 1.0, 4.0])
def test_writhe_of_two_edges_at_right_angles(height: float) -> None:
    """Three edges along x, z, y; only the first and last count: 4π·Wr/2 is the solid angle of a square seen."""
    x = np.array([[1.0, 0, 0], [-1, 0, 0], [0, -1, height], [0, 1, height]])
    square = 4.0 * np.arcsin(1.0 / (1.0 + height * height))  # the differences fill a square with half diagonal √2·1
    determinant = float(np.linalg.det([x[0] - x[2], x[1] - x[0], x[3] - x[2]]))
    seen = abs(writhe(x, closed=False)) * 2.0 * pi
    assert seen == pytest.approx(square, rel=1e-13)
    assert writhe(x, closed=False) * determinant > 0.0


def test_writhe_of_planar_polygons_is_zero() -> None:
    x = np.column_stack([np.cos(turns(30)), np.sin(turns(30)), np.zeros(30)])
    assert writhe(x) == 0.0
    assert writhe(turned(x, 1)) == pytest.approx(0.0, abs=1e-12)
    assert writhe(SQUARE) == writhe(SQUARE[:3]) == writhe(SQUARE[:2], closed=False) == 0.0


def test_writhe_is_the_mean_of_the_signed_crossings_seen() -> None:
    """Fuller's theorem, on a sphere of directions: an independent estimate of 1/√400."""
    x = STICK_TREFOIL
    skip = {(i, j) for i in range(6) for j in range(6) if j <= i + 1 or (i == 0 and j == 5)}
    seen = [sum(place[5] for place in crossings_seen_along_z(turned(x, k), turned(x, k), skip)) for k in range(120)]
    assert writhe(x) == pytest.approx(np.mean(seen), abs=4.0 * float(np.std(seen)) / np.sqrt(len(seen)))
    assert abs(writhe(x)) > 2.0


def test_open_and_closed_writhe_differ_by_the_closing_edge() -> None:
    x = random_ring(5, 12)
    straight = np.vstack([x, x[:1]])
    assert writhe(straight, closed=False) == pytest.approx(writhe(x), abs=1e-13)
    assert abs(writhe(x, closed=False) - writhe(x)) > 1e-3


# The sign convention, by motion


@pytest.mark.parametrize("epsilon", [1e-2, 1e-6, 1e-9])
def test_linking_jumps_by_the_sign_of_a_passage(epsilon: float) -> None:
    """The edge (a, b) of p falls through the edge (c, d) of q, from above to below and back."""
    q = np.array([[0.0, -1, 0], [0, 1, 0], [0, 1, -9], [0, -1, -9]])
    for flip_p in (False, True):
        for flip_q in (False, True):
            before = np.array([[-1.0, 0, epsilon], [1, 0, epsilon], [1, 5, 9], [-1, 5, 9]])
            after = before.copy()
            after[:2, 2] = -epsilon
            second = q[::-1] if flip_q else q
            c, d = (second[2], second[3]) if flip_q else (second[0], second[1])
            dets = []
            values = []
            for x in (before, after):
                p = x[::-1] if flip_p else x
                a, b = (p[2], p[3]) if flip_p else (p[0], p[1])
                dets.append(float(np.linalg.det([a - c, b - a, d - c])))
                values.append(linking_number(p, second))
            assert dets[0] * dets[1] < 0.0
            assert values[1] - values[0] == np.sign(dets[1])


@pytest.mark.parametrize("epsilon", [1e-4, 1e-8])
def test_writhe_jumps_by_twice_the_sign_of_a_passage(epsilon: float) -> None:
    def polygon(z: float) -> Points:
        return np.array([[-1.0, 0, z], [1, 0, z], [3, 3, 2], [0, 2, 0], [0, -2, 0], [-3, -3, -3]])

    for mirror in (1.0, -1.0):
        below, above = polygon(-epsilon) * [1, mirror, 1], polygon(epsilon) * [1, mirror, 1]
        a, b, c, d = above[0], above[1], above[3], above[4]
        sign = np.sign(np.linalg.det([a - c, b - a, d - c]))
        jump = writhe(above) - writhe(below)
        assert jump == pytest.approx(2.0 * sign, abs=20 * epsilon)
        assert writhe(polygon(0.0) * [1, mirror, 1]) == pytest.approx((writhe(above) + writhe(below)) / 2, abs=1e-6)


def test_a_passage_makes_a_trefoil_of_an_unknot() -> None:
    """Turn one crossing of a trefoil: the determinant falls from 3 to 1, the writhe jumps by 2."""
    x = torus_curve(2, 3, 60)
    before, after = x.copy(), x.copy()
    skip = {(i, j) for i in range(60) for j in range(60) if j <= i + 1 or (i == 0 and j == 59)}
    i, s, j, t, _, sign = crossings_seen_along_z(x + 0.0, x, skip)[0]
    top = x[i] + float(s) * (x[(i + 1) % 60] - x[i])
    other = x[j] + float(t) * (x[(j + 1) % 60] - x[j])
    gap = top[2] - other[2]
    bump = np.exp(-(((np.arange(60) - i + 30) % 60 - 30) ** 2) / 8.0)
    after[:, 2] -= 2.5 * gap * bump
    assert knot_determinant(before) == 3
    assert knot_determinant(after) == 1
    assert abs(sign) == 1


# Knots


@pytest.mark.parametrize(
    ("name", "polygon", "expected"),
    [
        ("triangle", SQUARE[:3], 1),
        ("square", SQUARE, 1),
        ("ring", torus_curve(1, 0, 50), 1),
        ("coil", torus_curve(1, 7, 200), 1),
        ("coil around the core", torus_curve(7, 1, 200), 1),
        ("3_1", torus_curve(2, 3, 60), 3),
        ("3_1 of six sticks", STICK_TREFOIL, 3),
        ("3_1 as T(3,2)", torus_curve(3, 2, 60), 3),
        ("4_1", figure_eight(80), 5),
        ("5_1", torus_curve(2, 5, 100), 5),
        ("7_1", torus_curve(2, 7, 100), 7),
        ("9_1", torus_curve(2, 9, 150), 9),
        ("8_19", torus_curve(3, 4, 100), 3),
        ("10_124", torus_curve(3, 5, 120), 1),
        ("granny", closed_sum(False, False), 9),
        ("square knot", closed_sum(False, True), 9),
        ("five trefoils", closed_sum(False, True, True, False, True), 243),
        ("T(2,51)", torus_curve(2, 51, 1020), 51),
    ],
)
def test_known_knots(name: str, polygon: Points, expected: int) -> None:
    assert knot_determinant(polygon) == expected, name
    assert knot_determinant(polygon * [1, 1, -1]) == expected
    assert knot_determinant(polygon[::-1]) == expected


def test_twenty_trefoils_need_more_than_one_prime() -> None:
    assert knot_determinant(closed_sum(*[False] * 25)) == 3**25


@pytest.mark.parametrize("seed", range(25))
def test_the_determinant_agrees_with_the_unreduced_diagram(seed: int) -> None:
    """Random polygons of few vertices are unknots mostly, those of 20 in a ball mostly not."""
    x = random_ring(seed, 8 + seed // 2)
    assert knot_determinant(x) == determinant_seen(x)


def test_random_polygons_are_knotted_often_enough_to_test_with() -> None:
    values = [knot_determinant(random_ring(seed, 8 + seed // 2)) for seed in range(25)]
    assert set(values) >= {1, 3, 5, 7}
    assert 1 in values
    assert all(value % 2 == 1 for value in values)


def test_a_knot_on_a_lattice_and_edges_on_one_line() -> None:
    """Axis-parallel edges, many of them straight on or in line with others."""
    corners = [[0, 0, 0], [3, 0, 0], [3, 0, 1], [3, 2, 1], [1, 2, 1], [1, -1, 1], [1, -1, -1], [2, -1, -1], [2, 1, -1]]
    corners += [[2, 1, 2], [2, 3, 2], [0, 3, 2], [0, 3, 0]]
    x = np.array(corners, float)
    fine = np.vstack(
        [a + np.linspace(0, 1, 4, endpoint=False)[:, None] * (b - a) for a, b in zip(x, np.roll(x, -1, 0), strict=True)]
    )
    expected = determinant_seen(turned(x, 8))
    assert knot_determinant(x) == knot_determinant(fine) == knot_determinant(np.repeat(fine, 2, axis=0)) == expected


@pytest.mark.parametrize("size", [1, 2, 5, 12])
def test_the_exact_determinant_agrees_with_fractions(size: int) -> None:
    rng = np.random.default_rng(size)
    for _ in range(20):
        matrix = rng.integers(-9, 10, size=(size, size)) * rng.integers(0, 2, size=(size, size))
        expected = exact_determinant([[Fraction(int(v)) for v in row] for row in matrix])
        assert linking._exact_determinant(matrix.astype(np.int64)) == expected


def test_primes_are_prime() -> None:
    assert linking._prime_below(2**31 + 1) == 2**31 - 1
    assert linking._prime_below(2**31 - 1) == 2147483629
    assert linking._prime_below(101) == 97


# Invariance


@pytest.mark.parametrize("seed", range(5))
def test_invariance_of_place_turn_size_and_start(seed: int) -> None:
    p, q = random_ring(seed, 14), random_ring(seed + 100, 17)
    linked, own, knot = linking_number(p, q), writhe(p), knot_determinant(p)
    for change in (
        lambda x: turned(x, seed),
        lambda x: x + np.array([10.0, -200, 3000]),
        lambda x: x * 1e-30,
        lambda x: x * 1e30,
        lambda x: np.roll(x, 5, axis=0),
        lambda x: x.astype(np.float32).astype(np.float64),
        lambda x: np.insert(x, 3, 0.5 * (x[2] + x[3]), axis=0),
    ):
        assert linking_number(change(p), change(q)) == linked
        assert writhe(change(p)) == pytest.approx(own, abs=1e-5)
        assert knot_determinant(change(p)) == knot
    assert writhe(p * [-1, 1, 1]) == pytest.approx(-own, abs=1e-12)
    assert writhe(p[::-1]) == pytest.approx(own, abs=1e-12)
    assert linking_number(p[::-1], q) == linking_number(p, q * [1, 1, -1] * [1, 1, -1]) - 2 * linked


def polygons(n_most: int, first_seed: int = 0) -> st.SearchStrategy[Points]:
    """Polygons of a seed rather than of free floats: those touch themselves nearly always."""
    return st.builds(random_ring, st.integers(first_seed, first_seed + 2**32 - 1), st.integers(3, n_most))


@given(p=polygons(12), q=polygons(12, 2**32))
@settings(max_examples=150, deadline=None)
def test_linking_is_half_the_signed_crossings_seen(p: Points, q: Points) -> None:
    assert linking_number(p, q) == linking_seen(p, q)


@given(p=polygons(25), q=polygons(25, 2**32), seed=st.integers(0, 1000), shift=st.integers(0, 24))
@settings(max_examples=150, deadline=None)
def test_linking_is_symmetric_and_invariant(p: Points, q: Points, seed: int, shift: int) -> None:
    value = linking_number(p, q)
    assert linking_number(q, p) == value
    assert linking_number(turned(p, seed), turned(q, seed)) == value
    assert linking_number(np.roll(p, shift, axis=0), q[::-1]) == -value


@given(p=polygons(25), seed=st.integers(0, 1000), shift=st.integers(0, 24))
@settings(max_examples=150, deadline=None)
def test_writhe_and_determinant_are_invariant(p: Points, seed: int, shift: int) -> None:
    changed = np.roll(turned(p, seed), shift, axis=0)
    assert writhe(changed) == pytest.approx(writhe(p), abs=1e-9)
    assert writhe(-changed) == pytest.approx(-writhe(p), abs=1e-9)
    assert knot_determinant(changed) == knot_determinant(-p) == knot_determinant(p)


integer_rings = st.lists(st.tuples(*[st.integers(-2, 2)] * 3), min_size=3, max_size=7, unique=True)


@given(p=integer_rings, q=integer_rings)
@settings(max_examples=300, deadline=None)
def test_on_a_grid_linking_is_exact_or_the_polygons_touch(p: list[tuple[int, ...]], q: list[tuple[int, ...]]) -> None:
    """Coplanar pairs, contacts at ends and overlaps are common here; touching is decided in fractions."""
    first, second = np.array(p, float), np.array(q, float)
    touching = any(
        edges_touch(first[i - 1], first[i], second[j - 1], second[j]) for i in range(len(p)) for j in range(len(q))
    )
    if touching:
        with pytest.raises(InputError, match="touch"):
            linking_number(first, second) if not boxes_apart(first, second) else pytest.fail("the boxes touch")
    else:
        assert linking_number(first, second) == linking_seen(turned(first, 11), turned(second, 11))


def edges_touch(a: Points, b: Points, c: Points, d: Points) -> bool:
    """Return whether two edges with integer ends meet, exactly (products of small integers in float64 are exact)."""
    e, f, r = b - a, d - c, c - a
    normal = np.cross(e, f)
    if normal @ r != 0.0:
        return False
    size = normal @ normal
    if size > 0.0:
        s, t = np.cross(r, f) @ normal, np.cross(r, e) @ normal
        return bool(0.0 <= s <= size and 0.0 <= t <= size)
    if np.any(np.cross(e, r)):
        return False
    low, high = sorted([float(r @ e), float((d - a) @ e)])
    return low <= float(e @ e) and high >= 0.0


# What cannot be used


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (SQUARE[:, :2], r"has shape \(4, 2\).*\(n, 3\)"),
        (SQUARE[0], r"has shape \(3,\)"),
        (SQUARE[:2], r"n ≥ 3"),
        (np.empty((0, 3)), r"has shape \(0, 3\)"),
        (np.where(SQUARE == -1, np.nan, SQUARE), r"not finite at vertex 1"),
        (np.where(SQUARE == -1, np.inf, SQUARE), r"not finite at vertex 1"),
        ("a string", "not an array of numbers"),
        ([[0, 0, 0], [1, 2]], "not an array of numbers"),
    ],
)
def test_bad_arrays_are_named(bad: ArrayLike, message: str) -> None:
    for call in (
        lambda: linking_number(bad, SQUARE),  # type: ignore[arg-type]
        lambda: gauss_linking(bad, SQUARE),  # type: ignore[arg-type]
        lambda: writhe(bad),  # type: ignore[arg-type]
        lambda: knot_determinant(bad),  # type: ignore[arg-type]
    ):
        with pytest.raises(
            InputError, match=f"^p (is|has) .*{message[4:] if message.startswith('has ') else ''}"
        ) as caught:
            call()
        assert caught.match(message)
        assert isinstance(caught.value, ValueError)
        assert isinstance(caught.value, MdtopoError)
    with pytest.raises(InputError, match=r"^q "):
        linking_number(SQUARE, bad)  # type: ignore[arg-type]


def test_an_open_strand_needs_two_vertices() -> None:
    assert writhe(SQUARE[:2], closed=False) == 0.0
    with pytest.raises(InputError, match="n ≥ 2"):
        writhe(SQUARE[:1], closed=False)


@pytest.mark.parametrize(
    "shift",
    [
        [1.0, 0, 0],  # the edge of q meets the edge of p inside
        [1.0, 1, 0],  # and at a vertex
        [1.0, 1, 1],  # vertex on vertex
    ],
)
def test_polygons_that_touch_have_no_linking_number(shift: list[float]) -> None:
    with pytest.raises(
        InputError, match=r"edge \d+ of p and edge \d+ of q touch|Edge \d+ of p and edge \d+ of q touch"
    ):
        linking_number(SQUARE, THROUGH + shift)


def test_edges_that_meet_inside_count_one_half() -> None:
    assert gauss_linking(SQUARE, THROUGH + np.array([1.0, 0, 0])) == pytest.approx(-0.5, abs=1e-12)


def test_a_polygon_that_touches_itself_has_no_knot_type() -> None:
    bow = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]])
    near = bow + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1e-9], [0, 0, 1e-9]])
    assert knot_determinant(near) == 1
    for bad in (bow, np.vstack([SQUARE, SQUARE]), np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0]])):
        with pytest.raises(InputError, match="touches itself"):
            knot_determinant(bad)
    with pytest.raises(InputError, match="fewer than 3 distinct"):
        knot_determinant(np.zeros((5, 3)))


def test_a_diagram_of_hundreds_of_crossings_has_a_determinant_beyond_machine_integers() -> None:
    """A random polygon of 120 vertices in a ball keeps hundreds of crossings after the moves that remove one or two."""
    x = random_ring(3, 120)
    value = knot_determinant(x)
    assert value > 2**64
    assert knot_determinant(turned(x, 1)) == value


def test_a_diagram_may_be_refused_for_its_size() -> None:
    assert knot_determinant(torus_curve(2, 3, 60), most_crossings=10) == 3
    with pytest.raises(InputError, match="more than most_crossings = 2"):
        knot_determinant(torus_curve(2, 3, 60), most_crossings=2)
