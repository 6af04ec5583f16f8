"""No image is lost among dense strands in a cell: the search among bundles and ghosts, against every pair and image."""

from collections.abc import Callable
from itertools import combinations_with_replacement, product
from typing import NamedTuple

import numpy as np
import pytest
from soundness.alone import NO_IMAGES, Whole, climbed
from soundness.families import Generator, Points

from mdtopo.curves import StepMotion
from mdtopo.extremes import NU0, NU1, RATIO, fresh_extremes
from mdtopo.geometry.pairlanes import fresh_workbench
from mdtopo.ladder import FIRST_REACH, StepMeasure, measure_step
from mdtopo.reach import begun_search, found_pairs, search_pads
from mdtopo.records import Rung, Strands, Traces
from mdtopo.rungs import climb_pairs, meet_end_terms
from mdtopo.sampling import closer_reach
from mdtopo.spheres import LEAST_SLACK, PLACING_ERROR, greatest_coordinate, mean_edge_length, spheres_of

SKEWED = np.array([[1, 0, 0], [0.1, 0.97, 0], [-0.15, 0.2, 0.95]])
WIDE = 7


class Step(NamedTuple):
    x0: Points
    x1: Points
    strands: Strands
    cell0: Points
    cell1: Points


def crowd(rng: Generator, shape: Points, move: float) -> Step:
    """Straight strands of eight edges side by side, a little closer than edges are long; some lie a few cells away."""
    cell = shape * np.array([[8.85], [WIDE * 0.9], [WIDE * 0.9]])
    grid = np.array([(0.0, a, b) for a, b in product(range(WIDE), repeat=2)]) / WIDE
    starts = grid @ cell + rng.integers(-1, 2, size=(len(grid), 3)) @ cell
    along = cell[0] / np.linalg.norm(cell[0])
    x = (starts[:, np.newaxis] + np.arange(9)[:, np.newaxis] * along).reshape(-1, 3)
    x += rng.normal(scale=0.02, size=x.shape)
    return Step(x, x + rng.normal(scale=move, size=x.shape), Strands.from_lengths([9] * len(grid)), cell, cell)


def coils(rng: Generator, cell: Points, move: float) -> Step:
    """Coils that avoid nobody."""
    steps = rng.normal(size=(5, 50, 3))
    steps /= np.linalg.norm(steps, axis=2, keepdims=True)
    x = (rng.uniform(size=(5, 1, 3)) @ cell + steps.cumsum(axis=1)).reshape(-1, 3)
    return Step(x, x + rng.normal(scale=move, size=x.shape), Strands.from_lengths([50] * 5), cell, cell)


def breathing(step: Step, share: float) -> Step:
    """The same in a cell that grows, and with it everything."""
    return step._replace(x1=step.x1 * (1.0 + share), cell1=step.cell1 * (1.0 + share))


STEPS: dict[str, Callable[[Generator], Step]] = {
    "crowd": lambda rng: crowd(rng, np.eye(3), 0.01),
    "skewed crowd": lambda rng: crowd(rng, SKEWED, 0.01),
    "crowd at rest": lambda rng: crowd(rng, np.eye(3), 0.0),
    "crowd that breathes": lambda rng: breathing(crowd(rng, np.eye(3), 0.01), 0.002),
    "coils": lambda rng: coils(rng, 9.0 * np.eye(3), 0.02),
    "skewed coils": lambda rng: coils(rng, 11.0 * SKEWED, 0.02),
    "coils that breathe": lambda rng: breathing(coils(rng, 9.0 * np.eye(3), 0.01), 0.001),
}
CROWDS = "crowd", "skewed crowd", "crowd at rest"


class Brute:
    """One step in a cell, by every pair of edges in every image that is not far away, without any search."""

    def __init__(self, name: str, step: Step) -> None:
        self.name, self.step = name, step
        self.t = t = Traces.of(step.strands)
        placed = float(np.abs(step.x0).max() + np.abs(step.cell0).sum())
        self.motion = StepMotion(step.x0, step.x1, step.cell0, step.cell1, False, (0.0, 0.0, 0.0), True, placed)
        self.spheres = spheres_of(self.motion, t.edges)
        self.slack = self.placing = PLACING_ERROR * (greatest_coordinate(self.motion) + placed) + LEAST_SLACK
        self.local = fresh_extremes()
        ends, numbers = (t.edges, t.following, t.trace), (self.slack, self.placing, 0.0)
        self.local_open = is_open = np.zeros(len(t.local_pairs), dtype=np.bool_)
        climb_pairs(
            t.local_pairs, NO_IMAGES, True, self.motion, *ends, *numbers, fresh_workbench(), self.local, is_open
        )
        meet_end_terms(self.motion, t.end_terms, self.placing, self.local)
        self.edge_length = mean_edge_length(self.spheres)
        self.first_reach = min(FIRST_REACH * self.local.values[NU0], self.edge_length)
        self.pairs, self.images, self.gap = self._within(2.0 * self.edge_length)
        numbers = self.slack, self.placing, self.first_reach
        self.table, self.is_open, self.rungs = climbed(self.pairs, self.images, self.motion, *ends, *numbers)

    def _within(self, reach: float) -> tuple[Whole, Whole, Points]:
        """Return all pairs in all images whose boxes are less far apart than this, without neighbours at home."""
        t, s = self.t, self.step
        ends = np.concatenate([s.x0[t.edges], s.x1[t.edges]], axis=1)
        low, high = ends.min(axis=1), ends.max(axis=1)
        counts = np.array(list(product(range(-2, 3), repeat=3)))
        pairs, images, gaps = [], [], []
        for i, j in combinations_with_replacement(range(len(low)), 2):
            home = np.rint(np.linalg.solve(s.cell0.T, 0.5 * (low[i] + high[i] - low[j] - high[j]))).astype(int)
            shifts = counts + home
            a, b = shifts @ s.cell0, shifts @ s.cell1
            gap = np.maximum(low[j] + np.minimum(a, b) - high[i], low[i] - high[j] - np.maximum(a, b)).max(axis=1)
            for k in np.flatnonzero(gap <= reach):
                image = tuple(shifts[k].tolist())
                if (i == j and image <= (0, 0, 0)) or (image == (0, 0, 0) and self._are_neighbours(i, j)):
                    continue
                pairs.append((i, j))
                images.append(image)
                gaps.append(gap[k])
        return np.array(pairs), np.array(images), np.array(gaps)

    def _are_neighbours(self, i: int, j: int) -> bool:
        after = self.t.following
        return any(j == b or (b >= 0 and j == after[b]) for b in [after[i]]) or any(
            i == b or (b >= 0 and i == after[b]) for b in [after[j]]
        )

    def measure(self, likely_reach: float) -> StepMeasure:
        t = self.t
        return measure_step(self.motion, True, t.edges, t.following, t.trace, t.local_pairs, t.end_terms, likely_reach)


@pytest.fixture(params=STEPS, scope="module")
def brute(request: pytest.FixtureRequest) -> Brute:
    name = request.param
    return Brute(name, STEPS[name](np.random.default_rng([len(name), *name.encode()])))


@pytest.mark.parametrize("likely_reach", [0.0, 1.2])
def test_the_numbers_of_a_step_are_those_of_every_pair_and_image(brute: Brute, likely_reach: float) -> None:
    """Bit for bit, and whatever the search was told beforehand."""
    m, local, table = brute.measure(likely_reach), brute.local, brute.table
    assert m.countable
    assert m.nu == min(local.values[NU0], table[:, 0].min())
    assert m.nu_end == min(local.values[NU1], table[:, 1].min())
    assert m.ratio == max(local.values[RATIO], table[:, 2].max(), 0.0)
    is_open = brute.is_open
    assert (m.rung_pairs[:5] == (local.rung_pairs + brute.rungs)[:5]).all()
    assert m.rung_pairs[5:].sum() == is_open.sum() + brute.local_open.sum()
    inter = brute.t.trace[brute.pairs[:, 0]] != brute.t.trace[brute.pairs[:, 1]]
    for kind, rows in ((1, ~inter), (2, inter)):
        if is_open[rows].any():
            continue  # decided elsewhere: here is what the search finds
        least = table[rows, 3].min()
        if m.clearance_witness[kind, 0] == -1:
            assert least >= m.clearances[kind] >= m.needed_reach
            continue
        balls = m.rung <= Rung.TWO_FRAME_BALL
        assert m.clearances[kind] == least or (balls and least < m.clearances[kind] <= m.nu)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_every_pair_and_image_within_reach_is_listed_once(brute: Brute, share: float) -> None:
    reach = max(brute.first_reach, share * brute.edge_length)
    pads = search_pads(brute.spheres, reach, brute.local.values[RATIO], brute.slack)
    arguments = brute.motion, True, brute.t.edges, brute.t.trace, brute.spheres, pads
    search = begun_search(*arguments)
    assert search.is_bundled
    pairs, images, complete = found_pairs(search, *arguments)
    assert complete
    listed = {(*map(int, pair), *map(int, image)) for pair, image in zip(pairs, images, strict=True)}
    assert len(listed) == len(pairs), "a pair is listed twice"
    every = [(*map(int, pair), *map(int, image)) for pair, image in zip(brute.pairs, brute.images, strict=True)]
    missing = np.array([pair not in listed for pair in every])
    assert missing.any()
    assert brute.gap[missing].min() > reach
    assert brute.table[missing, :2].min() > reach
    assert brute.table[missing, 3].min() > reach


def test_among_crowds_the_search_becomes_closer() -> None:
    """And so the tests above are about that too: in cells that are at rest."""
    for name, make in STEPS.items():
        brute = Brute(name, make(np.random.default_rng([len(name), *name.encode()])))
        t, reach = brute.t, brute.first_reach
        pads = search_pads(brute.spheres, reach, brute.local.values[RATIO], brute.slack)
        search = begun_search(brute.motion, True, t.edges, t.trace, brute.spheres, pads)
        ends, numbers = (t.edges, t.following, t.trace), (brute.slack, brute.placing, brute.first_reach)
        closer, ratio = closer_reach(
            search, reach, brute.motion, *ends, *numbers, fresh_workbench(), brute.local, True, True
        )
        assert (closer < 0.95 * reach) == (name in CROWDS), name
        assert ratio >= brute.local.values[RATIO]
