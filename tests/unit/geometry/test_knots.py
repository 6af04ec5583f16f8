"""The knot determinant: known knots, a passage that unties one, and a slow oracle from the whole diagram."""

from fractions import Fraction

import numpy as np
import pytest
from polygons import (
    SQUARE,
    STICK_TREFOIL,
    Points,
    closed_sum,
    crossings_seen_along_z,
    determinant_of_fractions,
    figure_eight,
    random_ring,
    torus_curve,
    turned,
)

from mdtopo.errors import InputError
from mdtopo.geometry.knots import knot_determinant


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
    return abs(int(determinant_of_fractions([row[:-1] for row in rows[:-1]])))


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


def test_a_diagram_of_hundreds_of_crossings_has_a_determinant_beyond_machine_integers() -> None:
    """A random polygon of 120 vertices in a ball keeps hundreds of crossings after the moves that remove one or two."""
    x = random_ring(3, 120)
    value = knot_determinant(x)
    assert value > 2**64
    assert knot_determinant(turned(x, 1)) == value


def test_a_polygon_that_touches_itself_has_no_knot_type() -> None:
    bow = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]])
    near = bow + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1e-9], [0, 0, 1e-9]])
    assert knot_determinant(near) == 1
    for bad in (bow, np.vstack([SQUARE, SQUARE]), np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0]])):
        with pytest.raises(InputError, match="touches itself"):
            knot_determinant(bad)
    with pytest.raises(InputError, match="fewer than 3 distinct"):
        knot_determinant(np.zeros((5, 3)))


def test_a_diagram_may_be_refused_for_its_size() -> None:
    assert knot_determinant(torus_curve(2, 3, 60), most_crossings=10) == 3
    with pytest.raises(InputError, match="more than most_crossings = 2"):
        knot_determinant(torus_curve(2, 3, 60), most_crossings=2)
