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


def test_a_coarse_polyline_is_not_known() -> None:
    found = mdtopo.same_type(trefoil(7), Strands.from_lengths([7], closed=True))
    assert found.isotopy is Isotopy.NOT_KNOWN
    assert str(found).startswith(
        "It is not known whether the drawn curve has the strands' own type: the edges are only"
    )


def test_the_hexagons_of_figure_1_as_periodic_splines_claim_nothing_false() -> None:
    case = cases.polyline_cases()["T1"]
    for x in case.floats:
        strands = Strands.from_lengths([len(x)], closed=True)
        found = mdtopo.same_type(x, strands)
        if found.isotopy is Isotopy.TUBE:
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
    if found.isotopy is Isotopy.TUBE:
        assert mdtopo.knot_determinant(fine) == mdtopo.knot_determinant(x) == 3


def test_some_of_these_types_are_claimed() -> None:
    rng = np.random.default_rng(0)
    x = trefoil(30) + rng.normal(scale=0.02, size=(30, 3))
    assert mdtopo.same_type(x, Strands.from_lengths([30], closed=True)).isotopy is Isotopy.TUBE


def test_a_curve_beside_its_vertices_is_not_known() -> None:
    found = mdtopo.same_type(trefoil(36), Strands.from_lengths([36], closed=True), "bspline")
    assert found.isotopy is Isotopy.NOT_KNOWN
    assert "does not pass through the vertices" in found.reason


def test_two_strands_that_are_nearer_than_their_edges_are_not_known() -> None:
    ring = trefoil(36)
    strands = Strands.from_lengths([36, 36], closed=True)
    apart, near = (np.concatenate([ring, ring + np.array([0, 0, z])]) for z in (20.0, 1e-3))
    assert mdtopo.same_type(apart, strands).isotopy is Isotopy.TUBE
    assert mdtopo.same_type(near, strands).isotopy is Isotopy.NOT_KNOWN


def test_coincident_vertices_are_refused() -> None:
    x = trefoil(12)
    x[4] = x[3]
    with pytest.raises(InputError, match="coincide"):
        mdtopo.same_type(x, Strands.from_lengths([12], closed=True))
