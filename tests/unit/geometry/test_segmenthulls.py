"""What hulls say of moving Bezier segments in one look: the vectors by hand, each rung on both sides of its limit."""

import numpy as np
import oracles
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.segmenthulls import (
    BY_DIRECTION,
    BY_HULL,
    BY_MOTION,
    JOINT,
    NOT_AT_ALL,
    PAIR,
    SELF,
    climb,
    greatest_motion,
    vectors_of,
)
from mdtopo.records import Rung

Points = NDArray[np.float64]
Rows = list[list[float]]

A = np.array([[0.0, 0, 0], [1, 0, 0], [3, 1, 0]])
B = np.array([[3.0, 1, 0], [4, 3, 0], [4, 6, 1]])


def vectors(kind: int, a: Points, b: Points) -> list[list[float]]:
    out = np.full((len(a) ** 2, 3), np.nan)
    return out[: vectors_of(kind, a, b, out)].tolist()  # type: ignore[no-any-return]


def look(start: Rows, end: Rows, slack: float = 0.0) -> tuple[float, int]:
    clearance, rung, *_ = climb(np.array(start + end, dtype=float), len(start), slack)
    return clearance, rung


def test_the_rungs_have_the_numbers_of_the_records() -> None:
    assert [BY_MOTION, BY_DIRECTION, BY_HULL] == [Rung.RELATIVE_MOTION, Rung.DIRECTION, Rung.HULL]
    assert NOT_AT_ALL == Rung.OPEN


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (SELF, [[1, 0, 0], [2, 1, 0]]),
        (JOINT, [[3, 1, 0], [2, 1, 0], [1, 2, 0], [1, 5, 1]]),
        (
            PAIR,
            [
                [-3, -1, 0],
                [-4, -3, 0],
                [-4, -6, -1],
                [-2, -1, 0],
                [-3, -3, 0],
                [-3, -6, -1],
                [0, 0, 0],
                [-1, -2, 0],
                [-1, -5, -1],
            ],
        ),
    ],
)
def test_the_vectors_of_each_check(kind: int, expected: list[list[float]]) -> None:
    assert vectors(kind, A, B) == expected


@pytest.mark.parametrize(
    ("start", "end", "clearance", "rung"),
    [
        ([[0, 0, 1]], [[0, 0, 1]], 1.0, BY_MOTION),
        ([[0, 0, 1]], [[0, 1.5, 1]], (1 + np.sqrt(3.25) - 1.5) / 2, BY_MOTION),
        ([[2, 0, 1]], [[-2, 0, 1]], np.sqrt(5) - 2, BY_MOTION),
        ([[-5, 0, 1], [-4, 0, 1]], [[4, 0, 1], [7, 0, 1]], 1.0, BY_DIRECTION),  # ρ = 11 is more than 2√17
        ([[0, 0, 1]], [[0, 0, -1]], 0.0, NOT_AT_ALL),
        ([[0, 0, 1]], [[0, 0, 0]], 0.0, NOT_AT_ALL),
    ],
)
def test_hand_values(start: Rows, end: Rows, clearance: float, rung: int) -> None:
    found, by = look(start, end)
    assert by == rung
    assert found == pytest.approx(clearance, abs=1e-13)
    assert found <= clearance


@pytest.mark.parametrize(("end", "rung"), [(-1e-9, NOT_AT_ALL), (1e-9, BY_MOTION)])
def test_a_vector_that_runs_to_the_origin_is_told_from_one_that_runs_through(end: float, rung: int) -> None:
    assert look([[0, 0, 1]], [[0, 0, end]])[1] == rung


@pytest.mark.parametrize("height", [1e-9, -1e-9, 0.3])
def test_the_hull_of_both_ends_proves_what_no_direction_of_theirs_does(height: float) -> None:
    """Four points around the origin at a height: none of the closest ones shows straight up."""
    flat = np.array([[5, 0.5, 0], [5, -0.5, 0], [-3, 5, 0], [-1, -5.5, 0]]) + np.array([0, 0, height])
    clearance, rung = look(flat[:2].tolist(), flat[2:].tolist())
    assert rung == BY_HULL
    assert clearance == pytest.approx(abs(height), abs=1e-13)
    flat[:, 2] = 0.0
    assert look(flat[:2].tolist(), flat[2:].tolist()) == (0.0, NOT_AT_ALL)


@pytest.mark.parametrize(("slack", "proved"), [(0.0, True), (0.49, True), (0.51, False)])
def test_slack_is_taken_off_at_both_ends_and_of_the_motion(slack: float, proved: bool) -> None:
    """Standing still at the distance 1, the two bounds are 1 - slack each, and ρ is 2·slack."""
    clearance, rung = look([[0, 0, 1]], [[0, 0, 1]], slack)
    if proved:
        assert clearance == pytest.approx(1 - 2 * slack, abs=1e-12)
    assert (rung == BY_MOTION) is proved


@pytest.mark.parametrize("seed", range(40))
def test_no_clearance_is_above_the_sampled_distance(seed: int) -> None:
    random = np.random.default_rng(seed)
    n, centre = int(random.integers(2, 9)), random.normal(size=3) * 3
    v0 = centre + random.normal(size=(n, 3))
    v1 = v0 + random.normal(size=(n, 3)) * 10.0 ** random.uniform(-2, 0.5)
    clearance, rung, d0, d1, rho = climb(np.concatenate([v0, v1]), n, 0.0)
    sampled = min(oracles.hull_distance((1 - t) * v0 + t * v1) for t in np.linspace(0, 1, 21))
    assert clearance <= sampled + 1e-12
    assert (rung == NOT_AT_ALL) is (clearance <= 0)
    assert d0 <= oracles.hull_distance(v0) + 1e-12
    assert d1 <= oracles.hull_distance(v1) + 1e-12
    assert rho == pytest.approx(np.linalg.norm(v1 - v0, axis=1).max(), rel=1e-12)
    assert rho >= greatest_motion(np.concatenate([v0, v1]), n)
