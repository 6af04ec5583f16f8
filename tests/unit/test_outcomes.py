"""What follows from the measures of a step, by hand."""

import math

import numpy as np
import pytest

from mdtopo.blocks import Columns, empty_columns
from mdtopo.outcomes import Outcomes, conclude_steps, greatest_stretches, least_clearance, quotient, scope_of
from mdtopo.records import Reason, Rung, Scope, Verdict

NAN, INF = math.nan, math.inf
EDGES = np.array([[0, 1], [1, 2], [2, 3]])


def measured() -> Columns:
    """Return the row of a step that the ladder settles."""
    columns = empty_columns(1)
    columns.displacement[0], columns.nu[0], columns.ratio[0], columns.rung[0] = 0.25, 2.0, 0.5, Rung.BALL
    columns.is_turned[0], columns.angle[0] = True, 30.0
    columns.clearances[0], columns.clearance_witness[0] = (NAN, 3.0, 1.5), [[-1] * 4, [0, 1, 2, 3], [4, 5, 6, 7]]
    return columns


def concluded(
    columns: Columns,
    *,
    bad: bool = False,
    times: tuple[float, float] = (1.0, 3.0),
    error: float = 0.0,
    n_crossings: int = 0,
    found: Reason = Reason.NONE,
) -> Outcomes:
    out = Outcomes.unknown(1)
    out.n_crossings[0], out.reason[0] = n_crossings, found
    ratios, limits = np.ones((1, 3)), np.full(3, NAN)
    assert not conclude_steps(columns, np.array([bad]), np.array(times), np.array([error]), ratios, limits, EDGES, out)
    return out


def test_the_margins_of_a_step() -> None:
    out = concluded(measured())
    assert (out.nu_ratio[0], out.nu_margin[0], out.certifiable_interval[0]) == (0.25, 0.75, 4.0)
    assert (out.clearance[0], out.clearance_witness[0].tolist()) == (1.5, [4, 5, 6, 7])
    assert out.rotation_angle[0] == 30.0
    assert (out.bond_stretch[0], out.bond_stretch_edge[0].tolist()) == (1.0, [0, 1])
    assert (out.verdict[0], out.scope[0], out.reason[0]) == (Verdict.CERTIFIED, Scope.MOTION, Reason.NONE)


def test_a_rotation_that_was_not_taken_out_has_no_angle() -> None:
    columns = measured()
    columns.is_turned[0] = False
    assert concluded(columns).rotation_angle[0] == 0.0


def test_nothing_follows_from_rows_that_were_not_measured() -> None:
    out = concluded(empty_columns(1))
    assert (out.verdict[0], out.scope[0], out.reason[0]) == (Verdict.UNRESOLVED, Scope.NONE, Reason.LADDER)
    numbers = (out.rotation_angle, out.nu_ratio, out.nu_margin, out.clearance, out.certifiable_interval)
    assert np.isnan(numbers).all()
    assert out.clearance_witness[0].tolist() == [-1] * 4


@pytest.mark.parametrize("rung", list(Rung))
def test_a_step_is_certified_by_every_rung_but_not_while_a_pair_is_open(rung: Rung) -> None:
    columns = measured()
    columns.rung[0] = rung
    out = concluded(columns)
    assert (out.verdict[0] == Verdict.CERTIFIED) == (rung is not Rung.OPEN)
    assert (out.reason[0] == Reason.LADDER) == (rung is Rung.OPEN)


@pytest.mark.parametrize("rung", [Rung.EXACT, Rung.OPEN])
def test_a_passage_outweighs_what_is_open(rung: Rung) -> None:
    columns = measured()
    columns.rung[0] = rung
    out = concluded(columns, n_crossings=1, found=Reason.TOUCH)
    assert (out.verdict[0], out.scope[0], out.reason[0]) == (Verdict.CROSSING, Scope.NONE, Reason.NONE)


def test_the_reason_is_the_one_that_comes_first() -> None:
    columns = measured()
    columns.rung[0] = Rung.OPEN
    assert concluded(columns).reason[0] == Reason.LADDER
    assert concluded(columns, found=Reason.TOUCH).reason[0] == Reason.TOUCH
    columns.cell_ok[0] = False
    assert concluded(columns, found=Reason.TOUCH).reason[0] == Reason.CELL
    columns.jump[0] = 0
    assert concluded(columns, found=Reason.TOUCH).reason[0] == Reason.IMAGE_JUMP
    assert concluded(columns, found=Reason.TOUCH, bad=True).reason[0] == Reason.BAD_DATA


def test_what_was_rounded_away_must_fit_into_the_clearance() -> None:
    error = 0.75
    assert scope_of(2.0 * error, error) == Scope.STORED
    assert scope_of(np.nextafter(2.0 * error, INF), error) == Scope.MOTION
    assert scope_of(NAN, error) == Scope.MOTION  # there is nothing to hit
    assert scope_of(1.0, NAN) == Scope.STORED


@pytest.mark.parametrize(
    ("clearances", "kind"),
    [((3.0, 2.0, 1.0), 2), ((1.0, 1.0, 2.0), 0), ((NAN, 2.0, 2.0), 1), ((NAN, NAN, 0.0), 2), ((NAN, NAN, NAN), 0)],
)
def test_the_least_clearance_is_that_of_the_first_class_that_has_it(clearances: list[float], kind: int) -> None:
    assert least_clearance(np.array(clearances)) == kind


@pytest.mark.parametrize(
    ("a", "b"), [(1.0, 4.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 0.0), (NAN, 0.0), (NAN, 1.0), (1.0, NAN)]
)
def test_a_quotient_is_that_of_ieee_arithmetic(a: float, b: float) -> None:
    with np.errstate(all="ignore"):
        np.testing.assert_equal(quotient(a, b), float(np.float64(a) / np.float64(b)))


@pytest.mark.parametrize(
    ("ratios", "greatest", "edge"),
    [
        ((1.0, 1.5, 1.2), 1.5, [1, 2]),
        ((1.5, 1.5, 1.0), 1.5, [0, 1]),
        ((NAN, 0.5, NAN), 0.5, [1, 2]),
        ((0.0, 0.0, 0.0), 0.0, [0, 1]),
        ((NAN, NAN, NAN), NAN, [-1, -1]),
        ((1.0, INF, 1.0), NAN, [-1, -1]),
    ],
)
def test_the_greatest_stretch_is_that_of_the_first_edge_that_has_it(
    ratios: list[float], greatest: float, edge: list[int]
) -> None:
    stretch, stretch_edge = np.full(1, NAN), np.full((1, 2), -1)
    greatest_stretches(np.array([ratios]), np.full(3, NAN), EDGES, stretch, stretch_edge)
    np.testing.assert_equal(stretch[0], greatest)
    assert stretch_edge[0].tolist() == edge


def test_an_edge_at_its_limit_is_beyond_it() -> None:
    ratios, limits = np.array([[1.0, 1.0, 1.0], [1.0, 1.3, NAN]]), np.array([NAN, 1.3, 1.1])
    out = np.empty(2), np.empty((2, 2), dtype=np.int64)
    assert greatest_stretches(ratios, limits, EDGES, *out)
    assert not greatest_stretches(ratios, np.nextafter(limits, INF), EDGES, *out)
    assert not greatest_stretches(ratios[:, :0], limits[:0], EDGES[:0], *out)
