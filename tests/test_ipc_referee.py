"""A referee from another house: the Tight-Inclusion collision detection of the IPC Toolkit.

It is conservative: a pair of moving edges that it calls free is free, and its time of impact is never late; a hit may
be none. So every crossing must be a hit that is not later, and what it calls free must have no crossing.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.lattice import nearest_image_brute
from soundness.families import FAMILIES, Points, in_hex
from soundness.judge import LAB, measured

from mdtopo.pipeline.tables import open_input
from mdtopo.polyline import polyline_step
from mdtopo.records import Crossing, Strands, Verdict

ipctk = pytest.importorskip("ipctk", reason="the IPC Toolkit cannot be imported", exc_type=ImportError)

PAIR_STRANDS = Strands.from_lengths([2, 2])
STEPS = 600

MOST_ITERATIONS = 20_000
"""Where the toolkit gives up on deciding more closely and says that there is a hit."""

SAME_TIME = 1e-9

CLEAR = 1e-3
"""Å. Edges of some Å that keep this distance, some hundred times the toolkit's own tolerance, are no hit."""


def impact(x0: Points, x1: Points) -> float:
    """Return when the edges (0, 1) and (2, 3) may first meet by the toolkit, infinite where they do not.

    This asks about contact itself. `ipctk.TightInclusionCCD` keeps a share of the first distance, and refines a hit at
    time 0 for as long as it takes, which is forever where the motion is a few units in the last place.
    """
    ask = ipctk.tight_inclusion.edge_edge_ccd
    is_hit, time, _ = ask(*x0, *x1, min_distance=0.0, max_iterations=MOST_ITERATIONS)
    return float(time) if is_hit else np.inf


def test_the_referee_knows_a_hit_from_a_miss() -> None:
    x0 = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, -1], [0, 1, -1]], dtype=float)
    up = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 4], [0, 0, 4]], dtype=float)
    assert impact(x0, x0 + up) == pytest.approx(0.25, abs=1e-5)
    assert impact(x0, x0 + up) <= 0.25
    assert impact(x0, x0 + 0.2499 * up) == np.inf
    assert impact(x0, x0 - up) == np.inf


@pytest.mark.parametrize(
    ("name", "least_crossings"),
    [
        ("random", 15),
        ("grazing", 500),
        ("near touching", 50),
        ("near parallel", 50),
        ("float32", 200),
        ("hundredths", 100),
        ("lattice points", 5),
    ],
)
def test_the_referee_agrees_about_pairs(name: str, least_crossings: int) -> None:
    x0, x1 = FAMILIES[name](np.random.default_rng(11), STEPS)
    table, rows = measured(x0, x1, PAIR_STRANDS)
    hits = np.array([impact(*step) for step in zip(x0, x1, strict=True)])
    first = np.full(STEPS, np.inf)
    for crossing in table.crossings:
        k = crossing.step // 3
        first[k] = min(first[k], crossing.t)
    for k in np.flatnonzero(np.isfinite(first)):
        assert hits[k] <= first[k] + SAME_TIME, in_hex(x0[k], x1[k])
    is_crossing = table.verdict[rows] == Verdict.CROSSING
    assert np.isfinite(first[is_crossing]).all()
    assert is_crossing.sum() >= least_crossings
    clear = (table.verdict[rows] == Verdict.CERTIFIED) & (table.clearance_inter[rows] > CLEAR)
    assert np.isinf(hits[clear]).all()
    print(  # noqa: T201 - what the referee saw is the result
        f"\n{name}: {STEPS} steps, {is_crossing.sum()} crossings, all hits; "
        f"{np.isfinite(hits).sum()} hits, {clear.sum()} clear certificates, none a hit"
    )


def edge_after(x0: Points, x1: Points, edge: NDArray[np.int64], start: Points, cell: Points) -> tuple[Points, Points]:
    """Return an edge at both ends of the step, its first vertex at `start`: every vertex where it is next to the last.

    That is the nearest image, which holds for edges and motions below half a cell.
    """
    a, b = edge
    along, _ = nearest_image_brute(x0[b] - x0[a], cell)
    moves = [nearest_image_brute(x1[v] - x0[v], cell)[0] for v in (a, b)]
    here = np.stack([start, start + along])
    return here, here + np.stack(moves)


def pair_of(crossing: Crossing, x0: Points, x1: Points, cell: Points) -> tuple[Points, Points]:
    """Return the four ends of a crossing's edges, (4, 3), at both ends of the step."""
    one, other = crossing.edges
    first = edge_after(x0, x1, one, x0[one[0]], cell)
    second = edge_after(x0, x1, other, x0[other[0]] + crossing.image @ cell, cell)
    return np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])


def test_the_referee_hits_every_crossing_of_soft_chains(shared_data: Path) -> None:
    """500 steps of an engine's melt of chains that pass through each other, 232 times by a count of its own."""
    reader = open_input(shared_data / "soft" / "soft.data", shared_data / "soft" / "soft_fine.dcd")
    strands, n_crossings = Strands.from_lengths([100] * 20), 0
    for before, after in pairwise(reader.frames(0, 501)):
        x0, x1 = (np.asarray(frame.positions, dtype=np.float64) for frame in (before, after))
        report = polyline_step(x0, x1, strands, cell_t0=before.cell, cell_t1=after.cell, config=LAB)
        n_crossings += len(report.crossings)
        for crossing in report.crossings:
            y0, y1 = pair_of(crossing, x0, x1, before.cell)
            assert impact(y0, y1) <= crossing.t + SAME_TIME, in_hex(y0, y1)
    reader.close()
    print(f"\nsoft chains: {n_crossings} crossings, all hits")  # noqa: T201 - see above
    assert n_crossings == 232
