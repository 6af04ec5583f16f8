"""The ladder over all pairs of a step: what the search was told beforehand leaves no mark on the numbers."""

import numpy as np
import pytest

from mdtopo.curves import step_motion, whole_strands
from mdtopo.ladder import StepMeasure, measure_step
from mdtopo.records import Rung, Strands, Traces

STRANDS = Strands.from_lengths([7, 4], closed=[False, True])
TRACES = Traces.of(STRANDS)


def measures(rng: np.random.Generator, stretch: float) -> list[StepMeasure]:
    """Return what is measured of strands that hardly move in a cell that does, for searches of several first reaches.

    So a ball proves the step where the images drift little; and those that are further away drift more.
    """
    t = TRACES
    cell0 = 4.0 * np.eye(3) + rng.uniform(-0.4, 0.4, (3, 3))
    cell1 = cell0 @ (np.eye(3) + stretch * rng.normal(size=(3, 3)))
    bonds = rng.normal(size=(7, 3))
    coil = np.cumsum(bonds / np.linalg.norm(bonds, axis=1, keepdims=True), axis=0)
    x0 = np.concatenate([coil, rng.uniform(0.0, 4.0, 3) + np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])])
    x1 = x0 + 1e-3 * rng.normal(size=x0.shape)
    first, second = (whole_strands(x, cell, t.vertices, t.offsets, t.closed) for x, cell in ((x0, cell0), (x1, cell1)))
    ends = first[0], second[0], first[1], second[1], max(first[4], second[4])
    motion = step_motion(*ends, True, False, np.eye(3), t.vertices, t.offsets)
    assert motion.usable
    lists = t.edges, t.following, t.trace, t.local_pairs, t.end_terms
    return [measure_step(motion, True, *lists, reach) for reach in (0.0, 0.5, 4.0)]


@pytest.mark.parametrize("stretch", [1e-3, 0.02, 0.05])
def test_the_reach_of_the_search_leaves_no_mark_in_a_cell_that_changes(stretch: float) -> None:
    rng, balls, trials = np.random.default_rng(int(1e4 * stretch)), 0, 40
    for _ in range(trials):
        first, *others = measures(rng, stretch)
        balls += first.rung <= Rung.TWO_FRAME_BALL
        for other in others:
            assert other.rung == first.rung
            assert (other.nu, other.ratio, other.clearances[0]) == (first.nu, first.ratio, first.clearances[0])
            seen = first.clearance_witness[:, 0] >= 0
            assert other.clearances[seen].tolist() == first.clearances[seen].tolist()
            assert other.clearance_witness[seen].tolist() == first.clearance_witness[seen].tolist()
    assert 0 < balls < trials or stretch < 0.01, "images drift enough that a ball proves some steps, and not others"
