"""Crossings of a step: images, points and signs in any cell, grades, and the reasons of what stays undecided."""

import time
from itertools import product
from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import mdtopo.measure
from mdtopo import polyline_step
from mdtopo.records import Crossing, Grade, MonitorConfig, Reason, Rung, Scope, StepReport, Strands, Verdict

Points = NDArray[np.float64]
Counts = NDArray[np.int64]

LAB, RIGID = MonitorConfig(motion="lab"), MonitorConfig(motion="rigid")
BARS = Strands.from_lengths([2, 2])
IMAGES = list(product((-1, 0, 1), repeat=3))

CELLS = {
    "cube": 10.0 * np.eye(3),
    "triclinic": np.array([[10.0, 0, 0], [3, 9, 0], [-2, 1, 11]]),
    "skewed": np.array([[10.0, 0, 0], [31, 9, 0], [-22, 40, 11]]),
    "left-handed": np.array([[0, 10.0, 0], [9, 1, 0], [1, -2, 11]]),
}


def lab_step(x0: Any, x1: Any, strands: Strands = BARS, **knobs: Any) -> StepReport:
    config = MonitorConfig(motion="lab", **knobs)
    return polyline_step(np.array(x0, dtype=float), np.array(x1, dtype=float), strands, config=config)


def only(report: StepReport) -> Crossing:
    assert (report.verdict, report.reason, report.rung) == (Verdict.CROSSING, Reason.NONE, Rung.EXACT)
    (crossing,) = report.crossings
    return crossing


# --- two bars in a cell -----------------------------------------------------------------------------------------------


def crossed(cell: Points) -> tuple[Points, Points]:
    """A bar along x and one along y in the middle of a cell, which pass at t = 0.7; their centroid rests.

    They meet at 0.3 of the first bar and 0.6 of the second.
    """
    middle = 0.5 * cell.sum(axis=0)
    first = np.array([[-0.6, 0, 0], [1.4, 0, 0]])
    second = np.array([[0, -1.2, 0], [0, 0.8, 0]])
    height = np.array([0, 0, 0.5])
    x0 = np.concatenate([first + 0.7 * height, second - 0.7 * height])
    x1 = np.concatenate([first - 0.3 * height, second + 0.3 * height])
    return middle + x0, middle + x1


def meeting_point(crossing: Crossing, x0: Points, x1: Points) -> Points:
    """Return the point of the first edge, as these coordinates have it."""
    (a, b), t, s = crossing.edges[0], crossing.t, crossing.parameters[0]
    x = (1 - t) * x0 + t * x1
    result: Points = (1 - s) * x[a] + s * x[b]
    return result


@pytest.mark.parametrize("config", [LAB, RIGID], ids=["lab", "rigid"])
@pytest.mark.parametrize("cell", CELLS)
def test_a_bar_passes_through_another_in_whatever_image_it_is_stored(cell: str, config: MonitorConfig) -> None:
    h = CELLS[cell]
    x0, x1 = crossed(h)
    for image in IMAGES:
        away = np.array(image) @ h
        stored0, stored1 = x0.copy(), x1.copy()
        stored0[2:] -= away
        stored1[2:] -= away
        crossing = only(polyline_step(stored0, stored1, BARS, cell_t0=h, cell_t1=h, config=config))
        assert crossing.image.tolist() == list(image)
        assert crossing.edges.tolist() == [[0, 1], [2, 3]]
        assert crossing.t == pytest.approx(0.7, abs=1e-12)
        assert crossing.parameters == pytest.approx([0.3, 0.6], abs=1e-12)
        assert crossing.point == pytest.approx(0.5 * h.sum(axis=0), abs=1e-11)
        assert crossing.sign == only(lab_step(x0, x1)).sign
        assert crossing.strands == ("strand 0", "strand 1")


@pytest.mark.parametrize("config", [LAB, RIGID], ids=["lab", "rigid"])
@given(seed=st.integers(0, 2**32 - 1), cell=st.sampled_from(sorted(CELLS)))
@settings(max_examples=25)
def test_image_and_point_are_those_of_vertices_that_are_wrapped_one_by_one(
    seed: int, cell: str, config: MonitorConfig
) -> None:
    h, rng = CELLS[cell], np.random.default_rng(seed)
    x0, x1 = crossed(h)
    n0, n1 = rng.integers(-2, 3, (2, 4, 3))
    report = polyline_step(x0 + n0 @ h, x1 + n1 @ h, BARS, cell_t0=h, cell_t1=h, config=config)
    crossing = only(report)
    # the whole second edge meets the whole first one; their tails are stored n0 away
    assert crossing.image.tolist() == (n0[0] - n0[2]).tolist()
    expected = 0.5 * h.sum(axis=0) + n0[0] @ h
    assert crossing.point == pytest.approx(expected, abs=1e-10)
    modulo = np.linalg.solve(h.T, crossing.point - meeting_point(crossing, x0, x1))
    assert modulo == pytest.approx(np.rint(modulo), abs=1e-10)


def test_the_point_is_on_the_first_edge_at_the_time_and_parameter_that_are_told() -> None:
    x0 = np.array([[-1, 0, 0], [2, 0, 1], [0, -1, 2], [0.5, 2, 3.0]])
    x1 = np.array([[-1, 1, 0], [2, 0, 3], [0, -1, -2], [0.5, 2, -1.0]])
    crossing = only(lab_step(x0, x1))
    assert crossing.point == pytest.approx(meeting_point(crossing, x0, x1), abs=1e-13)
    (event,) = oracles.pair_passages(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3)).events
    assert crossing.t == pytest.approx(event.t, abs=1e-12)
    assert crossing.parameters == pytest.approx([float(event.s), float(event.r)], abs=1e-12)
    assert crossing.sign == event.sign


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("image", [(0, 0, 0), (1, 0, -1), (0, -1, 1)])
def test_the_sign_flips_in_reversed_time_in_a_mirror_and_with_one_edge(cell: str, image: tuple[int, int, int]) -> None:
    h = CELLS[cell]
    x0, x1 = crossed(h)
    x0[2:] -= np.array(image) @ h
    x1[2:] -= np.array(image) @ h
    there = only(polyline_step(x0, x1, BARS, cell_t0=h, cell_t1=h, config=LAB))
    back = only(polyline_step(x1, x0, BARS, cell_t0=h, cell_t1=h, config=LAB))
    assert (back.sign, back.image.tolist()) == (-there.sign, there.image.tolist())
    assert back.t == pytest.approx(1 - there.t, abs=1e-12)
    assert back.point == pytest.approx(there.point, abs=1e-10)
    mirror = np.array([1.0, -1, 1])
    mirrored = only(polyline_step(x0 * mirror, x1 * mirror, BARS, cell_t0=h * mirror, cell_t1=h * mirror, config=LAB))
    assert (mirrored.sign, mirrored.image.tolist()) == (-there.sign, there.image.tolist())
    assert mirrored.point == pytest.approx(there.point * mirror, abs=1e-10)
    turned = [0, 1, 3, 2]
    other = only(polyline_step(x0[turned], x1[turned], BARS, cell_t0=h, cell_t1=h, config=LAB))
    assert (other.sign, other.image.tolist()) == (-there.sign, there.image.tolist())
    assert other.parameters == pytest.approx([there.parameters[0], 1 - there.parameters[1]], abs=1e-12)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("image", [(0, 0, 0), (1, 0, -1), (0, -1, 1)])
def test_strands_that_change_places_make_the_same_crossing_with_the_opposite_image(
    cell: str, image: tuple[int, int, int]
) -> None:
    h, away = CELLS[cell], np.array(image) @ CELLS[cell]
    x0, x1 = crossed(h)
    x0[2:] -= away
    x1[2:] -= away
    swap = [2, 3, 0, 1]
    one = only(polyline_step(x0, x1, BARS, cell_t0=h, cell_t1=h, config=LAB))
    other = only(polyline_step(x0[swap], x1[swap], BARS, cell_t0=h, cell_t1=h, config=LAB))
    assert other.image.tolist() == (-one.image).tolist()
    assert (other.sign, other.edges.tolist()) == (one.sign, [[0, 1], [2, 3]])
    assert other.t == pytest.approx(one.t, abs=1e-12)
    assert other.parameters == pytest.approx(one.parameters[::-1], abs=1e-12)
    assert other.point == pytest.approx(one.point - away, abs=1e-10)
    assert (other.motion, other.resolution) == pytest.approx((one.motion, one.resolution))


def hook() -> tuple[Points, Points]:
    """A strand whose last edge rises and passes, at t = 0.7, through the image of its first one above it."""
    x0 = np.array([[4, 5, 0.5], [6, 5, 0.5], [8, 5, 2], [8, 5, 4.5], [8, 4, 7], [5, 4, 9.8], [5, 6, 9.8]])
    x1 = x0.copy()
    x1[5:, 2] = 10.8
    return x0, x1


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_strand_passes_through_its_own_image(wrapped: bool) -> None:
    h, (x0, x1) = CELLS["cube"], hook()
    n0 = np.zeros((7, 3), dtype=np.int64)
    if wrapped:
        n0[[0, 5, 6]] = [[1, 0, 0], [0, 0, -1], [0, 2, 0]]
    crossing = only(polyline_step(x0 + n0 @ h, x1, Strands.from_lengths([7]), cell_t0=h, cell_t1=h, config=LAB))
    assert crossing.edges.tolist() == [[0, 1], [5, 6]]
    assert crossing.image.tolist() == (np.array([0, 0, -1]) + n0[0] - n0[5]).tolist()
    assert crossing.t == pytest.approx(0.7, abs=1e-12)
    assert crossing.point == pytest.approx(np.array([5, 5, 0.5]) + n0[0] @ h, abs=1e-11)
    assert crossing.strands == ("strand 0", "strand 0")


LITTLE = 2.0**-48


@pytest.mark.parametrize("cell", ["cube", "leaning"])
@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize(
    ("start", "verdict", "reason"),
    [
        (5.0, Verdict.UNRESOLVED, Reason.VERTEX),
        (5.0 - LITTLE, Verdict.CROSSING, Reason.NONE),
        (5.0 + LITTLE, Verdict.CERTIFIED, Reason.NONE),
    ],
)
def test_exact_arithmetic_knows_the_image_and_the_cell_as_it_is_stored(
    start: float, verdict: Verdict, reason: Reason, wrapped: bool, cell: str
) -> None:
    # the image of the first edge begins where the last one passes, closer than rounding in a cell can tell
    h = {"cube": CELLS["cube"], "leaning": np.array([[10.0, 0, 0], [0, 10, 0], [0, 30, 10]])}[cell]
    x0, x1 = hook()
    x0[0, 0] = x1[0, 0] = start
    if wrapped:
        x0[[0, 6], 1] += [10.0, -20.0]
        x1[5, 2] -= 10.0
    report = polyline_step(x0, x1, Strands.from_lengths([7]), cell_t0=h, cell_t1=h, config=LAB)
    assert (report.verdict, report.reason) == (verdict, reason)
    assert report.rung is (Rung.OPEN if verdict is Verdict.UNRESOLVED else Rung.EXACT)
    assert report.clearance == 0.0
    if verdict is Verdict.CROSSING:
        assert report.crossings.image[0] @ h == pytest.approx([0, 10.0 * wrapped, -10])
        assert report.crossings.point[0] == pytest.approx([5, 5 + 10.0 * wrapped, 0.5], abs=1e-11)
        assert report.crossings.t[0] == pytest.approx(0.7, abs=1e-12)


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_row_of_the_table_does_not_depend_on_which_edge_was_found_first(
    monkeypatch: pytest.MonkeyPatch, wrapped: bool
) -> None:
    h, (x0, x1) = CELLS["cube"], hook()
    h1 = np.diag([10.0, 10, 10.1])
    if wrapped:
        x0[5] -= 2.0 * h[0]
    make, given = mdtopo.measure.crossing_table, []

    def watched(*arguments: Any) -> Any:
        given.append(arguments)
        return make(*arguments)

    monkeypatch.setattr(mdtopo.measure, "crossing_table", watched)
    one = only(polyline_step(x0, x1, Strands.from_lengths([7]), cell_t0=h, cell_t1=h1, config=LAB))
    ((decided, step, *others),) = given
    row = decided.passages[0].copy()
    away = (1 - row[5]) * row[2:5] @ step.motion.cell0 + row[5] * row[2:5] @ step.motion.cell1
    row[[0, 1, 6, 7]] = row[[1, 0, 7, 6]]
    row[2:5] *= -1
    row[8:11] -= away  # on the other edge, in its home image
    (other,) = make(decided._replace(passages=row[np.newaxis]), step, *others)
    assert other.edges.tolist() == one.edges.tolist() == [[0, 1], [5, 6]]
    assert other.image.tolist() == one.image.tolist() == [2 * wrapped, 0, -1]
    assert other.parameters.tolist() == one.parameters.tolist()
    assert other.point == pytest.approx(one.point, abs=1e-11)
    assert (other.t, other.sign, other.motion) == (one.t, one.sign, one.motion)


def test_the_same_strand_without_a_cell_passes_through_nothing() -> None:
    assert lab_step(*hook(), Strands.from_lengths([7])).verdict is Verdict.CERTIFIED


# --- random motions against the oracle --------------------------------------------------------------------------------

LENGTHS, CLOSED = [9, 5], [False, True]
STRANDS = Strands.from_lengths(LENGTHS, closed=CLOSED)


def random_step(seed: int, edge: float, moving: bool) -> tuple[Points, Points, Points, Points]:
    """A random walk of eight unit bonds, longer than a small cell, and a ring near an image of it."""
    rng = np.random.default_rng(seed)
    cell0 = edge * (np.eye(3) + rng.uniform(-0.15, 0.15, size=(3, 3)))
    cell1 = cell0 @ (np.eye(3) + rng.normal(0, 0.02, (3, 3))) if moving else cell0
    bonds = rng.normal(size=(9, 3))
    walk = np.cumsum(bonds / np.linalg.norm(bonds, axis=1, keepdims=True), axis=0)
    angle = 2 * np.pi * np.arange(5) / 5
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * 0.8 + rng.normal(0, 0.1, (5, 3))
    ring += walk[4] + rng.normal(0, 0.5, 3) + rng.integers(-2, 3, 3) @ cell0
    x0 = np.concatenate([walk, ring])
    x1 = x0 @ np.linalg.inv(cell0) @ cell1 + rng.normal(0, 0.25, x0.shape)
    return x0, x1, cell0, cell1


def longest_edge(*frames: Points) -> float:
    tails, heads = STRANDS.edges.T
    return max(float(np.linalg.norm(x[heads] - x[tails], axis=1).max()) for x in frames)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("edge", [4.5, 6.0])
def test_crossings_in_a_cell_are_those_of_the_oracle(edge: float, moving: bool) -> None:
    n_found, images = 0, set()
    for seed in range(40):
        x0, x1, cell0, cell1 = random_step(seed, edge, moving)
        if longest_edge(x0, x1) > 0.4 * edge:  # it may be taken for an image of itself
            continue
        truth = oracles.passages(
            x0.tolist(), x1.tolist(), STRANDS.offsets, STRANDS.closed, cell0=cell0.tolist(), cell1=cell1.tolist()
        )
        rng = np.random.default_rng(seed)
        n0, n1 = rng.integers(-1, 2, (2, len(x0), 3))
        report = polyline_step(x0 + n0 @ cell0, x1 + n1 @ cell1, STRANDS, cell_t0=cell0, cell_t1=cell1, config=LAB)
        assert not truth.contacts
        assert report.n_crossings == len(report.crossings) == len(truth.events)
        assert report.verdict is (Verdict.CROSSING if truth.events else Verdict.CERTIFIED)
        left = list(truth.events)
        for crossing in report.crossings:
            event = min(left, key=lambda e: abs(e.t - crossing.t))
            left.remove(event)
            ordered = event.first < event.second
            first, second = (event.first, event.second) if ordered else (event.second, event.first)
            shift = np.array(event.shift) if ordered else -np.array(event.shift)
            places = (event.s, event.r) if ordered else (event.r, event.s)
            assert crossing.edges.tolist() == [list(first), list(second)]
            assert crossing.sign == event.sign
            assert crossing.t == pytest.approx(event.t, abs=1e-9)
            assert crossing.parameters == pytest.approx([float(p) for p in places], abs=1e-6)
            assert crossing.image.tolist() == (shift + n0[first[0]] - n0[second[0]]).tolist()
            images.add(tuple(shift.tolist()))
            if not moving:
                expected = meeting_point(crossing, x0, x1) + n0[first[0]] @ cell0
                assert crossing.point == pytest.approx(expected, abs=1e-8)
            n_found += 1
    assert n_found >= 10
    assert len(images) >= 3


def test_a_cell_that_grows_carries_the_image_along() -> None:
    # the image of the first bar moves away as the cell grows, and the second one overtakes it
    h0, h1 = np.diag([10.0, 10, 10]), np.diag([10.0, 10, 11])
    x0 = np.array([[4, 5, 0.5], [6, 5, 0.5], [5, 4, 9.5], [5, 6, 9.5]])
    x1 = x0.copy()
    x1[2:, 2] = 13.5
    crossing = only(polyline_step(x0, x1, BARS, cell_t0=h0, cell_t1=h1, config=LAB))
    # 9.5 + 4t = 10.5 + t
    assert crossing.t == pytest.approx(1 / 3, abs=1e-12)
    assert crossing.image.tolist() == [0, 0, -1]
    assert crossing.point == pytest.approx([5, 5, 0.5], abs=1e-11)
    x1[2:, 2] = 11.4
    assert polyline_step(x0, x1, BARS, cell_t0=h0, cell_t1=h1, config=LAB).verdict is Verdict.CERTIFIED
    assert polyline_step(x0, x1, BARS, cell_t0=h0, cell_t1=h0, config=LAB).verdict is Verdict.CROSSING


# --- several passages of a pair ---------------------------------------------------------------------------------------

THREE0 = np.array([[-1.0, 0, -2], [-4, -3, 1], [0, -3, 4], [-1, 0, 3]])
THREE1 = np.array([[-2.0, 1, 1], [2, 3, 3], [-1, 3, -2], [0, 1, 4]])


def test_three_passages_of_one_pair_are_listed_in_order_of_time() -> None:
    report = lab_step(THREE0, THREE1)
    assert (report.verdict, report.n_crossings, report.rung_pairs[Rung.EXACT]) == (Verdict.CROSSING, 3, 1)
    assert report.crossings.t == pytest.approx([3 / 5, 4 / 5, 5 / 6], abs=1e-9)
    events = oracles.pair_passages(THREE0.reshape(2, 2, 3), THREE1.reshape(2, 2, 3)).events
    assert report.crossings.sign.tolist() == [event.sign for event in events]
    assert report.crossings.sign[0] == -report.crossings.sign[1] == report.crossings.sign[2]


def test_pairs_that_pass_more_than_once_in_a_step_are_what_the_oracle_says() -> None:
    rng, several = np.random.default_rng(5), 0
    for _ in range(150):
        x0, x1 = rng.normal(size=(2, 4, 3)) * 3
        events = oracles.pair_passages(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3)).events
        report = lab_step(x0, x1)
        assert report.crossings.sign.tolist() == [event.sign for event in events]
        assert report.crossings.t == pytest.approx([event.t for event in events], abs=1e-9)
        several += len(events) > 1
    assert several >= 2


# --- what is undecided, and why ---------------------------------------------------------------------------------------

E = 1e-9


def lowered(z0: float, z1: float, x: float = 0.0, y: float = 0.0) -> tuple[Any, Any]:
    """A bar along y above one along x that rests, lowered from z0 to z1."""
    return tuple([[-1, 0, 0], [1, 0, 0], [x, y - 1, z], [x, y + 1, z]] for z in (z0, z1))  # type: ignore[return-value]


def rocked(height: float) -> tuple[Any, Any]:
    """f ~ height - (2t - 1)²/2: the first bar rocks about y, the second one slides over it along x."""
    return (
        [[-4, 0, 2], [4, 0, -2], [-1, -1, height], [-1, 1, height]],
        [[-4, 0, -2], [4, 0, 2], [1, -1, height], [1, 1, height]],
    )


def swept(z0: float, z1: float) -> tuple[Any, Any]:
    """A bar along y is moved along y over one along x: in one plane where both heights are 0."""
    bar = [[-1, 0, 0], [1, 0, 0]]
    return [*bar, [0, 1, z0], [0, 2, z0]], [*bar, [0, -2, z1], [0, -1, z1]]


def swung(along: float, across: float) -> tuple[Any, Any]:
    """A bar swings through the direction of the one along x while it moves along y; at t = 1/2 it lies on its line."""
    bar = [[-1, 0, 0], [1, 0, 0]]
    return (
        [*bar, [along - 1, across - 1, -1], [along + 1, across - 1, 1]],
        [*bar, [along - 1, across + 1, 1], [along + 1, across + 1, -1]],
    )


@pytest.mark.parametrize(
    ("motion", "reason"),
    [
        (rocked(0), Reason.TOUCH),
        (lowered(1, -2, x=1), Reason.VERTEX),
        (lowered(1, -2, x=-1), Reason.VERTEX),
        (lowered(1, -2, y=1), Reason.VERTEX),
        (lowered(1, -2, x=1, y=-1), Reason.VERTEX),
        (swept(0, 0), Reason.SLIDING),
        (swung(0, 0), Reason.SLIDING),
        (swung(2, 0), Reason.SLIDING),
        (lowered(1, 0), Reason.FRAME),
        (lowered(0, 1), Reason.FRAME),
        (lowered(0, -1), Reason.FRAME),
    ],
)
def test_a_contact_that_is_no_passage_is_undecided_and_says_why(motion: tuple[Any, Any], reason: Reason) -> None:
    report = lab_step(*motion)
    assert (report.verdict, report.reason, report.rung) == (Verdict.UNRESOLVED, reason, Rung.OPEN)
    assert (report.rung_pairs[Rung.OPEN], report.n_crossings, report.clearance) == (1, 0, 0.0)
    back = lab_step(*motion[::-1])
    assert (back.verdict, back.reason) == (Verdict.UNRESOLVED, reason)


@pytest.mark.parametrize(
    ("motion", "n_crossings"),
    [
        (rocked(E), 2),
        (rocked(-E), 0),
        (lowered(1, -2, x=1 - E), 1),
        (lowered(1, -2, x=1 + E), 0),
        (lowered(1, -2, x=-1 + E), 1),
        (lowered(1, -2, x=-1 - E), 0),
        (lowered(1, -2, y=1 - E), 1),
        (lowered(1, -2, y=1 + E), 0),
        (lowered(1, -2, x=1 - E, y=-1 + E), 1),
        (lowered(1, -2, x=1 - E, y=-1 - E), 0),
        (swept(E, E), 0),
        (swept(E, -E), 1),
        (swept(-E, -E), 0),
        (swung(0, E), 1),
        (swung(2 + E, E), 0),
        (lowered(1, E), 0),
        (lowered(1, -E), 1),
        (lowered(E, 1), 0),
        (lowered(-E, 1), 1),
    ],
)
def test_near_misses_of_these_contacts_are_decided(motion: tuple[Any, Any], n_crossings: int) -> None:
    report = lab_step(*motion)
    verdict = Verdict.CROSSING if n_crossings else Verdict.CERTIFIED
    assert (report.verdict, report.reason) == (verdict, Reason.NONE)
    assert (report.n_crossings, report.rung_pairs[Rung.OPEN]) == (n_crossings, 0)
    assert report.scope is (Scope.NONE if n_crossings else Scope.MOTION if report.clearance > 0.0 else Scope.STORED)
    assert lab_step(*motion[::-1]).n_crossings == n_crossings


FOUR = Strands.from_lengths([2, 2, 2, 2])


def far_along(motion: tuple[Any, Any]) -> tuple[Points, Points]:
    start, end = (np.array([50.0, 0, 0]) + x for x in motion)
    return start, end


@pytest.mark.parametrize("second", [rocked(0), lowered(1, -2, x=1), swept(0, 0), lowered(1, 0)])
def test_a_step_with_a_passage_is_a_crossing_whatever_else_is_undecided(second: tuple[Any, Any]) -> None:
    one, other = lowered(1, -2), far_along(second)
    report = lab_step(np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1]]), FOUR)
    assert (report.verdict, report.reason, report.n_crossings) == (Verdict.CROSSING, Reason.NONE, 1)
    assert report.rung_pairs[Rung.OPEN] == 1
    assert report.crossings[0].edges.tolist() == [[0, 1], [2, 3]]


@pytest.mark.parametrize(
    ("one", "other", "reason"),
    [
        (rocked(0), lowered(1, 0), Reason.FRAME),
        (lowered(1, -2, x=1), rocked(0), Reason.VERTEX),
        (swept(0, 0), rocked(0), Reason.TOUCH),
        (lowered(1, -2, x=1), lowered(1, 0), Reason.FRAME),
    ],
)
def test_of_several_reasons_the_worst_is_told(one: tuple[Any, Any], other: tuple[Any, Any], reason: Reason) -> None:
    for near, far in ((one, other), (other, one)):
        away = far_along(far)
        report = lab_step(np.concatenate([near[0], away[0]]), np.concatenate([near[1], away[1]]), FOUR)
        assert (report.verdict, report.reason, report.rung_pairs[Rung.OPEN]) == (Verdict.UNRESOLVED, reason, 2)


def meander(n: int, *, across: bool) -> Points:
    """A strand in the plane that runs n times to and fro along x, or along y."""
    points = []
    for k in range(n):
        row = [[-1.0, k, 0], [float(n), k, 0]]
        points += row if k % 2 == 0 else row[::-1]
    x = np.array(points)
    return x[:, [1, 0, 2]] if across else x


def grid(n: int) -> tuple[Points, Points, Strands]:
    """Two meanders that come to lie on each other in n² places, in the second frame."""
    x1 = np.concatenate([meander(n, across=False), meander(n, across=True)])
    x0 = x1.copy()
    x0[2 * n :, 2] = 3.0
    return x0, x1, Strands.from_lengths([2 * n, 2 * n])


def test_a_step_with_hundreds_of_undecided_pairs_is_given_up_soon() -> None:
    x0, x1, strands = grid(26)
    started = time.perf_counter()
    report = lab_step(x0, x1, strands)
    assert time.perf_counter() - started < 20.0
    assert (report.verdict, report.reason) == (Verdict.UNRESOLVED, Reason.LADDER)
    assert report.rung_pairs[Rung.OPEN] >= 26 * 26


def test_a_step_with_less_of_them_is_looked_at_in_full(monkeypatch: pytest.MonkeyPatch) -> None:
    x0, x1, strands = grid(5)
    report = lab_step(x0, x1, strands)
    n_open = int(report.rung_pairs[Rung.OPEN])
    assert (report.verdict, report.reason) == (Verdict.UNRESOLVED, Reason.FRAME)
    assert n_open >= 25
    monkeypatch.setattr("mdtopo.passages.MOST_EXACT", n_open)
    assert lab_step(x0, x1, strands).reason is Reason.FRAME
    monkeypatch.setattr("mdtopo.passages.MOST_EXACT", n_open - 1)
    short = lab_step(x0, x1, strands)
    assert (short.verdict, short.reason, short.rung_pairs[Rung.OPEN]) == (Verdict.UNRESOLVED, Reason.LADDER, n_open)


# --- grades, and tables of many steps ---------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", [lowered(1, -2), (THREE0, THREE1)])
def test_a_crossing_is_resolved_below_the_resolution_length_and_undersampled_from_it_on(
    motion: tuple[Any, Any],
) -> None:
    far = float(lab_step(*motion).crossings.motion[0])
    for length, grade in (
        (np.nextafter(far, np.inf), Grade.RESOLVED),
        (far, Grade.UNDERSAMPLED),
        (np.nextafter(far, 0.0), Grade.UNDERSAMPLED),
        (0.0, Grade.UNDERSAMPLED),
    ):
        report = lab_step(*motion, resolution_length=float(length))
        assert {crossing.grade for crossing in report.crossings} == {grade}
        assert (report.crossings.resolution == length).all()
        assert report.verdict is Verdict.CROSSING


@pytest.mark.parametrize(
    ("drop", "grade"), [(1.99, Grade.RESOLVED), (2.0, Grade.UNDERSAMPLED), (2.5, Grade.UNDERSAMPLED)]
)
def test_by_default_the_resolution_length_is_the_shorter_edge(drop: float, grade: Grade) -> None:
    # bars of 2 Å and, the second one, of 6 Å
    x0 = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -3, 0.5], [0, 3, 0.5]])
    x1 = x0 - np.array([[0, 0, 0], [0, 0, 0], [0, 0, drop], [0, 0, drop]])
    crossing = only(lab_step(x0, x1))
    assert (crossing.grade, crossing.resolution) == (grade, 2.0)
    assert crossing.motion == pytest.approx(drop, rel=1e-15)


@pytest.mark.parametrize("block_steps", [1, 3, 64])
@pytest.mark.parametrize("periodic", [False, True])
def test_crossings_of_a_run_are_in_order_and_know_their_step_and_frames(block_steps: int, periodic: bool) -> None:
    heights = [3.0, 1.0, -1.0, -2.0, 1.5, -0.5, -0.6, -3.0]  # passes in the steps 1, 3 and 4
    frames = np.array([lowered(z, z)[0] for z in heights], dtype=float)
    options = {"cell": 20.0 * np.eye(3)} if periodic else None
    config = MonitorConfig(motion="lab", block_steps=block_steps)
    reports = list(mdtopo.steps(frames, strands=BARS, config=config, reader_options=options))
    assert [report.n_crossings for report in reports] == [0, 1, 0, 1, 1, 0, 0]
    for report in reports:
        assert report.n_crossings == len(report.crossings)
        for crossing in report.crossings:
            assert (crossing.step, crossing.frame_t0, crossing.frame_t1) == (report.step, *report.frames)
    found = [reports[k].crossings[0] for k in (1, 3, 4)]
    assert [crossing.t for crossing in found] == pytest.approx([1 / 2, 2 / 3.5, 1.5 / 2])
    assert [crossing.sign for crossing in found] == [found[0].sign, -found[0].sign, found[0].sign]


def test_frames_that_are_left_out_keep_their_numbers() -> None:
    frames = np.array([lowered(z, z)[0] for z in (3.0, 0.1, -1.0, 0.1, 1.5, -0.5, 1.0)], dtype=float)
    reports = list(mdtopo.steps(frames, strands=BARS, config=LAB, frames=slice(0, None, 2)))
    found = [(c.step, c.frame_t0, c.frame_t1) for report in reports for c in report.crossings]
    assert found == [(0, 0, 2), (1, 2, 4)]


def test_crossings_of_one_step_are_in_order_of_time_whatever_the_order_of_the_strands() -> None:
    # bars above the first one fall at different speeds
    strands = Strands.from_lengths([2] * 5)
    speeds = [4.0, 1.6, 8.0, 2.5]
    x0 = np.array([[-9.0, 0, 0], [9, 0, 0], *([x, y, 1] for x in (-6, -2, 2, 6) for y in (-1, 1))])
    x1 = x0.copy()
    x1[2:, 2] -= np.repeat(speeds, 2)
    report = lab_step(x0, x1, strands)
    assert report.crossings.t == pytest.approx(sorted(1 / np.array(speeds)), abs=1e-12)
    assert report.crossings.edges[:, 1, 0].tolist() == [6, 2, 8, 4]


def test_the_point_lies_on_the_stored_edge_while_the_cell_grows() -> None:
    """The first of three strands stays where it is; the second is stored three cells above, and crosses the third."""
    x0 = np.array([[0, 0, 5], [1, 0, 5], [4, 5, 35.5], [6, 5, 35.5], [5, 4, 35], [5, 6, 35]])
    x1 = x0 + np.array([0, 0, 1]) * np.array([0, 0, 3, 3, 4, 4])[:, np.newaxis]
    cells = {"cell_t0": np.diag([10.0, 10, 10]), "cell_t1": np.diag([10.0, 10, 11])}
    strands = Strands.from_lengths([2, 2, 2])
    (crossing,) = polyline_step(x0, x1, strands, **cells, config=MonitorConfig(motion="lab")).crossings
    assert (crossing.t, crossing.edges.tolist()) == (pytest.approx(0.5), [[2, 3], [4, 5]])
    assert crossing.point == pytest.approx([5, 5, 37])
