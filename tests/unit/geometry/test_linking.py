"""Linking number and writhe: hand values, moves with a known jump, and slow oracles."""

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polygons import (
    SQUARE,
    STICK_TREFOIL,
    THROUGH,
    Points,
    crossings_seen_along_z,
    linking_seen,
    polygons,
    random_ring,
    torus_curve,
    turned,
    turns,
)

from mdtopo.errors import InputError
from mdtopo.geometry.linking import boxes_apart, gauss_linking, linking_number, writhe

integer_rings = st.lists(st.tuples(*[st.integers(-2, 2)] * 3), min_size=3, max_size=7, unique=True)


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
