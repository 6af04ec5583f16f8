import cases
import numpy as np
import pytest

import mdtopo
from mdtopo import Isotopy, Strands
from mdtopo.errors import InputError


def trefoil(n: int) -> np.ndarray:
    x = 2 * np.pi * np.arange(n) / n
    return np.stack([np.sin(x) + 2 * np.sin(2 * x), np.cos(x) - 2 * np.cos(2 * x), -np.sin(3 * x)], axis=1)


def test_a_curve_near_its_polyline_has_its_type() -> None:
    found = mdtopo.same_type(trefoil(36), Strands.from_lengths([36], closed=True))
    assert found.isotopy is Isotopy.TUBE
    assert found.distance < 0.2
    assert str(found).startswith("The drawn curve has the strands' own type: all edges run along it, within 0.")


def test_a_coarse_polyline_is_reached_by_a_motion() -> None:
    found = mdtopo.same_type(trefoil(8), Strands.from_lengths([8], closed=True))
    assert found.isotopy is Isotopy.HOMOTOPY
    assert "moves to the edges with 0." in str(found)


def test_a_curve_of_another_type_is_never_said_to_have_the_same() -> None:
    # five points make no knot, whatever the spline does between them
    known = 0
    for seed in range(40):
        x = np.random.default_rng(seed).normal(size=(6, 3))
        found = mdtopo.same_type(x, Strands.from_lengths([6], closed=True))
        fine = mdtopo.spline_curve(x, Strands.from_lengths([6], closed=True))
        samples = fine.points(np.linspace(0, 1, 40, endpoint=False)).reshape(-1, 3)
        if found.isotopy is not Isotopy.NOT_KNOWN:
            known += 1
            assert mdtopo.knot_determinant(samples) == mdtopo.knot_determinant(x)
    assert known > 10


def test_the_hexagons_of_figure_1_as_periodic_splines_claim_nothing_false() -> None:
    case = cases.polyline_cases()["T1"]
    for x in case.floats:
        strands = Strands.from_lengths([len(x)], closed=True)
        found = mdtopo.same_type(x, strands)
        if found.isotopy is not Isotopy.NOT_KNOWN:
            fine = mdtopo.spline_curve(x, strands).points(np.linspace(0, 1, 20, endpoint=False)).reshape(-1, 3)
            assert mdtopo.knot_determinant(fine) == mdtopo.knot_determinant(x)


@pytest.mark.parametrize("seed", range(12))
def test_a_type_that_is_claimed_is_the_type(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 30
    x = trefoil(n) + rng.normal(scale=0.05, size=(n, 3))
    strands = Strands.from_lengths([n], closed=True)
    found = mdtopo.same_type(x, strands)
    fine = mdtopo.spline_curve(x, strands).points(np.linspace(0, 1, 12, endpoint=False)).reshape(-1, 3)
    if found.isotopy is not Isotopy.NOT_KNOWN:
        assert mdtopo.knot_determinant(fine) == mdtopo.knot_determinant(x) == 3


def test_some_of_these_types_are_claimed() -> None:
    rng = np.random.default_rng(0)
    x = trefoil(30) + rng.normal(scale=0.02, size=(30, 3))
    assert mdtopo.same_type(x, Strands.from_lengths([30], closed=True)).isotopy is Isotopy.TUBE


def test_a_curve_beside_its_vertices_is_reached_by_a_motion() -> None:
    found = mdtopo.same_type(trefoil(36), Strands.from_lengths([36], closed=True), "bspline")
    assert found.isotopy is Isotopy.HOMOTOPY


def test_a_single_bezier_curve_has_no_edges_to_compare() -> None:
    found = mdtopo.same_type(trefoil(12)[:8], Strands.from_lengths([8]), "bezier")
    assert found.isotopy is Isotopy.NOT_KNOWN
    assert "one segment for each edge" in str(found)


def test_two_strands_that_are_nearer_than_their_edges_are_not_known() -> None:
    ring = trefoil(36)
    strands = Strands.from_lengths([36, 36], closed=True)
    apart, near = (np.concatenate([ring, ring + np.array([0, 0, z])]) for z in (20.0, 1e-3))
    assert mdtopo.same_type(apart, strands).isotopy is Isotopy.TUBE
    assert mdtopo.same_type(near, strands).isotopy is not Isotopy.TUBE


def test_coincident_vertices_are_refused() -> None:
    x = trefoil(12)
    x[4] = x[3]
    with pytest.raises(InputError, match="coincide"):
        mdtopo.same_type(x, Strands.from_lengths([12], closed=True))
