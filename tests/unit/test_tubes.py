import cases
import numpy as np
import pytest
from oracles.tubes import least_distance, thickness

import mdtopo
from mdtopo import CompositeBezier, ParametricCurve, TubeLimit
from mdtopo.errors import InputError
from mdtopo.geometry.curvature import greatest_curvature
from mdtopo.tubes import STAGES, radius_bounds

TUBES = cases.tube_cases()
PI = np.pi
KAPPA = 4 * (np.sqrt(2) - 1) / 3  # control points of a quarter of a circle
QUARTER = np.array([[1, 0, 0], [1, KAPPA, 0], [KAPPA, 1, 0], [0, 1, 0]])
TURN = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
RING = np.stack([QUARTER, QUARTER @ TURN, QUARTER @ TURN @ TURN, QUARTER @ TURN @ TURN @ TURN])
RING[1:, 0] = RING[:-1, -1]
RING[-1, -1] = RING[0, 0]


def closed(points: np.ndarray) -> CompositeBezier:
    return CompositeBezier.from_control_points(points, closed=True)


def waves(amplitudes: dict[int, tuple[np.ndarray, np.ndarray]], turns: float, rise: float = 0.0) -> list:
    """Position and two derivatives of Σ (a cos kx + b sin kx) + (0, 0, rise·x), x = turns·2π·t."""
    w = turns * 2 * PI

    def derivative(order: int):
        def at(t: float) -> np.ndarray:
            x, total = w * t, np.zeros(3)
            for k, (a, b) in amplitudes.items():
                phase = k * x + order * PI / 2
                total += (k * w) ** order * (np.asarray(a) * np.cos(phase) + np.asarray(b) * np.sin(phase))
            total[2] += (rise * x, rise * w, 0.0)[order]
            return total

        return at

    return [derivative(0), derivative(1), derivative(2)]


def curve_of(functions: list, is_closed: bool) -> ParametricCurve:
    c, c1, c2 = functions
    return ParametricCurve(c, c2, c1, closed=is_closed)


ROUND = {
    "T11a": curve_of(waves({1: ([1, 0, 0], [0, 1, 0])}, 1), True),
    "T11b": curve_of(waves({1: ([3, 0, 0], [0, 1, 0])}, 1), True),
    "T11c": curve_of(
        waves({1: ([0, 1, 0], [1, 0, 0]), 2: ([0, -2, 0], [2, 0, 0]), 3: ([0, 0, 0], [0, 0, -1])}, 1), True
    ),
    "T11d": curve_of(waves({1: ([1, 0, 0], [0, 1, 0])}, 3, rise=0.1), False),
}


def rational(case: cases.TubeCase) -> ParametricCurve:
    p, w = np.array(case.control_points, dtype=float), np.array(case.weights, dtype=float)
    h = np.concatenate([p * w[:, None], w[:, None]], axis=1)

    def bernstein(c: np.ndarray, u: float) -> np.ndarray:
        while len(c) > 1:
            c = (1 - u) * c[:-1] + u * c[1:]
        return c[0]

    d1 = 4 * np.diff(h, axis=0)
    d2 = 3 * np.diff(d1, axis=0)

    def point(u: float) -> np.ndarray:
        x = bernstein(h, u)
        return x[:2] / x[2]

    def velocity(u: float) -> np.ndarray:
        x, y = bernstein(h, u), bernstein(d1, u)
        return (y[:2] - y[2] * point(u)) / x[2]

    def bend(u: float) -> np.ndarray:
        x, y, z = bernstein(h, u), bernstein(d1, u), bernstein(d2, u)
        return (z[:2] - z[2] * point(u) - 2 * y[2] * velocity(u)) / x[2]

    return ParametricCurve(point, bend, velocity)


@pytest.mark.parametrize("name", sorted(ROUND))
def test_tubes_of_the_exact_cases(name: str) -> None:
    found, expect = mdtopo.tube(ROUND[name]), TUBES[name].expect
    assert 1 / found.kappa_max == pytest.approx(float(expect["inverse_kappa_max"]), abs=5e-9)
    assert found.self_distance == pytest.approx(float(expect["self_distance"]), abs=5e-9)
    assert found.radius == pytest.approx(float(expect["radius"]), abs=5e-9)
    assert not found.is_proven


def test_curvature_of_the_trefoil_to_ten_digits() -> None:
    assert mdtopo.tube(ROUND["T11c"]).kappa_max == pytest.approx(0.7768148543, abs=1e-10)


def test_what_rules_the_tubes_of_the_exact_cases() -> None:
    assert mdtopo.tube(ROUND["T11b"]).ruling.limit is TubeLimit.CURVATURE
    assert mdtopo.tube(ROUND["T11c"]).ruling.limit is TubeLimit.SELF


def test_the_end_of_the_rational_quartic_is_near_its_body() -> None:
    case = TUBES["T11e"]
    found = mdtopo.tube(rational(case)).term(TubeLimit.END_BODY)
    assert found.found == pytest.approx(case.expect["end_body_distance"], abs=5e-8)
    assert found.where == pytest.approx((1.0, case.expect["end_body_parameter"]), abs=5e-8)
    assert found.radius == found.found / 2


def test_a_ring_of_four_arcs() -> None:
    found = mdtopo.tube(closed(RING), tolerance=1e-4)
    term = found.term(TubeLimit.SELF)
    assert term.least <= 2.0 <= term.found + 1e-12
    assert term.found == pytest.approx(2.0, abs=1e-9)
    assert term.least == pytest.approx(2.0, rel=2e-4)
    assert found.is_proven


def test_a_flat_ellipse_of_four_arcs() -> None:
    found = mdtopo.tube(closed(RING * [3, 1, 1]))
    assert found.self_distance == pytest.approx(2.0, rel=1e-7)
    assert found.self_distance <= 2.0
    assert found.ruling.limit is TubeLimit.CURVATURE
    # the curvature at the first point of a cubic is (2/3) |h0 x h1| / |h0|³ with the first differences h
    p = RING[0] * [3, 1, 1]
    hand = (2 / 3) * np.linalg.norm(np.cross(p[1] - p[0], p[2] - p[1])) / np.linalg.norm(p[1] - p[0]) ** 3
    assert found.kappa_max >= hand * (1 - 1e-12)


def trefoil_spline(n: int) -> CompositeBezier:
    x = 2 * PI * np.arange(n) / n
    points = np.stack([np.sin(x) + 2 * np.sin(2 * x), np.cos(x) - 2 * np.cos(2 * x), -np.sin(3 * x)], axis=1)
    return mdtopo.spline_curve(points, mdtopo.Strands.from_lengths([n], closed=True), kind="interpolating")


def test_splines_through_the_trefoil_tend_to_its_tube() -> None:
    expect = TUBES["T11c"].expect
    found = mdtopo.tube(trefoil_spline(400))
    assert found.ruling.limit is TubeLimit.SELF
    assert found.self_distance == pytest.approx(expect["self_distance"], abs=5e-8)
    assert found.kappa_max == pytest.approx(0.7768148543, rel=2e-4)


def dense(curve: CompositeBezier, n: int = 200) -> np.ndarray:
    return curve.points(np.linspace(0, 1, n + 1)[:-1]).reshape(-1, 3)


@pytest.mark.parametrize("seed", range(8))
def test_no_sample_is_nearer_or_more_bent_than_the_bounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 12
    strands = mdtopo.Strands.from_lengths([n], closed=True)
    curve = mdtopo.spline_curve(rng.normal(size=(n, 3)) * 3, strands, kind="interpolating")
    found = mdtopo.tube(curve)
    points = dense(curve)
    tangents = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    apart = points[:, None] - points[None]
    distance = np.linalg.norm(apart, axis=2)
    far = distance > 1e-9
    cosine = np.abs(np.einsum("ijk,ik->ij", apart, tangents)) / np.where(far, distance, 1)
    # of the samples a doubly normal pair is one with both cosines small
    pairs = far & (cosine < 0.02) & (cosine.T < 0.02)
    assert distance[pairs].min(initial=np.inf) >= found.self_distance - 0.05
    term = found.term(TubeLimit.SELF)
    assert term.least <= term.found <= term.least * (1 + 1e-7)
    first, second = (curve.points([w % 1])[int(w) % n][0] for w in term.where)
    assert np.linalg.norm(first - second) == pytest.approx(term.found, rel=1e-9)
    bends = greatest_curvature(curve.control_points, 1e-8)
    step = np.diff(np.concatenate([points, points[:1]]), axis=0)
    turned = np.linalg.norm(np.cross(step, np.roll(step, -1, axis=0)), axis=1)
    sizes = np.linalg.norm(step, axis=1)
    sampled = 2 * turned / (sizes * np.roll(sizes, -1) * np.linalg.norm(step + np.roll(step, -1, axis=0), axis=1))
    assert sampled.max() <= bends.upper * 1.001
    assert bends.lower <= bends.upper <= bends.lower * (1 + 1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_the_same_tube_moved_turned_reversed_and_scaled(seed: int) -> None:
    rng = np.random.default_rng(seed)
    curve = trefoil_spline(24)
    found = mdtopo.tube(curve)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moved = closed(_joined(2.5 * curve.control_points @ turn.T + 10))
    assert mdtopo.tube(moved).radius == pytest.approx(2.5 * found.radius, rel=1e-7)
    back = closed(np.ascontiguousarray(curve.control_points[::-1, ::-1]))
    assert mdtopo.tube(back).radius == pytest.approx(found.radius, rel=1e-7)


def _joined(points: np.ndarray) -> np.ndarray:
    points = points.copy()
    points[:, -1] = np.roll(points[:, 0], -1, axis=0)
    return points


def test_two_strands_are_half_their_distance_apart() -> None:
    rings = np.concatenate([RING, RING + np.array([0, 0, 0.3])])
    found = mdtopo.tube(CompositeBezier.from_control_points(rings, closed=True, lengths=[4, 4]), tolerance=1e-4)
    assert found.ruling.limit is TubeLimit.STRANDS
    assert found.radius == pytest.approx(0.15, rel=1e-4)
    assert found.radius <= 0.15


def test_ends_of_an_open_strand() -> None:
    # an open ring: three arcs and, of the fourth, a half; its last point comes near the first
    open_ = CompositeBezier.from_control_points(RING[:3])
    found = mdtopo.tube(open_, tolerance=1e-4)
    assert found.term(TubeLimit.END_END).found == pytest.approx(np.sqrt(2))
    # a hook: a line whose end turns back onto its own middle
    hook = np.array(
        [[[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [[3, 0, 0], [4, 0, 0], [2, 1, 0], [1.5, 0.1, 0]]], float
    )
    found = mdtopo.tube(CompositeBezier.from_control_points(hook))
    body = found.term(TubeLimit.END_BODY)
    assert body.found == pytest.approx(0.1, rel=1e-9)
    assert body.where == pytest.approx((2.0, 0.5))
    assert found.ruling.limit in (TubeLimit.END_BODY, TubeLimit.CURVATURE)


def test_an_end_that_touches_its_own_body_has_no_tube() -> None:
    hook = np.array(
        [[[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [[3, 0, 0], [4, 0, 0], [2, 1, 0], [1.5, 0, 0]]], float
    )
    assert mdtopo.tube(CompositeBezier.from_control_points(hook)).radius <= 1e-9
    at_joint = np.array(
        [
            [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]],
            [[3, 0, 0], [4, 0, 0], [5, 0, 0], [6, 0, 0]],
            [[6, 0, 0], [7, 0, 0], [3, 3, 0], [3, 0, 0]],
        ],
        float,
    )
    assert mdtopo.tube(CompositeBezier.from_control_points(at_joint)).radius <= 1e-9


def test_a_straight_line_may_be_as_thick_as_it_is_long() -> None:
    line = CompositeBezier.from_control_points(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]))
    found = mdtopo.tube(line)
    assert found.ruling.limit is TubeLimit.END_END
    assert found.radius == pytest.approx(1.5)
    assert found.self_distance == np.inf


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            [[0, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0]],
            r"cusp, or comes too near to one to tell, in segment 0 near u = 0\.5",
        ),
        ([[1, 2, 3]] * 4, "Segment 0 of the curve is a single point; coincident vertices"),
    ],
    ids=["cusp", "coincident"],
)
def test_segments_without_a_tube(points: list, message: str) -> None:
    with pytest.raises(InputError, match=message):
        mdtopo.tube(CompositeBezier.from_control_points(np.array(points, dtype=float)))


def test_a_cusp_is_told_from_a_narrow_bend() -> None:
    # the inner points cross by a little less: a bend of finite, great curvature
    near = np.array([[0, 0, 0], [1 - 1e-4, 1, 0], [1e-4, 1, 0], [1, 0, 0]])
    found = mdtopo.tube(CompositeBezier.from_control_points(near))
    assert 0 < found.radius < 1e-6


def test_a_corner_has_no_tube() -> None:
    corner = np.array([[[0, 0, 0], [1, 0, 0]], [[1, 0, 0], [1, 1, 0]]], dtype=float)
    with pytest.raises(InputError, match="corner of 90° where segment 0 meets segment 1"):
        mdtopo.tube(CompositeBezier.from_control_points(corner))


def test_a_sampled_cusp_is_named() -> None:
    cusp = ParametricCurve(
        lambda t: ((t - 0.5) ** 2, (t - 0.5) ** 3),
        lambda t: (2, 6 * (t - 0.5)),
        lambda t: (2 * t - 1, 3 * (t - 0.5) ** 2),
    )
    with pytest.raises(InputError, match=r"cusp near t = 0\.5"):
        mdtopo.tube(cusp)


def test_a_tolerance_is_positive() -> None:
    with pytest.raises(InputError, match="greater than 0"):
        mdtopo.tube(closed(RING), tolerance=0.0)


def test_a_ring_of_two_segments() -> None:
    half = np.array([[1.0, 0, 0], [1, 4 / 3, 0], [-1, 4 / 3, 0], [-1, 0, 0]])
    found = mdtopo.tube(closed(_joined(np.stack([half, -half]))))
    # by hand: half-way up, y = 3/4 · 4/3 = 1 above and below, and 2 across
    assert found.self_distance == pytest.approx(2.0, rel=1e-7)
    assert found.self_distance <= 2.0


def test_a_ring_of_one_segment_with_a_smooth_joint() -> None:
    petal = np.array([[0.0, 0, 0], [2, 0, 0], [2, 3, 0], [-2, 3, 0], [-2, 0, 0], [0, 0, 0]])
    found = mdtopo.tube(closed(petal[np.newaxis]))
    # by hand: up the middle, from 0 to y(1/2) = 2·(10/32)·3 = 15/8; across, the two sides are further or nearer
    assert found.self_distance <= 15 / 8
    assert 0.3 < found.radius <= found.self_distance / 2


# --- against the judge ------------------------------------------------------------------------------------------------


def test_the_judge_by_hand() -> None:
    """A circle of radius 1 has the thickness 1; two edges of a slot 1/5 apart rule one that is drawn out."""
    assert thickness(RING, 50) == pytest.approx(0.9921, abs=1e-3)  # cubics bend a little more at their joints
    assert thickness(RING * [1.0, 0.1, 1.0], 200) == pytest.approx(0.01, rel=0.05)  # b²/a at the ends
    assert least_distance(RING, RING + np.array([0, 0, 0.3]), 20) == pytest.approx(0.3, rel=1e-12)


def longest_gap(curve: CompositeBezier, per_segment: int) -> float:
    """Return the greatest distance of neighbouring samples, from the greatest |c'|."""
    steps = np.linalg.norm(np.diff(curve.control_points, axis=1), axis=2)
    return float(curve.degree * steps.max() / per_segment)


@pytest.mark.parametrize("seed", range(12))
def test_the_tube_is_as_thick_as_samples_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, kind = int(rng.integers(5, 14)), ("interpolating", "bspline")[seed % 2]
    curve = mdtopo.spline_curve(rng.normal(size=(n, 3)) * 3, mdtopo.Strands.from_lengths([n], closed=True), kind=kind)
    radius, per_segment = mdtopo.tube(curve).radius, 1500 // n
    sampled = thickness(curve.control_points, per_segment)
    assert radius <= sampled * (1 + 1e-9)
    # two places are missed by half a gap each at most, which lengthens the line between them only by its square
    assert sampled <= np.hypot(radius, longest_gap(curve, per_segment)) * 1.01


@pytest.mark.parametrize("seed", range(6))
def test_the_tube_of_a_smooth_curve_is_as_thick_as_samples_say(seed: int) -> None:
    """Three harmonics through 24 vertices: samples show all of it."""
    rng = np.random.default_rng(seed)
    x = 2 * PI * np.arange(24) / 24
    points = sum(
        (np.cos(k * x)[:, None] * rng.normal(size=3) + np.sin(k * x)[:, None] * rng.normal(size=3)) * 3 / k
        for k in (1, 2, 3)
    )
    curve = mdtopo.spline_curve(points, mdtopo.Strands.from_lengths([24], closed=True), kind="interpolating")
    radius, sampled = mdtopo.tube(curve).radius, thickness(curve.control_points, 60)
    assert radius * (1 - 1e-9) <= sampled <= radius * 1.02


@pytest.mark.parametrize("seed", range(4))
def test_two_strands_are_as_far_apart_as_samples_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.normal(size=(8, 3)) * 3, rng.normal(size=(8, 3)) * 3 + [4, 0, 0]])
    curve = mdtopo.spline_curve(points, mdtopo.Strands.from_lengths([8, 8], closed=True), kind="interpolating")
    found = mdtopo.tube(curve).term(TubeLimit.STRANDS)
    sampled = least_distance(curve.control_points[:8], curve.control_points[8:], 100)
    assert found.least <= sampled <= np.hypot(found.least, longest_gap(curve, 100)) * 1.01


# --- no closer than is asked ------------------------------------------------------------------------------------------


def circle(n: int) -> CompositeBezier:
    x = 2 * PI * np.arange(n) / n
    points = np.stack([np.cos(x), np.sin(x), 0 * x], axis=1)
    return mdtopo.spline_curve(points, mdtopo.Strands.from_lengths([n], closed=True), kind="interpolating")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The tolerances that a tube is asked for."""
    seen: list[float] = []

    def tube(curve: CompositeBezier, *, tolerance: float) -> mdtopo.Tube:
        seen.append(tolerance)
        return mdtopo.tube(curve, tolerance=tolerance)

    monkeypatch.setattr("mdtopo.tubes.tube", tube)
    return seen


@pytest.mark.parametrize("distance", [0.0, 0.5, 0.9, 1.1, 7.0])
def test_a_distance_far_from_the_radius_needs_the_first_digits_alone(asked: list[float], distance: float) -> None:
    least, most = radius_bounds(circle(12), distance)
    assert asked == [STAGES[0]]
    assert (distance < least) == (distance < 1.0)
    assert least * (1 - 1e-12) <= mdtopo.tube(circle(12)).radius <= most


@pytest.mark.parametrize(
    ("share", "n_stages"), [(1 - 1e-3, 2), (1 - 1e-5, 3), (1 - 1e-7, 4), (1 + 1e-7, 4), (1 + 1e-1, 1)]
)
def test_a_distance_is_told_from_the_radius_as_closely_as_the_tube_itself_can(
    asked: list[float], share: float, n_stages: int
) -> None:
    curve = circle(12)
    distance = share * mdtopo.tube(curve, tolerance=1e-11).radius
    least, most = radius_bounds(curve, distance)
    assert not least <= distance < most
    assert (distance < least) is (share < 1)
    assert len(asked) <= n_stages


def test_a_distance_within_the_last_digits_is_never_said_to_be_inside() -> None:
    curve = circle(12)
    found = mdtopo.tube(curve)
    least, most = radius_bounds(curve, 0.5 * (found.radius + found.radius_at_most))
    assert least <= 0.5 * (found.radius + found.radius_at_most) <= most
