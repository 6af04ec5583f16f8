"""What follows from the measures of a step, by hand."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.outcomes import conclude_steps, scope_of, write_greatest_stretch, write_least_clearance
from mdtopo.records import Reason, Rung, Scope, Verdict
from mdtopo.steprows import StepRow, StepRows, unmeasured

NAN, INF = math.nan, math.inf
EDGES = np.array([[0, 1], [1, 2], [2, 3]])
CLASSES = ("local", "self", "inter")


def measured() -> StepRows:
    """Return the row of a step that the ladder settles."""
    rows = unmeasured(1)
    rows["displacement_max"], rows["nu"], rows["pair_ratio"], rows["rung"] = 0.25, 2.0, 0.5, Rung.BALL
    rows["is_turned"], rows["rotation_angle"] = True, 30.0
    with_clearances(rows[0], (NAN, 3.0, 1.5))
    return rows


def with_clearances(row: StepRow, clearances: Sequence[float]) -> None:
    """Write the clearances of the three classes, each with a pair of its own."""
    for k, (name, clearance) in enumerate(zip(CLASSES, clearances, strict=True)):
        row[f"clearance_{name}"], row[f"clearance_{name}_pair"] = clearance, pair_of(k)


def pair_of(k: int) -> list[list[int]]:
    return [[4 * k, 4 * k + 1], [4 * k + 2, 4 * k + 3]]


def concluded(
    rows: StepRows,
    *,
    bad: bool = False,
    times: tuple[float, float] = (1.0, 3.0),
    error: float = 0.0,
    n_crossings: int = 0,
    found: Reason = Reason.NONE,
) -> StepRow:
    rows = rows.copy()
    rows["n_crossings"], rows["reason"] = n_crossings, found
    ratios, limits = np.ones((1, 3)), np.full(3, NAN)
    assert not conclude_steps(rows, np.array([bad]), np.array(times), np.array([error]), ratios, limits, EDGES)
    return rows[0]


def test_the_margins_of_a_step() -> None:
    row = concluded(measured())
    assert (row["nu_ratio"], row["nu_margin"], row["certifiable_interval"]) == (0.25, 0.75, 4.0)
    assert (row["clearance"], row["clearance_pair"].tolist()) == (1.5, pair_of(2))
    assert row["rotation_angle"] == 30.0
    assert (row["bond_stretch"], row["bond_stretch_edge"].tolist()) == (1.0, [0, 1])
    assert (row["verdict"], row["scope"], row["reason"]) == (Verdict.CERTIFIED, Scope.MOTION, Reason.NONE)


def test_a_rotation_that_was_not_taken_out_has_no_angle() -> None:
    rows = measured()
    rows["is_turned"] = False
    assert concluded(rows)["rotation_angle"] == 0.0


def test_nothing_follows_from_rows_that_were_not_measured() -> None:
    rows = unmeasured(1)
    rows["rotation_angle"] = 30.0  # what would have been taken out
    row = concluded(rows)
    assert (row["verdict"], row["scope"], row["reason"]) == (Verdict.UNRESOLVED, Scope.NONE, Reason.LADDER)
    numbers = ("rotation_angle", "nu_ratio", "nu_margin", "clearance", "certifiable_interval")
    assert np.isnan([row[name] for name in numbers]).all()
    assert (row["clearance_pair"] == -1).all()


@pytest.mark.parametrize("rung", list(Rung))
def test_a_step_is_certified_by_every_rung_but_not_while_a_pair_is_open(rung: Rung) -> None:
    rows = measured()
    rows["rung"] = rung
    row = concluded(rows)
    assert (row["verdict"] == Verdict.CERTIFIED) == (rung is not Rung.OPEN)
    assert (row["reason"] == Reason.LADDER) == (rung is Rung.OPEN)


@pytest.mark.parametrize("rung", [Rung.EXACT, Rung.OPEN])
def test_a_passage_outweighs_what_is_open(rung: Rung) -> None:
    rows = measured()
    rows["rung"] = rung
    row = concluded(rows, n_crossings=1, found=Reason.TOUCH)
    assert (row["verdict"], row["scope"], row["reason"]) == (Verdict.CROSSING, Scope.NONE, Reason.NONE)


def test_the_reason_is_the_one_that_comes_first() -> None:
    rows = measured()
    rows["rung"] = Rung.OPEN
    assert concluded(rows)["reason"] == Reason.LADDER
    assert concluded(rows, found=Reason.TOUCH)["reason"] == Reason.TOUCH
    rows["cell_ok"] = False
    assert concluded(rows, found=Reason.TOUCH)["reason"] == Reason.CELL
    rows["jumping_edge"] = 0
    assert concluded(rows, found=Reason.TOUCH)["reason"] == Reason.IMAGE_JUMP
    assert concluded(rows, found=Reason.TOUCH, bad=True)["reason"] == Reason.BAD_DATA


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
    rows = unmeasured(1)
    with_clearances(rows[0], clearances)
    write_least_clearance(rows[0])
    np.testing.assert_equal(float(rows["clearance"][0]), clearances[kind])
    assert rows["clearance_pair"][0].tolist() == pair_of(kind)


@pytest.mark.parametrize("ratio", [0.5, 0.0, NAN])
@pytest.mark.parametrize("nu", [2.0, 0.0, NAN])
@pytest.mark.parametrize("displacement", [0.25, 0.0, NAN])
def test_ratios_are_those_of_ieee_arithmetic(displacement: float, nu: float, ratio: float) -> None:
    rows = measured()
    rows["displacement_max"], rows["nu"], rows["pair_ratio"] = displacement, nu, ratio
    row = concluded(rows)
    with np.errstate(all="ignore"):
        np.testing.assert_equal(float(row["nu_ratio"]), float(2.0 * np.float64(displacement) / np.float64(nu)))
        np.testing.assert_equal(float(row["certifiable_interval"]), float(np.float64(2.0) / np.float64(ratio)))


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
    rows = unmeasured(1)
    write_greatest_stretch(np.array(ratios), EDGES, rows[0])
    np.testing.assert_equal(float(rows["bond_stretch"][0]), greatest)
    assert rows["bond_stretch_edge"][0].tolist() == edge


def test_an_edge_at_its_limit_is_beyond_it() -> None:
    ratios, limits = np.array([[1.0, 1.0, 1.0], [1.0, 1.3, NAN]]), np.array([NAN, 1.3, 1.1])

    def is_any_beyond(ratios: NDArray[np.float64], limits: NDArray[np.float64]) -> bool:
        given = np.zeros(2, dtype=np.bool_), np.arange(3.0), np.zeros(2)
        return conclude_steps(unmeasured(2), *given, ratios, limits, EDGES[: len(limits)])

    assert is_any_beyond(ratios, limits)
    assert not is_any_beyond(ratios, np.nextafter(limits, INF))
    assert not is_any_beyond(ratios[:, :0], limits[:0])
