from collections.abc import Callable, Sequence

import numpy as np
import pytest

import mdtopo
from mdtopo.errors import InputError

PI = np.pi
EPSILONS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)

HELIX = mdtopo.ParametricCurve(
    lambda t: (np.cos(4 * PI * t), np.sin(4 * PI * t), t),
    lambda t: (-16 * PI**2 * np.cos(4 * PI * t), -16 * PI**2 * np.sin(4 * PI * t), 0.0),
)
ELLIPSE = mdtopo.ParametricCurve(
    lambda t: (3 * np.cos(2 * PI * t), np.sin(2 * PI * t)),
    lambda t: (-12 * PI**2 * np.cos(2 * PI * t), -4 * PI**2 * np.sin(2 * PI * t)),
    closed=True,
)
P = np.array([[0.0, 0, 0], [1, 2, 0], [3, 2, 1], [4, 0, 2]])
BEZIER = mdtopo.ParametricCurve(
    lambda t: (1 - t) ** 3 * P[0] + 3 * t * (1 - t) ** 2 * P[1] + 3 * t**2 * (1 - t) * P[2] + t**3 * P[3],
    lambda t: 6 * (1 - t) * (P[2] - 2 * P[1] + P[0]) + 6 * t * (P[3] - 2 * P[2] + P[1]),
)


def trefoil(t: float) -> Sequence[float]:
    x = 2 * PI * t
    return np.sin(x) + 2 * np.sin(2 * x), np.cos(x) - 2 * np.cos(2 * x), -np.sin(3 * x)


def trefoil_bend(t: float) -> Sequence[float]:
    x, k = 2 * PI * t, 4 * PI**2
    return k * (-np.sin(x) - 8 * np.sin(2 * x)), k * (-np.cos(x) + 8 * np.cos(2 * x)), k * 9 * np.sin(3 * x)


TREFOIL = mdtopo.ParametricCurve(trefoil, trefoil_bend, closed=True)

# ∫√|c''|/√2, and N for each ε: the reference table of the project
TABLE = [
    ("helix", HELIX, 8.885766, (29, 89, 281, 889, 2810)),
    ("ellipse", ELLIPSE, 6.385146, (21, 64, 202, 639, 2020)),
    ("bezier", BEZIER, 2.543425, (9, 26, 81, 255, 805)),
    ("trefoil", TREFOIL, 14.110527, (45, 142, 447, 1412, 4463)),
]
NAMED = pytest.mark.parametrize(("curve", "limit", "chords"), [row[1:] for row in TABLE], ids=[row[0] for row in TABLE])


def bend_lengths(curve: mdtopo.ParametricCurve, n: int = 20000) -> tuple[np.ndarray, np.ndarray]:
    t = (np.arange(n) + 0.5) / n
    return t, np.array([np.linalg.norm(curve.bend(u)) for u in t])


def stepped(curve: mdtopo.ParametricCurve, weight: Callable[[np.ndarray, float], np.ndarray], epsilon: float) -> int:
    """Number of chords by a rule ∫(t..t+h) |c''(u)| weight(t + h - u, h) du = ε: the slow judge, by midpoint sums."""
    n = 40_000
    _, g = bend_lengths(curve, n)
    count, start = 0, 0
    while start < n:
        low, high = 1, n - start
        while low < high:  # the integral rises with h
            k = (low + high) // 2
            h = k / n
            if np.sum(g[start : start + k] * weight(h - (np.arange(k) + 0.5) / n, h)) / n >= epsilon:
                high = k
            else:
                low = k + 1
        start, count = start + low, count + 1
    return count


@NAMED
def test_numbers_of_chords_are_those_of_the_table(
    curve: mdtopo.ParametricCurve, limit: float, chords: tuple[int, ...]
) -> None:
    assert tuple(mdtopo.approximate(curve, epsilon=e).n_chords for e in EPSILONS) == chords


@NAMED
def test_chords_times_root_epsilon_tend_to_the_integral(
    curve: mdtopo.ParametricCurve, limit: float, chords: tuple[int, ...]
) -> None:
    integral = bend_lengths(curve)[1] ** 0.5
    assert integral.mean() / 2**0.5 == pytest.approx(limit, rel=1e-6)
    assert mdtopo.approximate(curve, epsilon=1e-5).n_chords * 1e-5**0.5 == pytest.approx(limit, rel=0.01)


@NAMED
def test_every_step_but_the_last_has_its_integral(
    curve: mdtopo.ParametricCurve, limit: float, chords: tuple[int, ...]
) -> None:
    found = mdtopo.approximate(curve, epsilon=0.01)
    x, w = np.polynomial.legendre.leggauss(40)
    integrals = []
    for a, b in zip(found.parameters[:-1], found.parameters[1:], strict=True):
        u = 0.5 * (a + b) + 0.5 * (b - a) * x
        g = np.array([np.linalg.norm(curve.bend(v)) for v in u])
        integrals.append(0.5 * (b - a) * np.sum(w * g * (b - u)))
    np.testing.assert_allclose(integrals[:-1], 0.01, rtol=1e-6)
    assert 0.0 < integrals[-1] <= 0.01 * (1 + 1e-6)
    assert (found.parameters[0], found.parameters[-1]) == (0.0, 1.0)
    np.testing.assert_array_equal(found.points, curve.points(found.parameters))


@pytest.mark.parametrize("name", ["ellipse", "bezier"])
def test_other_weights_have_other_limits(name: str) -> None:
    # without the weight t+h-u the step is a bend, and N·ε tends to ∫|c''|; with h in its place N·√ε is too large by √2
    curve, limit = next((row[1], row[2]) for row in TABLE if row[0] == name)
    epsilon = 1e-2
    by_rule = stepped(curve, lambda rest, h: rest, epsilon)
    assert by_rule == mdtopo.approximate(curve, epsilon=epsilon).n_chords
    by_length = stepped(curve, lambda rest, h: np.full_like(rest, h), epsilon)
    assert by_length * epsilon**0.5 == pytest.approx(2**0.5 * limit, rel=0.05)
    total = bend_lengths(curve)[1].mean()
    by_bend = [stepped(curve, lambda rest, h: np.ones_like(rest), e) for e in (total / 50, total / 200)]
    assert by_bend == pytest.approx([50, 200], rel=0.03)  # four times as many for a quarter of ε, not twice


@NAMED
@pytest.mark.parametrize("tolerance", [0.1, 1e-3])
def test_a_tolerance_is_kept(
    curve: mdtopo.ParametricCurve, limit: float, chords: tuple[int, ...], tolerance: float
) -> None:
    found = mdtopo.approximate(curve, tolerance)
    assert found.epsilon == 4 * tolerance
    assert found.chord_error <= tolerance
    assert found.chord_bound <= found.epsilon
    # looked at more finely, the curve is still there
    for a, b in zip(found.parameters[:-1], found.parameters[1:], strict=True):
        p, q = curve.point(a), curve.point(b)
        there = curve.points(np.linspace(a, b, 33))
        where = np.clip((there - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
        assert np.linalg.norm(there - p - where[:, None] * (q - p), axis=1).max() <= tolerance * 1.02


def test_short_chords_are_a_quarter_of_epsilon_away() -> None:
    found = mdtopo.approximate(HELIX, epsilon=1e-4)
    assert found.chord_error == pytest.approx(0.25e-4, rel=0.01)
    assert found.chord_bound == pytest.approx(1e-4 / 3, rel=0.01)


def test_the_same_vertices_at_another_scale_and_place() -> None:
    moved = mdtopo.ParametricCurve(
        lambda t: 7.0 * np.array(trefoil(t)) + 100, lambda t: 7.0 * np.array(trefoil_bend(t))
    )
    np.testing.assert_allclose(
        mdtopo.approximate(moved, epsilon=0.07).parameters,
        mdtopo.approximate(TREFOIL, epsilon=0.01).parameters,
        rtol=1e-9,
    )


def test_a_straight_line_is_one_chord() -> None:
    line = mdtopo.ParametricCurve(lambda t: (t, 2 * t, 3 * t), lambda t: (0, 0, 0))
    assert mdtopo.approximate(line, epsilon=1e-9).parameters.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(("factor", "chords"), [(1 + 1e-6, 4), (1 - 1e-6, 5)])
def test_a_last_step_is_taken_only_where_it_is_one(factor: float, chords: int) -> None:
    parabola = mdtopo.ParametricCurve(lambda t: (t, t * t), lambda t: (0, 2))
    assert mdtopo.approximate(parabola, epsilon=factor / 16).n_chords == chords


def test_a_bend_that_vanishes_in_the_middle() -> None:
    # |c''| = 6|t - 1/2|: by symmetry and by the limit (1/√2)∫√(6|t-1/2|) = √3 · (1/2)^(3/2) · 4/3
    cubic = mdtopo.ParametricCurve(lambda t: (t, (t - 0.5) ** 3), lambda t: (0, 6 * (t - 0.5)))
    found = mdtopo.approximate(cubic, epsilon=1e-6)
    assert found.n_chords * 1e-3 == pytest.approx(3**0.5 * 0.5**1.5 * 4 / 3, rel=0.01)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["epsilon", "tolerance"])
def test_no_polyline_for_a_length_that_is_none(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"{name} must be a length greater than 0"):
        mdtopo.approximate(HELIX, **{name: value})


def test_one_of_tolerance_and_epsilon() -> None:
    with pytest.raises(InputError, match="either a tolerance or an epsilon"):
        mdtopo.approximate(HELIX)
    with pytest.raises(InputError, match="either a tolerance or an epsilon"):
        mdtopo.approximate(HELIX, 0.1, epsilon=0.1)


def test_too_many_vertices_are_refused() -> None:
    with pytest.raises(InputError, match="more than 1,000,000 vertices"):
        mdtopo.approximate(HELIX, epsilon=1e-13)


def test_a_second_derivative_of_another_curve_is_found_out() -> None:
    wrong = mdtopo.ParametricCurve(HELIX.position, lambda t: np.array(HELIX.second_derivative(t)) / 10)
    with pytest.raises(InputError, match="second_derivative is not that of position: between t = "):
        mdtopo.approximate(wrong, epsilon=0.01)


def test_a_corner_is_no_part_of_a_smooth_curve() -> None:
    corner = mdtopo.ParametricCurve(lambda t: (t, abs(t - 0.4)), lambda t: (0, 0))
    with pytest.raises(InputError, match="or the curve is not C²"):
        mdtopo.approximate(corner, epsilon=0.01)


def test_a_bend_that_is_not_finite_between_the_probes() -> None:
    root = mdtopo.ParametricCurve(lambda t: (t, t), lambda t: (0, np.inf if 0.1 < t < 0.2 else 0))
    with pytest.raises(InputError, match=r"second_derivative\(0\.1\d*\) is \[0\.0, inf\]; the curve must be C²"):
        mdtopo.approximate(root, epsilon=0.1)


def trefoil_spline(n: int) -> mdtopo.CompositeBezier:
    points = np.array([trefoil(k / n) for k in range(n)])
    return mdtopo.spline_curve(points, mdtopo.Strands.from_lengths([n], closed=True))


def test_a_bezier_segment_has_the_vertices_of_its_function() -> None:
    segment = mdtopo.CompositeBezier.from_control_points(P)
    for epsilon in EPSILONS:
        found, expected = mdtopo.approximate(segment, epsilon=epsilon), mdtopo.approximate(BEZIER, epsilon=epsilon)
        np.testing.assert_allclose(found.parameters, expected.parameters, atol=1e-10)
        assert expected.chord_error * (1 - 1e-9) <= found.chord_error <= expected.chord_error * 1.02
    np.testing.assert_allclose(found.points, expected.points, atol=1e-9)


def test_a_spline_tends_to_its_integral() -> None:
    found = mdtopo.approximate(trefoil_spline(60), epsilon=1e-5)
    assert found.n_chords * 1e-5**0.5 == pytest.approx(14.110527, rel=0.01)
    assert found.isotopy is mdtopo.Isotopy.TUBE


@pytest.mark.parametrize("tolerance", [0.3, 0.03, 1e-3])
def test_a_tolerance_is_proven_for_splines(tolerance: float) -> None:
    curve = trefoil_spline(24)
    found = mdtopo.approximate(curve, tolerance)
    assert found.chord_error <= tolerance
    u = np.linspace(0, 1, 400, endpoint=False)
    there = curve.points(u).reshape(-1, 3)
    a, b = found.points[:-1, None], found.points[1:, None]
    where = np.clip(((there - a) * (b - a)).sum(2) / ((b - a) ** 2).sum(2), 0, 1)
    gaps = np.linalg.norm(there - a - where[..., None] * (b - a), axis=2).min(axis=0)
    assert gaps.max() <= found.chord_error
    assert gaps.max() >= 0.9 * found.chord_error


def test_the_tube_tells_the_type_where_it_can() -> None:
    # within the tube of the trefoil, 0.607, and beyond it
    curve = trefoil_spline(60)
    near, far = mdtopo.approximate(curve, 0.05), mdtopo.approximate(curve, epsilon=8.0)
    assert near.isotopy is mdtopo.Isotopy.TUBE
    assert mdtopo.knot_determinant(near.points[:-1]) == 3
    assert far.isotopy is mdtopo.Isotopy.NOT_KNOWN
    assert "radius 0.607" in far.reason
    assert "runs along it" in near.reason


def test_the_type_of_a_function_is_seen_by_samples() -> None:
    x = 2 * PI

    def velocity(t: float) -> Sequence[float]:
        return x * np.cos(x * t) * 3, -x * np.sin(x * t)

    ellipse = mdtopo.ParametricCurve(
        lambda t: (3 * np.sin(x * t), np.cos(x * t)),
        lambda t: (-3 * x**2 * np.sin(x * t), -(x**2) * np.cos(x * t)),
        velocity,
        closed=True,
    )
    assert mdtopo.approximate(ellipse, 0.01).isotopy is mdtopo.Isotopy.TUBE_SAMPLED
    assert mdtopo.approximate(ellipse, epsilon=3.0).isotopy is mdtopo.Isotopy.NOT_KNOWN
    assert "first derivative" in mdtopo.approximate(ELLIPSE, 0.01).reason


def test_a_corner_is_a_vertex() -> None:
    corner = mdtopo.CompositeBezier.from_control_points(np.array([[[0.0, 0], [1, 0]], [[1, 0], [1, 1]]]))
    found = mdtopo.approximate(corner, epsilon=0.1)
    assert found.parameters.tolist() == [0.0, 0.5, 1.0]
    assert found.chord_error <= 1e-12
    assert found.isotopy is mdtopo.Isotopy.NOT_KNOWN
    assert "corner of 90°" in found.reason


def test_strands_come_one_after_the_other() -> None:
    points = np.stack([P, P + np.array([0, 0, 5.0])])
    found = mdtopo.approximate(mdtopo.CompositeBezier.from_control_points(points, lengths=[1, 1]), epsilon=0.1)
    assert found.offsets.tolist() == [0, 10, 20]
    assert found.n_chords == 18
    np.testing.assert_allclose(found.points[10:] - found.points[:10], np.tile([0, 0, 5.0], (10, 1)), atol=1e-12)


def test_a_curve_that_meets_itself_is_never_of_known_type() -> None:
    # the loop of case T2: its ends are apart, its body crosses itself
    loop = mdtopo.CompositeBezier.from_control_points(np.array([[0.0, 0], [2, 1], [-1, 1], [1, 0]]))
    found = mdtopo.approximate(loop, 1e-4)
    assert found.isotopy is mdtopo.Isotopy.NOT_KNOWN
    assert mdtopo.tube(loop).radius <= 1e-9
