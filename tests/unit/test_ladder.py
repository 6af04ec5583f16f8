"""The ladder over all pairs of a step: what the search was told beforehand leaves no mark on the numbers."""

import numpy as np
import pytest

from mdtopo.curves import step_motion, whole_strands
from mdtopo.ladder import StepMeasure, measure_step
from mdtopo.records import Rung, Strands, Traces

STRANDS = Strands.from_lengths([12, 9, 7], closed=[False, True, False])
TRACES = Traces.of(STRANDS)


def measures(rng: np.random.Generator, move: float, stretch: float) -> list[StepMeasure]:
    """Return what is measured of one step in a cell that changes, for searches of several first reaches."""
    t = TRACES
    cell0 = 5.0 * np.eye(3) + rng.uniform(-0.6, 0.6, (3, 3))
    cell1 = cell0 @ (np.eye(3) + stretch * rng.normal(size=(3, 3)))
    places = rng.uniform(0.0, 5.0, (3, 3))
    x0 = np.concatenate(
        [p + np.cumsum(0.7 * rng.normal(size=(n, 3)), axis=0) for p, n in zip(places, (12, 9, 7), strict=True)]
    )
    x1 = x0 @ np.linalg.inv(cell0) @ cell1 + move * rng.normal(size=x0.shape)
    first, second = (whole_strands(x, cell, t.vertices, t.offsets, t.closed) for x, cell in ((x0, cell0), (x1, cell1)))
    placing = max(first[4], second[4])
    ends = first[0], second[0], first[1], second[1], placing
    motion = step_motion(*ends, True, False, np.eye(3), t.vertices, t.offsets)
    assert motion.usable
    lists = t.edges, t.following, t.trace, t.local_pairs, t.end_terms
    return [measure_step(motion, True, *lists, reach) for reach in (0.0, 0.4, 2.0, 9.0)]


@pytest.mark.parametrize("stretch", [0.0, 1e-4, 0.02])
def test_the_reach_of_the_search_leaves_no_mark_in_a_cell_that_changes(stretch: float) -> None:
    rng, balls = np.random.default_rng(int(1e4 * stretch)), 0
    for _ in range(60):
        first, *others = measures(rng, 0.003, stretch)
        balls += first.rung <= Rung.TWO_FRAME_BALL
        for other in others:
            assert other.rung == first.rung
            assert (other.nu, other.ratio, other.clearances[0]) == (first.nu, first.ratio, first.clearances[0])
            seen = first.clearance_witness[:, 0] >= 0
            assert other.clearances[seen].tolist() == first.clearances[seen].tolist()
            assert other.clearance_witness[seen].tolist() == first.clearance_witness[seen].tolist()
    assert balls > 5 or stretch > 0.01, "too few steps are proved by a ball, which is what the drift of images is for"
