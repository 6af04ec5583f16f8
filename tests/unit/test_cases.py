"""The exact cases: the files obey their schema, and what they expect is true."""

import copy
import json
from fractions import Fraction
from itertools import pairwise
from math import comb, isqrt
from typing import Any

import cases
import jsonschema
import numpy as np
import oracles
import pytest
from numpy.typing import NDArray
from oracles.exact import dot, minus
from oracles.polynomials import sign_at, unit_roots

FILES = ["polylines", "curves", "tubes"]
POLYLINES = cases.polyline_cases()
CURVES = cases.curve_cases()
TUBES = cases.tube_cases()
ROUND_TUBES = [case for case in TUBES.values() if "radius" in case.expect]


def read(name: str) -> Any:
    return json.loads((cases.FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def expecting(key: str) -> pytest.MarkDecorator:
    chosen = [case for case in POLYLINES.values() if key in case.expect]
    assert chosen
    return pytest.mark.parametrize("case", chosen, ids=lambda case: case.id)


def greatest_square(x0: cases.ExactPoints, x1: cases.ExactPoints) -> Fraction:
    moves = [minus(q, p) for p, q in zip(x0, x1, strict=True)]
    return max(dot(move, move) for move in moves)


@pytest.mark.parametrize("name", FILES)
def test_file_obeys_the_schema(name: str) -> None:
    jsonschema.validate(read(name), read("schema"))


def test_every_case_is_there_once() -> None:
    ids = {name: [case["id"] for case in read(name)["cases"]] for name in FILES}
    assert all(len(set(some)) == len(some) for some in ids.values())
    numbers = {int(i.strip("Tabcde")) for some in ids.values() for i in some}
    assert numbers == set(range(1, 13))


@pytest.mark.parametrize("value", [0.5, "0.5", "1/0", "01", "1/2 ", "sqrt(2)", None])
def test_schema_refuses_a_coordinate_that_is_not_rational(value: Any) -> None:
    broken = copy.deepcopy(read("polylines"))
    broken["cases"][0]["strands"][0]["vertices_t0"][0][0] = value
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, read("schema"))


@pytest.mark.parametrize("case", POLYLINES.values(), ids=lambda case: case.id)
def test_displacement_of_a_polyline(case: cases.PolylineCase) -> None:
    assert greatest_square(case.x0, case.x1) == case.expect["squared_displacement_max"]


@pytest.mark.parametrize("case", POLYLINES.values(), ids=lambda case: case.id)
def test_crossings_of_a_polyline(case: cases.PolylineCase) -> None:
    found = oracles.passages(case.x0, case.x1, case.offsets, case.closed).events
    expected = [
        oracles.Event(event["t"], event["t"], event["s"], event["r"], event["sign"], *map(tuple, event["edges"]))
        for event in case.expect["events"]
    ]
    assert list(found) == expected


@expecting("contacts")
def test_contacts_of_a_polyline(case: cases.PolylineCase) -> None:
    found = oracles.passages(case.x0, case.x1, case.offsets, case.closed).contacts
    expected = [
        oracles.Contact(*contact["t"], contact["reason"], *map(tuple, contact["members"]))
        for contact in case.expect["contacts"]
    ]
    assert list(found) == expected


@expecting("contact_times")
def test_contact_times_of_a_polyline(case: cases.PolylineCase) -> None:
    found = oracles.passages(case.x0, case.x1, case.offsets, case.closed).contacts
    times = {t for contact in found for t in (contact.t_low, contact.t_high)}
    assert sorted(times) == case.expect["contact_times"]


@expecting("squared_nu_t0")
def test_nu_of_a_polyline_at_the_start(case: cases.PolylineCase) -> None:
    expected = float(case.expect["squared_nu_t0"]) ** 0.5
    assert oracles.nu(case.floats[0], case.offsets, case.closed).value == pytest.approx(expected, rel=1e-14)


@expecting("squared_nu_t1")
def test_nu_of_a_polyline_at_the_end(case: cases.PolylineCase) -> None:
    expected = float(case.expect["squared_nu_t1"]) ** 0.5
    # 1e-12 absolute: the near miss T5b leaves 1/5000 between coordinates of size 1, rounded to floats
    assert oracles.nu(case.floats[1], case.offsets, case.closed).value == pytest.approx(expected, abs=1e-12)


@expecting("knot_determinants")
def test_knot_determinants_of_a_polyline(case: cases.PolylineCase) -> None:
    found = [oracles.knot_determinant(x) for x in (case.x0, case.x1)]
    assert found == case.expect["knot_determinants"]


@expecting("rotation")
def test_rotation_of_a_polyline(case: cases.PolylineCase) -> None:
    rotation = case.expect["rotation"]
    assert [[dot(row, p) for row in rotation] for p in case.x0] == case.x1
    assert [[dot(p, q) for q in rotation] for p in rotation] == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    # x1 is superposed on x0, which is the way back
    back = oracles.best_rotation(*case.floats)
    np.testing.assert_allclose(back, np.array(rotation, dtype=np.float64).T, atol=1e-14)


@expecting("squared_vertex_edge_separation_t0")
def test_vertices_and_edges_alone_miss_a_skew_pair(case: cases.PolylineCase) -> None:
    first, second = case.x0[0:2], case.x0[5:7]
    ends = [(p, p, *second) for p in first] + [(p, p, *first) for p in second]
    least = min(oracles.squared_edge_distance_exact(*four) for four in ends)
    assert least == case.expect["squared_vertex_edge_separation_t0"]


@expecting("squared_non_adjacent_separation_t0")
def test_non_adjacent_edges_alone_miss_a_free_end(case: cases.PolylineCase) -> None:
    least = oracles.squared_edge_distance_exact(*case.x0)
    assert least == case.expect["squared_non_adjacent_separation_t0"]


def test_separating_edges_pass_with_two_frames_and_fail_with_one() -> None:
    case = POLYLINES["T7"]
    (a0, b0, c0, d0), (a1, b1, c1, d1) = case.x0, case.x1
    rho = case.expect["relative_displacement"]
    corners0 = [minus(p, q) for p in (a0, b0) for q in (c0, d0)]
    corners1 = [minus(p, q) for p in (a1, b1) for q in (c1, d1)]
    assert greatest_square(corners0, corners1) == rho**2
    distances = [Fraction(1, 10), Fraction(6, 5)]
    assert [d * d for d in distances] == [case.expect["squared_nu_t0"], case.expect["squared_nu_t1"]]
    assert distances[0] <= rho < sum(distances)
    low, high = oracles.least_distance_during([[a0, b0], [c0, d0]], [[a1, b1], [c1, d1]])
    assert low - 1e-15 <= case.expect["clearance"] <= high + 1e-15
    assert high - low <= 1e-6


def differences(points: cases.ExactPoints) -> cases.ExactPoints:
    return [minus(q, p) for p, q in pairwise(points)]


def blended(case: cases.CurveCase, t: Fraction) -> cases.ExactPoints:
    return [[(1 - t) * x + t * y for x, y in zip(p, q, strict=True)] for p, q in zip(case.p0, case.p1, strict=True)]


def curve_point(points: Any, u: Any) -> list[Any]:
    n = len(points) - 1
    weights = [comb(n, i) * u**i * (1 - u) ** (n - i) for i in range(n + 1)]
    return [dot(weights, axis) for axis in zip(*points, strict=True)]


@pytest.mark.parametrize("name", ["T2", "T3", "T4"])
def test_d_star_of_a_curve(name: str) -> None:
    case = CURVES[name]
    hodograph = differences(case.p0)
    assert oracles.squared_hull_distance_exact(hodograph) == case.expect["squared_d_star_t0"]
    expected = float(case.expect["squared_d_star_t0"]) ** 0.5
    assert oracles.hull_distance(np.array(hodograph, dtype=np.float64)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("name", ["T3", "T4"])
def test_a_curve_meets_itself_within_the_printed_bound(name: str) -> None:
    case = CURVES[name]
    point = case.expect["double_point_t1"]["point"]
    assert [curve_point(case.p1, u) for u in case.expect["double_point_t1"]["parameters"]] == [point, point]
    assert greatest_square(case.p0, case.p1) == case.expect["squared_displacement_max"]
    assert case.expect["squared_displacement_max"] < case.expect["squared_d_star_t0"]


def test_differences_move_twice_as_far_as_control_points() -> None:
    case = CURVES["T3"]
    found = greatest_square(differences(case.p0), differences(case.p1))
    assert found == case.expect["squared_hodograph_displacement_max"]
    assert found == 4 * case.expect["squared_displacement_max"]


def test_hull_condition_fails_before_the_cusp() -> None:
    case = CURVES["T2"]
    t, little = case.expect["hull_condition_fails_t"], Fraction(1, 10**9)
    assert oracles.squared_hull_distance_exact(differences(blended(case, t))) == 0
    assert oracles.squared_hull_distance_exact(differences(blended(case, t - little))) > 0
    cusp = case.expect["cusp"]
    assert cusp["t"] > t
    at_cusp = blended(case, cusp["t"])
    assert curve_point(differences(at_cusp), cusp["u"]) == [0, 0]
    assert curve_point(at_cusp, cusp["u"]) == cusp["point"]


def test_cubic_has_a_loop_after_the_cusp() -> None:
    case = CURVES["T2"]
    c, b, a = case.expect["double_point_t1"]["polynomial"]
    roots = unit_roots([c, b, a])
    assert len(roots) == 2
    # with u + v = -b/a and uv = c/a, (B(u) - B(v))/(u - v) is zero
    for axis in zip(*case.p1, strict=True):
        powers = [axis[0], 3 * (axis[1] - axis[0]), 3 * (axis[0] - 2 * axis[1] + axis[2])]
        powers.append(axis[3] - 3 * axis[2] + 3 * axis[1] - axis[0])
        u_plus_v, uv = -b / a, c / a
        assert powers[1] + powers[2] * u_plus_v + powers[3] * (u_plus_v**2 - uv) == 0
    assert [sign_at([Fraction(-1, 2), Fraction(1)], root) for root in roots] == [-1, 1]


def test_a_curve_crosses_while_its_polygon_does_not() -> None:
    case = CURVES["T9"]
    p0, p1 = case.floats
    passage = case.expect["passage"]
    at_passage = (1 - passage["t"]) * p0 + passage["t"] * p1
    u, v = (np.array(curve_point(at_passage, passage[key])) for key in ("u", "v"))
    np.testing.assert_allclose(u, v, atol=1e-6)
    fine = np.arange(60) / 60
    found = [oracles.knot_determinant([curve_point(p, s) for s in fine]) for p in (p0, p1)]
    assert found == case.expect["knot_determinants"]
    assert case.p0[:-1] == POLYLINES["T9"].x0
    assert case.p1[:-1] == POLYLINES["T9"].x1


@pytest.mark.parametrize("case", ROUND_TUBES, ids=lambda case: case.name)
def test_radius_is_the_lesser_bound(case: cases.TubeCase) -> None:
    expect = case.expect
    least = min(expect["inverse_kappa_max"], expect["self_distance"] / 2)
    assert float(expect["radius"]) == pytest.approx(float(least), abs=1e-8)


def test_curvature_and_self_distance_of_the_trefoil() -> None:
    x = np.linspace(0, 2 * np.pi, 20001)
    velocity = np.stack([np.cos(x) + 4 * np.cos(2 * x), -np.sin(x) + 4 * np.sin(2 * x), -3 * np.cos(3 * x)], 1)
    bend = np.stack([-np.sin(x) - 8 * np.sin(2 * x), -np.cos(x) + 8 * np.cos(2 * x), 9 * np.sin(3 * x)], 1)
    kappa = np.linalg.norm(np.cross(velocity, bend), axis=1) / np.linalg.norm(velocity, axis=1) ** 3
    expect = TUBES["T11c"].expect
    assert 1 / kappa.max() == pytest.approx(expect["inverse_kappa_max"], abs=1e-6)
    assert least_chord(trefoil(x[::10])) == pytest.approx(expect["self_distance"], abs=3e-5)


def trefoil(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.sin(x) + 2 * np.sin(2 * x), np.cos(x) - 2 * np.cos(2 * x), -np.sin(3 * x)], axis=1)


def least_chord(points: NDArray[np.float64]) -> float:
    """The least chord of a sampled closed curve between points more than a tenth of the curve apart."""
    p, n = points[:-1], len(points) - 1
    return min(float(np.linalg.norm(p - np.roll(p, k, axis=0), axis=1).min()) for k in range(n // 10, n // 2))


def test_self_distance_of_the_helix() -> None:
    expect = TUBES["T11d"].expect
    d = np.linspace(np.pi, 6 * np.pi, 200001)  # a chord depends on d alone
    chord = np.sqrt(2 - 2 * np.cos(d) + d * d / 100)
    assert chord.min() == pytest.approx(expect["self_distance"], abs=1e-9)
    assert expect["inverse_kappa_max"] == pytest.approx(1 + 0.1**2)


def test_end_body_distance_of_the_rational_quartic() -> None:
    case = TUBES["T11e"]
    p, w = np.array(case.control_points, dtype=np.float64), np.array(case.weights, dtype=np.float64)
    u = np.linspace(0, 0.5, 500001)[:, None]
    basis = np.concatenate([comb(4, i) * u**i * (1 - u) ** (4 - i) for i in range(5)], axis=1) * w
    distance = np.linalg.norm(basis @ p / basis.sum(axis=1, keepdims=True) - p[-1], axis=1)
    assert distance.min() == pytest.approx(case.expect["end_body_distance"], abs=1e-7)
    assert u[distance.argmin(), 0] == pytest.approx(case.expect["end_body_parameter"], abs=1e-6)


def test_strings_become_fractions_and_nothing_else_does() -> None:
    assert POLYLINES["T1"].expect["events"][0]["t"] == Fraction(59, 95)
    assert isqrt(int(POLYLINES["T1"].expect["squared_displacement_max"])) == 5
    assert TUBES["T11d"].expect["inverse_kappa_max"] == 1.01
    assert isinstance(TUBES["T11a"].expect["radius"], Fraction)
