"""One step of smooth curves: exact cases, invariances, near misses, and dense sampling as the judge."""

import numpy as np
import oracles
import pytest
from cases import CurveCase, curve_cases, polyline_cases
from numpy.typing import NDArray

from mdtopo import InputError, MonitorConfig, Strands, curve_embedding, curve_step, polyline_step, spline_curve
from mdtopo.records import CompositeBezier, CurveReport, Grade, Rung, Verdict

Points = NDArray[np.float64]
CASES = curve_cases()
HEXAGON = polyline_cases()["T1"]


def curves(case: CurveCase, until: float = 1.0) -> tuple[CompositeBezier, CompositeBezier]:
    p0, p1 = case.floats
    ends = p0, (1 - until) * p0 + until * p1
    first, second = (CompositeBezier.from_control_points(p, closed=case.closed) for p in ends)
    return first, second


def report_of(name: str, until: float = 1.0) -> CurveReport:
    return curve_step(*curves(CASES[name], until))


# --- exact cases ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["T3", "T4"])
def test_the_printed_bound_allows_a_curve_to_meet_itself(name: str) -> None:
    report = report_of(name)
    assert report.printed_ratio == pytest.approx(0.75, rel=1e-12)  # below 1: proved, says the paper
    assert report.bezier_ratio == pytest.approx(1.5, rel=1e-12)  # above 1: not proved
    assert report.d_star == pytest.approx(1.0, rel=1e-12)
    assert report.bezier_margin == pytest.approx(-0.5, rel=1e-12)
    assert report.verdict is Verdict.UNRESOLVED  # it touches itself in the frame at the end
    assert report.place is not None
    assert report.place.t[1] == 1.0
    assert report.place.u[0] <= 1e-4
    assert report.place.v[0] - 1e-4 <= 0.25 <= report.place.v[1] + 1e-4


@pytest.mark.parametrize("name", ["T3", "T4"])
@pytest.mark.parametrize(("until", "proved"), [(0.66, True), (0.67, False)])
def test_the_sound_bound_is_half_the_printed_one(name: str, until: float, proved: bool) -> None:
    assert (report_of(name, until).bezier_ratio < 1.0) is proved


@pytest.mark.parametrize("name", ["T3", "T4"])
def test_short_of_its_end_the_counterexample_is_certified(name: str) -> None:
    assert report_of(name, 0.99).verdict is Verdict.CERTIFIED


def test_a_cusp_is_unresolved_and_certified_until_it_comes() -> None:
    whole = report_of("T2")
    assert whole.verdict is Verdict.UNRESOLVED
    assert whole.d_star == pytest.approx(1 / 3, rel=1e-12)
    assert whole.place is not None
    assert whole.place.t[1] >= 0.4 - 1e-3
    early, hulls_alone = report_of("T2", 0.39), report_of("T2", 0.09)
    assert early.verdict is Verdict.CERTIFIED
    assert early.depth > 0  # the hull of the differences holds the origin from t = 1/10 on
    assert hulls_alone.verdict is Verdict.CERTIFIED
    assert hulls_alone.depth == 0


def test_a_cusp_in_a_still_curve_is_named() -> None:
    cusp = CompositeBezier.from_control_points(np.array([[0, 0], [1, 1], [0, 1], [1, 0]]))
    report = curve_embedding(cusp)
    assert report.verdict is Verdict.UNRESOLVED
    assert report.place is not None
    assert report.place.u[0] - 1e-3 <= 0.5 <= report.place.v[1] + 1e-3


def test_a_curve_crosses_while_its_polygon_s_step_is_certified() -> None:
    case = CASES["T9"]
    report = curve_step(*curves(case))
    passage = case.expect["passage"]
    assert (report.verdict, report.n_open) == (Verdict.CROSSING, 0)
    (crossing,) = report.crossings
    # the case's t follows from a height of 69.4176184, which has an error of 5e-8 in a rise of 22
    assert crossing.t == pytest.approx(passage["t"], abs=5e-8 / 22)
    assert crossing.parameters == pytest.approx((passage["u"], passage["v"]), abs=1e-8)
    assert crossing.segments == (0, 0)
    p0, p1 = case.floats
    ring = Strands.from_lengths([6], closed=True)
    polygon = polyline_step(p0[:-1], p1[:-1], ring, config=MonitorConfig(motion="lab"))
    assert polygon.verdict is Verdict.CERTIFIED


@pytest.mark.parametrize(("until", "verdict"), [(0.5189, Verdict.CERTIFIED), (0.5191, Verdict.CROSSING)])
def test_just_before_and_just_after_the_passage(until: float, verdict: Verdict) -> None:
    assert report_of("T9", until).verdict is verdict


def test_the_paper_s_hexagon_as_a_periodic_spline() -> None:
    ring = Strands.from_lengths([6], closed=True)
    ends = [spline_curve(x, ring) for x in HEXAGON.floats]
    report = curve_step(*ends)
    assert report.n_open == 0
    u = np.arange(24) / 24
    determinants = [oracles.knot_determinant(curve.points(u).reshape(-1, 3).tolist()) for curve in ends]
    assert determinants == [1, 3]  # so an odd number of passages at least
    assert report.verdict is Verdict.CROSSING
    assert len(report.crossings) % 2 == 1
    for crossing in report.crossings:
        blend = (1 - crossing.t) * ends[0].control_points + crossing.t * ends[1].control_points
        both = CompositeBezier.from_control_points(blend[list(crossing.segments)], lengths=[1, 1])
        one, two = (both.points([w])[k, 0] for k, w in enumerate(crossing.parameters))
        np.testing.assert_allclose(one, two, atol=1e-12)
        np.testing.assert_allclose(one, crossing.point, atol=1e-12)


# --- what is proved ---------------------------------------------------------------------------------------------------


def hopf(shift: float) -> CompositeBezier:
    x = np.arange(8) * np.pi / 4
    one = np.stack([np.cos(x), np.sin(x), 0 * x], axis=1)
    two = np.stack([1 + np.cos(x), 0 * x, np.sin(x)], axis=1)
    place = np.array([shift, 0.01, 0.07])  # not so that vertices meet
    return spline_curve(np.concatenate([one, two + place]), Strands.from_lengths([8, 8], closed=True))


def test_two_linked_rings_that_come_apart_are_a_proven_crossing() -> None:
    report = curve_step(hopf(0.0), hopf(3.0))
    assert (report.verdict, report.n_open) == (Verdict.CROSSING, 0)
    assert sum(crossing.sign for crossing in report.crossings) in (-1, 1)
    assert {crossing.grade for crossing in report.crossings} == {Grade.PROVEN}


def test_rings_that_meet_exactly_at_a_joint_are_unresolved() -> None:
    rings = Strands.from_lengths([8, 8], closed=True)
    x0 = hopf(0.0).control_points[:, 0].copy()
    x0[8:] -= np.array([0.0, 0.0, 0.07])
    x1 = x0 + np.repeat([[0.0], [3.0]], 8, axis=0) * np.array([1.0, 0.0, 0.0])
    report = curve_step(spline_curve(x0, rings), spline_curve(x1, rings))
    assert report.verdict is Verdict.UNRESOLVED
    assert report.n_open > 0


def test_linked_rings_that_stay_linked_are_certified() -> None:
    report = curve_step(hopf(0.0), hopf(-0.3))
    assert report.verdict is Verdict.CERTIFIED
    assert report.clearance > 0.1


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_two_bars_pass_or_just_miss(degree: int) -> None:
    bars = np.array([[[-1, 0, 0], [1, 0, 0]], [[0, -1, 1], [0, 1, 1]]], dtype=float)
    u = np.linspace(0, 1, degree + 1)[None, :, None]
    points = (1 - u) * bars[:, :1] + u * bars[:, 1:]
    start = CompositeBezier.from_control_points(points, lengths=[1, 1])
    for drop, verdict in ((1.001, Verdict.CROSSING), (0.999, Verdict.CERTIFIED)):
        end = CompositeBezier.from_control_points(points - np.array([[[0, 0, 0]], [[0, 0, drop]]]), lengths=[1, 1])
        report = curve_step(start, end)
        assert report.verdict is verdict
        if verdict is Verdict.CROSSING:
            assert report.crossings[0].t == pytest.approx(1 / drop, rel=1e-12)
            assert report.crossings[0].sign == 1
            assert report.crossings[0].parameters == pytest.approx((0.5, 0.5), abs=1e-12)
        else:
            assert 0.0 < report.clearance <= 0.001


def random_step(rng: np.random.Generator) -> tuple[CompositeBezier, CompositeBezier]:
    strands = Strands.from_lengths([5, 5], closed=[bool(rng.integers(2)), bool(rng.integers(2))])
    x0 = np.cumsum(rng.normal(size=(10, 3)), axis=0)
    x1 = x0 + rng.normal(size=(10, 3)) * rng.choice([0.05, 0.3, 1.0])
    return spline_curve(x0, strands), spline_curve(x1, strands)


def sampled_least_distance(one: CompositeBezier, other: CompositeBezier) -> float:
    """Least distance of points of segments that share none, over a grid of times and parameters."""
    u = np.linspace(0, 1, 9)
    m, follows, least = one.n_segments, one.following, np.inf
    for t in np.linspace(0, 1, 9):
        x = (1 - t) * one.points(u) + t * other.points(u)
        for i in range(m):
            for j in range(i + 1, m):
                if follows[i] != j and follows[j] != i:
                    least = min(least, float(np.linalg.norm(x[i][:, None] - x[j][None], axis=2).min()))
    return least


def test_clearances_are_below_every_sampled_distance_and_crossings_meet() -> None:
    rng, verdicts = np.random.default_rng(4), []
    for _ in range(60):
        one, other = random_step(rng)
        report = curve_step(one, other)
        verdicts.append(report.verdict)
        if report.verdict is Verdict.CERTIFIED:
            assert report.clearance <= sampled_least_distance(one, other)
        for crossing in report.crossings:
            blend = (1 - crossing.t) * one.control_points + crossing.t * other.control_points
            both = CompositeBezier.from_control_points(blend[list(crossing.segments)], lengths=[1, 1])
            x = [both.points([w])[k, 0] for k, w in enumerate(crossing.parameters)]
            np.testing.assert_allclose(x[0], x[1], atol=1e-10)
    assert {Verdict.CERTIFIED, Verdict.CROSSING} <= set(verdicts)
    assert verdicts.count(Verdict.UNRESOLVED) <= 2


def test_time_reversal_keeps_the_verdict_and_turns_the_signs() -> None:
    rng, seen = np.random.default_rng(6), 0
    for _ in range(15):
        one, other = random_step(rng)
        there, back = curve_step(one, other), curve_step(other, one)
        assert there.verdict is back.verdict
        ways = zip(there.crossings, reversed(back.crossings), strict=True)
        for first, second in ways:
            seen += 1
            assert first.t == pytest.approx(1 - second.t, abs=1e-9)
            assert first.sign == -second.sign
    assert seen > 3


def test_a_moved_and_turned_motion_has_the_same_crossings() -> None:
    rng = np.random.default_rng(8)
    one, other = random_step(rng)
    while not curve_step(one, other).crossings:
        one, other = random_step(rng)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = [
        CompositeBezier(c.control_points @ turn.T + [5.0, -7.0, 11.0], c.offsets, c.closed, error=1e-12)
        for c in (one, other)
    ]
    for c in moved:  # rounding may part the joints
        here = np.flatnonzero(c.following >= 0)
        assert (c.control_points[here, -1] == c.control_points[c.following[here], 0]).all()
    before, after = curve_step(one, other), curve_step(*moved)
    assert [c.sign for c in after.crossings] == [c.sign for c in before.crossings]
    assert [c.t for c in after.crossings] == pytest.approx([c.t for c in before.crossings], abs=1e-9)


# --- short rings, bad input -------------------------------------------------------------------------------------------


def test_a_ring_of_two_segments_is_answered() -> None:
    halves = np.array([[[0, 0, 0], [0, 2, 0], [2, 2, 0], [2, 0, 0]], [[2, 0, 0], [2, -2, 0], [0, -2, 0], [0, 0, 0]]])
    assert curve_embedding(CompositeBezier.from_control_points(halves, closed=True)).verdict is Verdict.CERTIFIED
    there_and_back = np.stack([halves[0], halves[0, ::-1]])
    folded = curve_embedding(CompositeBezier.from_control_points(there_and_back, closed=True))
    assert folded.verdict is Verdict.UNRESOLVED


def test_a_fold_by_half_a_turn_is_unresolved() -> None:
    x = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], dtype=float)
    straight = CompositeBezier.from_control_points(np.stack([x[:2], x[1:]]))
    report = curve_embedding(straight)
    assert report.verdict is Verdict.UNRESOLVED
    assert report.rung is Rung.OPEN


def test_curves_that_do_not_fit_are_refused() -> None:
    one, other = curves(CASES["T3"])
    with pytest.raises(InputError, match="same segments"):
        curve_step(one, hopf(0.0))
    closed = CompositeBezier.from_control_points(CASES["T9"].floats[0], closed=True)
    opened = CompositeBezier.from_control_points(CASES["T9"].floats[0])
    with pytest.raises(InputError, match="different strands"):
        curve_step(closed, opened)
    assert curve_step(one, other).n_open == 1
