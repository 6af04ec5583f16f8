"""The smooth curve of strands, and what is refused."""

import numpy as np
import pytest

from mdtopo import CompositeBezier, InputError, Strands, d_star, spline_curve
from mdtopo.errors import OptionError, StrandError

X = np.random.default_rng(0).normal(size=(9, 3))
STRANDS = Strands.from_lengths([4, 5], closed=[False, True])


@pytest.mark.parametrize("kind", ["interpolating", "bspline", "catmull-rom"])
def test_there_is_one_segment_for_each_edge(kind: str) -> None:
    curve = spline_curve(X, STRANDS, kind)
    assert curve.control_points.shape == (8, 4, 3)
    assert curve.offsets.tolist() == [0, 3, 8]
    assert curve.following.tolist() == [1, 2, -1, 4, 5, 6, 7, 3]
    assert curve.strand_of_segment.tolist() == [0, 0, 0, 1, 1, 1, 1, 1]
    assert 0.0 < curve.error < 1e-12
    if kind != "bspline":
        np.testing.assert_array_equal(curve.control_points[:, 0], X[STRANDS.edges[:, 0]])


def test_one_curve_on_the_vertices_of_each_strand() -> None:
    curve = spline_curve(X, STRANDS, "bezier")
    assert curve.control_points.shape == (2, 6, 3)  # the ring of five returns to its first vertex
    np.testing.assert_array_equal(curve.control_points[1], X[[4, 5, 6, 7, 8, 4]])
    np.testing.assert_allclose(curve.points([1 / 3])[0, 0], np.array([8, 12, 6, 1]) / 27 @ X[:4], atol=1e-14)


def test_one_curve_through_the_vertices_of_each_strand() -> None:
    curve = spline_curve(X, STRANDS, "bezier-through")
    np.testing.assert_allclose(curve.points(np.arange(4) / 3)[0], X[:4], atol=1e-13)


def test_positions_that_coincide_are_refused_by_name() -> None:
    x = X.copy()
    x[3] = x[2]
    with pytest.raises(InputError, match="Vertices 2 and 3 follow each other and coincide"):
        spline_curve(x, STRANDS)
    x = X.copy()
    x[8] = x[4]
    with pytest.raises(InputError, match="Vertices 8 and 4"):
        spline_curve(x, STRANDS)


def test_too_few_vertices_are_refused() -> None:
    with pytest.raises(StrandError, match="at least 3"):
        Strands.from_lengths([2], closed=True)
    with pytest.raises(InputError, match=r"shape \(9, 3\)"):
        spline_curve(X[:8], STRANDS)


def test_too_high_a_degree_is_refused() -> None:
    x = np.random.default_rng(1).normal(size=(30, 3))
    with pytest.raises(StrandError, match=r"30 vertices.*degree 20 at most"):
        spline_curve(x, Strands.from_lengths([30]), "bezier-through")


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(OptionError, match="must be one of: interpolating"):
        spline_curve(X, STRANDS, "cubic")  # type: ignore[arg-type]


def test_segments_must_meet() -> None:
    points = np.zeros((2, 4, 3))
    points[0, 3] = 1.0
    with pytest.raises(InputError, match="Segment 0 ends at"):
        CompositeBezier.from_control_points(points)
    with pytest.raises(InputError, match="Segment 0 ends at"):
        CompositeBezier.from_control_points(points[:1], closed=True)
    assert CompositeBezier.from_control_points(points, lengths=[1, 1]).n_segments == 2


@pytest.mark.parametrize("points", [np.zeros((1, 1, 3)), np.zeros((2, 4)), np.zeros((1, 4, 4)), np.zeros((0, 4, 3))])
def test_a_shape_that_does_not_fit_is_refused(points: np.ndarray) -> None:
    with pytest.raises(InputError, match="shape"):
        CompositeBezier.from_control_points(points)


def test_points_that_are_not_finite_are_refused() -> None:
    points = np.zeros((1, 4, 3))
    points[0, 1, 2] = np.nan
    with pytest.raises(InputError, match="not finite"):
        CompositeBezier.from_control_points(points)


def test_d_star_in_the_plane_and_in_space() -> None:
    assert d_star(np.array([[1, 2], [1, -1]])) == pytest.approx(1.0, rel=1e-14)
    assert d_star(np.array([[1, 2, 2]])) == pytest.approx(3.0, rel=1e-14)
    assert d_star(np.array([[1, 0], [-1, 0]])) == 0.0
    with pytest.raises(InputError, match=r"\(n, 2\) or \(n, 3\)"):
        d_star(np.zeros((2, 4)))
    with pytest.raises(InputError, match="finite"):
        d_star(np.array([[np.nan, 0]]))
