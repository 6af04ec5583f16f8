"""What a certificate is about, and edges whose stored vector jumps between two frames."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mdtopo import polyline_step
from mdtopo.records import MonitorConfig, Reason, Scope, StepReport, Strands, Verdict
from mdtopo.spheres import PLACING_ERROR

Points = NDArray[np.float64]

LAB = MonitorConfig(motion="lab")
BARS = Strands.from_lengths([2, 2])


# --- scope ------------------------------------------------------------------------------------------------------------


def bars(gap: float, at: float = 0.0) -> Points:
    """A bar along x and, higher by the gap, one along y, at a place on the x axis."""
    return np.array([[at - 1, 0, 0], [at + 1, 0, 0], [at, -1, gap], [at, 1, gap]])


def rising(gap: float, config: MonitorConfig, *, at: float = 0.0, cell: Points | None = None) -> StepReport:
    """Return the step in which the upper bar rises by 0.1 Å."""
    end = bars(gap, at)
    end[2:, 2] += 0.1
    return polyline_step(bars(gap, at), end, BARS, cell_t0=cell, cell_t1=cell, config=config)


@pytest.mark.parametrize("motion", ["lab", "rigid"])
def test_a_clearance_above_twice_the_coordinate_error_is_one_of_the_motion(motion: str) -> None:
    clearance = rising(0.5, MonitorConfig(motion=motion)).clearance  # type: ignore[arg-type]
    assert clearance == pytest.approx(0.5, abs=1e-9)
    for factor, scope in ((1.0 - 1e-9, Scope.MOTION), (1.0 + 1e-9, Scope.STORED)):
        config = MonitorConfig(motion=motion, coordinate_error=0.5 * clearance * factor)  # type: ignore[arg-type]
        report = rising(0.5, config)
        assert (report.verdict, report.scope, report.clearance) == (Verdict.CERTIFIED, scope, clearance)


def test_without_rounding_the_limit_itself_belongs_to_the_stored_numbers() -> None:
    clearance = rising(0.5, LAB).clearance
    at = MonitorConfig(motion="lab", coordinate_error=0.5 * clearance)
    below = MonitorConfig(motion="lab", coordinate_error=np.nextafter(0.5 * clearance, 0.0))
    assert rising(0.5, at).scope is Scope.STORED
    assert rising(0.5, below).scope is Scope.MOTION


@pytest.mark.parametrize(("factor", "scope"), [(0.8, Scope.STORED), (1.2, Scope.MOTION)])
def test_the_rounding_of_turned_coordinates_joins_the_coordinate_error(factor: float, scope: Scope) -> None:
    far = 2.0**24
    gap = factor * 2.0 * PLACING_ERROR * far
    assert gap > 10 * np.spacing(far)
    rigid = rising(gap, MonitorConfig(motion="rigid"), at=far)
    assert (rigid.verdict, rigid.scope) == (Verdict.CERTIFIED, scope)
    assert rising(gap, LAB, at=far).scope is Scope.MOTION  # stored coordinates are not rounded


def test_the_rounding_of_turned_coordinates_adds_to_the_coordinate_error() -> None:
    far = 2.0**24
    rounding = PLACING_ERROR * far
    gap = 2.0 * (rounding + rounding)
    for error, scope in ((0.8 * rounding, Scope.MOTION), (1.2 * rounding, Scope.STORED)):
        assert rising(gap, MonitorConfig(motion="rigid", coordinate_error=error), at=far).scope is scope
        assert rising(gap, MonitorConfig(motion="lab", coordinate_error=error), at=far).scope is Scope.MOTION


def test_with_a_cell_the_rounding_of_placed_coordinates_joins_in_too() -> None:
    edge = 2.0**24
    # the greatest coordinate, and twice the sum of the lattice vectors
    rounding = PLACING_ERROR * (0.5 * edge + 1.0 + 2.0 * 3.0 * edge)
    scopes = []
    for gap in np.linspace(1.0, 8.0, 15) * rounding:
        report = rising(gap, LAB, at=0.5 * edge, cell=edge * np.eye(3))
        assert report.verdict is Verdict.CERTIFIED
        assert report.scope is (Scope.MOTION if report.clearance > 2.0 * rounding else Scope.STORED)
        assert rising(gap, LAB, at=0.5 * edge).scope is Scope.MOTION
        scopes.append(report.scope)
    assert scopes == sorted(scopes)
    assert set(scopes) == {Scope.STORED, Scope.MOTION}


def test_without_a_pair_there_is_nothing_to_hit() -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    report = polyline_step(x, x + 0.1, Strands.from_lengths([3]), config=MonitorConfig(coordinate_error=50.0))
    assert np.isnan(report.clearance)
    assert (report.verdict, report.scope) == (Verdict.CERTIFIED, Scope.MOTION)


@pytest.mark.parametrize("error", [None, 0.0, 1e-3])
def test_what_is_not_certified_has_no_scope(error: float | None) -> None:
    config = MonitorConfig(motion="lab", coordinate_error=error)
    passes = polyline_step(bars(1.0), bars(-1.0), BARS, config=config)
    assert (passes.verdict, passes.scope) == (Verdict.CROSSING, Scope.NONE)
    touches = polyline_step(bars(1.0), bars(0.0), BARS, config=config)
    assert (touches.verdict, touches.scope) == (Verdict.UNRESOLVED, Scope.NONE)
    misses = polyline_step(bars(1.0), bars(0.1), BARS, config=config)
    assert (misses.verdict, misses.scope) == (Verdict.CERTIFIED, Scope.MOTION)


# --- jumps that are repaired ------------------------------------------------------------------------------------------

CELLS = {
    "cube": 10.0 * np.eye(3),
    "triclinic": np.array([[10.0, 0, 0], [3, 9, 0], [-2, 1, 11]]),
    "skewed": np.array([[10.0, 0, 0], [31, 9, 0], [-22, 40, 11]]),
}
LENGTHS, CLOSED = [6, 4, 5], [False, True, False]
STRANDS = Strands.from_lengths(LENGTHS, closed=CLOSED)


def melt() -> Points:
    """Three strands with bonds of about 1 Å."""
    line = np.arange(6)[:, np.newaxis] * np.array([0.8, 0.5, 0.3])
    ring = np.array([[1.0, 5, -3], [2, 5, -3], [2, 6, -2.8], [1, 6, -3]])
    other = np.array([-3.0, 2.0, 3.0]) + np.arange(5)[:, np.newaxis] * np.array([0.1, -0.9, 0.4])
    return np.concatenate([line, ring, other])


def stepped(cell: Points, counts0: NDArray[np.int64], counts1: NDArray[np.int64]) -> StepReport:
    """Return the step of the melt, its vertices stored in images that counts tell, while it trembles."""
    x0 = melt()
    x1 = x0 + np.random.default_rng(1).normal(0.0, 0.02, x0.shape)
    stored0, stored1 = x0 + counts0 @ cell, x1 + counts1 @ cell
    return polyline_step(stored0, stored1, STRANDS, cell_t0=cell, cell_t1=cell, config=LAB)


def none() -> NDArray[np.int64]:
    return np.zeros((STRANDS.n_vertices, 3), dtype=np.int64)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(
    ("vertices", "jumps"),
    [
        ([], 0),
        ([0], 1),  # an open end
        ([2], 2),
        ([2, 3], 2),
        ([1, 3], 4),
        ([6], 2),  # of a ring
        ([6, 8], 4),
        ([0, 1, 2], 1),
        ([14, 9], 3),
        ([0, 1, 2, 3, 4, 5], 0),  # a whole strand
        ([6, 7, 8, 9], 0),
    ],
)
@pytest.mark.parametrize("by", [(1, 0, 0), (0, -2, 1)])
def test_edges_are_counted_whose_vertices_are_wrapped_one_by_one(
    cell: str, vertices: list[int], jumps: int, by: tuple[int, int, int]
) -> None:
    counts = none()
    counts[vertices] = by
    still = stepped(CELLS[cell], none(), none())
    for first, second in ((none(), counts), (counts, none())):
        report = stepped(CELLS[cell], first, second)
        assert report.image_jumps == jumps
        assert report.verdict is still.verdict is Verdict.CERTIFIED
        assert report.nu == pytest.approx(still.nu, rel=1e-9)
        assert report.displacement_max == pytest.approx(still.displacement_max, rel=1e-6)
    assert stepped(CELLS[cell], counts, counts).image_jumps == 0


@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(CELLS)))
@settings(max_examples=30)
def test_an_edge_jumps_where_its_two_vertices_are_wrapped_differently(seed: int, cell: str) -> None:
    rng = np.random.default_rng(seed)
    counts = rng.integers(-1, 2, (2, STRANDS.n_vertices, 3))
    counts[1] = np.where(rng.random((STRANDS.n_vertices, 1)) < 0.5, counts[0], counts[1])
    tails, heads = STRANDS.edges.T
    vectors = counts[:, heads] - counts[:, tails]
    expected = (vectors[0] != vectors[1]).any(axis=1).sum()
    report = stepped(CELLS[cell], counts[0], counts[1])
    assert report.image_jumps == expected
    assert report.verdict is Verdict.CERTIFIED


def test_without_a_cell_nothing_jumps() -> None:
    x = melt()
    moved = x + 10.0
    assert polyline_step(x, moved, STRANDS).image_jumps == 0


FLIPS = [
    np.array([[1, 0, 0], [1, 1, 0], [0, 0, 1]]),
    np.array([[1, 0, 0], [-1, 1, 0], [1, -1, 1]]),
    np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    -np.eye(3, dtype=np.int64),
]


@pytest.mark.parametrize("flip", range(len(FLIPS)))
@pytest.mark.parametrize("cell", CELLS)
def test_a_cell_that_flips_to_an_equivalent_one_makes_no_jump(flip: int, cell: str) -> None:
    cell0 = CELLS[cell]
    cell1 = FLIPS[flip] @ cell0
    rng = np.random.default_rng(flip)
    counts = rng.integers(-1, 2, (STRANDS.n_vertices, 3))
    x0 = melt() + counts @ cell0
    report = polyline_step(x0, x0, STRANDS, cell_t0=cell0, cell_t1=cell1, config=LAB)
    assert (report.image_jumps, report.verdict, report.displacement_max) == (0, Verdict.CERTIFIED, 0.0)
    wrapped = x0.copy()
    wrapped[3] += cell1[1]
    report = polyline_step(x0, wrapped, STRANDS, cell_t0=cell0, cell_t1=cell1, config=LAB)
    assert (report.image_jumps, report.verdict) == (2, Verdict.CERTIFIED)
    assert report.displacement_max < 1e-12


# --- jumps that nobody can repair -------------------------------------------------------------------------------------

BOX = 10.0 * np.eye(3)


def long_edge(length: float) -> Points:
    """Five vertices of which the edge from 2 to 3 has a length along x; each other one is 1 Å."""
    return 0.5 + np.array([[0.0, -2, 0], [0, -1, 0], [0, 0, 0], [length, 0, 0], [length, 1, 0]])


def stretched(before: float, after: float, motion: str = "lab") -> StepReport:
    config = MonitorConfig(motion=motion)  # type: ignore[arg-type]
    x0, x1 = long_edge(before), long_edge(after)
    return polyline_step(x0, x1, Strands.from_lengths([5]), cell_t0=BOX, cell_t1=BOX, config=config)


@pytest.mark.parametrize("motion", ["lab", "rigid"])
@pytest.mark.parametrize(("before", "after"), [(4.9, 5.1), (5.1, 4.9), (4.6, 5.4), (5.2, 4.7)])
def test_an_edge_of_half_a_cell_that_takes_another_image_is_lost_by_name(
    before: float, after: float, motion: str
) -> None:
    report = stretched(before, after, motion)
    assert (report.verdict, report.reason) == (Verdict.UNRESOLVED, Reason.IMAGE_JUMP)
    assert report.scope is Scope.NONE
    assert "the edge of vertices 2 and 3 is about half a cell long" in report.problem
    assert np.isnan(report.displacement_max)


@pytest.mark.parametrize("motion", ["lab", "rigid"])
@pytest.mark.parametrize(("before", "after"), [(4.9, 4.95), (4.95, 4.6), (3.0, 3.2), (3.0, -3.0), (5.1, 5.3)])
def test_an_edge_that_keeps_its_image_or_is_short_is_measured(before: float, after: float, motion: str) -> None:
    report = stretched(before, after, motion)
    assert report.reason is not Reason.IMAGE_JUMP
    assert report.problem == ""
    assert np.isfinite(report.displacement_max)


@pytest.mark.parametrize("axis", range(3))
def test_an_edge_of_three_tenths_of_a_cell_is_measured_in_any_image(axis: int) -> None:
    # wrapped far apart, but its nearest image does not change
    x0, x1 = long_edge(3.0), long_edge(3.1)
    x1[3:] += 2.0 * BOX[axis]
    report = polyline_step(x0, x1, Strands.from_lengths([5]), cell_t0=BOX, cell_t1=BOX, config=LAB)
    assert (report.verdict, report.reason, report.image_jumps) == (Verdict.CERTIFIED, Reason.NONE, 1)
    assert report.displacement_max == pytest.approx(0.1, abs=1e-9)


@pytest.mark.parametrize("share", [0.30, 0.34, 0.36, 0.45])
def test_an_edge_below_a_third_of_the_cell_may_turn_round_and_a_longer_one_may_not(share: float) -> None:
    x0 = np.array([[0.0, 0, 0], [10.0 * share, 0, 0]])
    report = polyline_step(x0, x0 * [-1, 1, 1], Strands.from_lengths([2]), cell_t0=BOX, cell_t1=BOX, config=LAB)
    assert (report.reason is Reason.IMAGE_JUMP) == (share > 0.35)
    assert report.verdict is not Verdict.CERTIFIED or share < 0.35


def test_every_image_of_a_lost_edge_is_lost() -> None:
    x0, x1 = long_edge(4.9), long_edge(5.1)
    for image in product((-1, 0, 1), repeat=3):
        moved = x1.copy()
        moved[3:] += np.array(image) @ BOX
        report = polyline_step(x0, moved, Strands.from_lengths([5]), cell_t0=BOX, cell_t1=BOX, config=LAB)
        assert report.reason is Reason.IMAGE_JUMP
