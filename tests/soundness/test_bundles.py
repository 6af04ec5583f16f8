"""No pair is lost in a large step: the search among bundles in a cell grid, against every pair and exact arithmetic."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from oracles import Event, Passages, pair_passages
from oracles.passages import Contact
from oracles.separation import apart
from soundness.alone import NO_IMAGES, Flags, climbed
from soundness.families import Generator, Points, powers, unit
from soundness.judge import complaint, measured

from mdtopo import Strands
from mdtopo.contacts import decide_open
from mdtopo.curves import StepMotion
from mdtopo.extremes import NU0, NU1, RATIO, Extremes, fresh_extremes
from mdtopo.geometry.boxgrid import ORDINARY, meeting_boxes
from mdtopo.geometry.broadphase import sorted_into_cells
from mdtopo.geometry.bundles import NARROWING, bundle_starts, edge_boxes, joint_boxes
from mdtopo.geometry.pairlanes import fresh_workbench
from mdtopo.geometry.passage import FREE, passages
from mdtopo.ladder import FIRST_REACH, StepMeasure, measure_step
from mdtopo.reach import RATIO_REACH, pairs_in_reach, search_pads
from mdtopo.records import Rung, Traces
from mdtopo.rungs import climb_pairs, meet_end_terms
from mdtopo.spheres import LEAST_SLACK, PLACING_ERROR, greatest_coordinate, mean_edge_length, spheres_of

Cells = tuple[Points, Points]


class Step(NamedTuple):
    x0: Points
    x1: Points
    strands: Strands
    cells: Cells | None = None


def melt(rng: Generator, lengths: list[int], *, long: float = 0.0, room: float = 1.2) -> tuple[Points, Strands]:
    """Strands of unit edges folded into one compact ball; `long` is the share of edges up to 30 times longer."""
    n = sum(lengths)
    size = np.where(rng.uniform(size=n) < long, powers(rng, n, 0, 1.5), 1.0)
    ball, x = room * n ** (1 / 3), np.zeros((n, 3))
    starts = np.concatenate([[0], np.cumsum(lengths)])
    for first, stop in pairwise(starts):
        x[first] = unit(rng, 1)[0] * ball * rng.uniform(0, 0.5)
        for k in range(first + 1, stop):
            tries = x[k - 1] + size[k] * unit(rng, 4)
            x[k] = tries[np.linalg.norm(tries, axis=1).argmin()] if np.linalg.norm(x[k - 1]) > ball else tries[0]
    return x, Strands.from_lengths(lengths, closed=[k % 2 == 1 for k in range(len(lengths))])


def compact(rng: Generator) -> Step:
    x, strands = melt(rng, [200, 150, 90, 160])
    return Step(x, x + 0.05 * rng.normal(size=x.shape), strands)


def large(rng: Generator) -> Step:
    x, strands = melt(rng, [1000, 500, 300, 200])
    return Step(x, x + 0.01 * rng.normal(size=x.shape), strands)


def long_beside_short(rng: Generator) -> Step:
    x, strands = melt(rng, [450, 220, 230], long=0.04, room=2.0)
    return Step(x, x + 0.02 * rng.normal(size=x.shape), strands)


def four_decades(rng: Generator) -> Step:
    """Edges from a thousandth of an ångström to ten, next to each other."""
    steps = unit(rng, 800) * powers(rng, 800, -3, 1)[:, np.newaxis]
    x = steps.reshape(8, 100, 3).cumsum(axis=1).reshape(-1, 3)
    return Step(x, x + 0.03 * rng.normal(size=x.shape), Strands.from_lengths([100] * 8))


def far_away(rng: Generator) -> Step:
    x, strands = melt(rng, [300, 301, 120])
    x = x + np.array([3e6, -2e7, 1e5])
    return Step(x, x + 0.1 * rng.normal(size=x.shape), strands)


def at_rest(rng: Generator) -> Step:
    x, strands = melt(rng, [450, 200, 270])
    return Step(x, x.copy(), strands)


def far_moved(rng: Generator) -> Step:
    """Most vertices move a little, one in a hundred by many edge lengths."""
    x, strands = melt(rng, [240, 180, 220])
    move = 0.05 * rng.normal(size=x.shape)
    move[rng.integers(len(x), size=len(x) // 100)] *= 200.0
    return Step(x, x + move, strands)


def single_precision(rng: Generator) -> Step:
    x, strands = melt(rng, [200, 260, 340])
    x = x + 40.0
    x0, x1 = (p.astype(np.float32).astype(np.float64) for p in (x, x + 0.08 * rng.normal(size=x.shape)))
    return Step(x0, x1, strands)


def sparse(rng: Generator) -> Step:
    """Strands in two far groups, so that most cells are empty, and one edge that joins two of them."""
    x, strands = melt(rng, [250, 250, 80, 120])
    x[250:500] += 400.0
    x[690:] -= 900.0
    return Step(x, x + 0.05 * rng.normal(size=x.shape), strands)


def rods(rng: Generator) -> Step:
    """Rods of one bundle each, all along x, nearly of one size: some that meet are as far apart as the grid looks."""
    x = rng.uniform(size=(120, 1, 3)) * [60.0, 2.0, 2.0] + np.linspace([0.0, 0, 0], [4.0, 0, 0], 5)
    x = x.reshape(-1, 3) + 0.02 * rng.normal(size=(600, 3))
    return Step(x, x + 0.02 * rng.normal(size=x.shape), Strands.from_lengths([5] * 120))


def wide_cell(rng: Generator) -> Step:
    """Strands in the middle of a cell that is too wide for images to meet, and that breathes a little."""
    x, strands = melt(rng, [200, 150, 90, 160])
    edge = 4.5 * float(np.abs(x).max())
    cells = edge * np.eye(3), 1.01 * edge * np.eye(3)
    return Step(x, x + 0.05 * rng.normal(size=x.shape), strands, cells)


def skewed_cell(rng: Generator) -> Step:
    """The same in a skewed cell, a thousand ångström from the origin; one vertex in a hundred moves far."""
    x, strands = melt(rng, [320, 300, 100])
    cell = 6.0 * float(np.abs(x).max()) * (np.eye(3) + rng.uniform(-0.2, 0.2, size=(3, 3)))
    move = 0.03 * rng.normal(size=x.shape)
    move[rng.integers(len(x), size=len(x) // 100)] *= 60.0
    return Step(x + 1000.0, x + 1000.0 + move, strands, (cell, cell))


STEPS: dict[str, Callable[[Generator], Step]] = {
    "compact": compact,
    "large": large,
    "long beside short": long_beside_short,
    "four decades": four_decades,
    "far away": far_away,
    "at rest": at_rest,
    "far moved": far_moved,
    "single precision": single_precision,
    "sparse": sparse,
    "rods": rods,
    "wide cell": wide_cell,
    "skewed cell": skewed_cell,
}


class Brute:
    """One step by every pair of edges that are not neighbours, without any search."""

    def __init__(self, name: str, step: Step) -> None:
        self.name = name
        self.t = t = Traces.of(step.strands)
        self.cells, self.periodic = step.cells, step.cells is not None
        cell0, cell1 = step.cells or (np.zeros((3, 3)), np.zeros((3, 3)))
        placed = float(np.abs(step.x0).max() + np.abs(cell0).sum()) if self.periodic else 0.0
        self.motion = StepMotion(step.x0, step.x1, cell0, cell1, False, (0.0, 0.0, 0.0), True, placed)
        self.spheres = spheres_of(self.motion, t.edges)
        self.slack = PLACING_ERROR * (greatest_coordinate(self.motion) + placed) + LEAST_SLACK
        self.placing = self.slack if self.periodic else 0.0
        self.local = self._local()
        self.first_reach = min(FIRST_REACH * self.local.values[NU0], mean_edge_length(self.spheres))
        i, j = np.triu_indices(len(t.edges), 1)
        far = (t.trace[i] != t.trace[j]) | (j - i > 2)
        self.pairs = np.stack([i[far], j[far]], axis=1)
        numbers = self.slack, self.placing, self.first_reach
        self.table, is_open, self.rungs = climbed(
            self.pairs, NO_IMAGES, self.motion, t.edges, t.following, t.trace, *numbers
        )
        self.inter = t.trace[self.pairs[:, 0]] != t.trace[self.pairs[:, 1]]
        alone = {int(k): self._decided(k, is_open) for k in np.flatnonzero(is_open)}
        passing = {bool(self.inter[k]) for k, (_, passes) in alone.items() if passes}
        for k, (best, passes) in alone.items():
            self.table[k, 3] = min(best.least[1:])
            # beside a passage of its class, a pair that is free of one needs no clearance of its own
            if not passes and bool(self.inter[k]) in passing and self._is_free(k):
                self.rungs[Rung.EXACT] += 1
            else:
                self.rungs += best.rung_pairs

    def _decided(self, k: int, is_open: Flags) -> tuple[Extremes, bool]:
        best, one = fresh_extremes(), (self.pairs[k : k + 1], NO_IMAGES, is_open[k : k + 1])
        found = decide_open(*one, False, self.motion, self.t.edges, self.t.trace, self.placing, best)
        return best, len(found.passages) > 0

    def _is_free(self, k: int) -> bool:
        corners = self.t.edges[self.pairs[k]].ravel()
        start, end = (tuple(map(tuple, x[corners].tolist())) for x in (self.motion.x0, self.motion.x1))
        return bool(passages(start, end, self.placing)[0] == FREE)

    def _local(self) -> Extremes:
        t, best, is_open = self.t, fresh_extremes(), np.zeros(len(self.t.local_pairs), dtype=np.bool_)
        numbers = self.slack, self.placing, 0.0
        ends = t.edges, t.following, t.trace
        climb_pairs(t.local_pairs, NO_IMAGES, True, self.motion, *ends, *numbers, fresh_workbench(), best, is_open)
        decide_open(t.local_pairs, NO_IMAGES, is_open, True, self.motion, t.edges, t.trace, self.placing, best)
        meet_end_terms(self.motion, t.end_terms, self.placing, best)
        return best

    def measure(self, likely_reach: float) -> StepMeasure:
        t = self.t
        ends = t.edges, t.following, t.trace, t.local_pairs, t.end_terms
        return measure_step(self.motion, self.periodic, *ends, likely_reach)

    def listed(self, reach: float) -> Flags:
        """Return which of all pairs the search lists that looks `reach` far."""
        pads = search_pads(self.spheres, reach, self.local.values[RATIO], self.slack)
        found, images, complete = pairs_in_reach(
            self.motion, self.periodic, self.t.edges, self.t.trace, self.spheres, pads
        )
        assert complete
        assert not len(images), "images can meet"
        code = found[:, 0] * len(pads) + found[:, 1]
        assert len(np.unique(code)) == len(code), "a pair is listed twice"
        assert np.isin(code, self.pairs[:, 0] * len(pads) + self.pairs[:, 1]).all(), "neighbours are listed"
        listed = np.isin(self.pairs[:, 0] * len(pads) + self.pairs[:, 1], code)
        ends = np.concatenate([self.motion.x0[self.t.edges], self.motion.x1[self.t.edges]], axis=1)
        low, high = ends.min(axis=1) - pads[:, np.newaxis], ends.max(axis=1) + pads[:, np.newaxis]
        i, j = self.pairs.T
        gap = np.maximum(low[i] - high[j], low[j] - high[i]).max(axis=1)
        rounding = 4.0 * NARROWING * float((high.max(axis=0) - low.min(axis=0)).max())
        assert listed[gap <= 0.0].all(), "a pair whose boxes meet is missing"
        assert not listed[gap > rounding].any(), "a pair is listed whose boxes do not meet"
        return listed

    def exact(self) -> Passages:
        """Return every crossing and contact, local pairs included, in exact arithmetic."""
        t, x0, x1 = self.t, self.motion.x0, self.motion.x1
        pairs = np.concatenate([self.pairs, t.local_pairs])
        ends = np.concatenate([x0[t.edges], x1[t.edges]], axis=1)
        low, high = ends.min(axis=1), ends.max(axis=1)
        i, j = pairs.T
        meet = ((low[i] <= high[j]) & (low[j] <= high[i])).all(axis=1)
        shared = (t.edges[i][:, :, np.newaxis] == t.edges[j][:, np.newaxis]).any(axis=(1, 2))
        pairs = pairs[meet & ~shared]
        corners = t.edges[pairs].reshape(-1, 4)
        events: list[Event] = []
        contacts: list[Contact] = []
        for k in np.flatnonzero(~apart(x0[corners], x1[corners], halvings=4)):
            found = pair_passages(*(x[corners[k]].reshape(2, 2, 3) for x in (x0, x1)))
            a, b, c, d = corners[k].tolist()
            events += [replace(e, first=(a, b), second=(c, d)) for e in found.events]
            contacts += found.contacts
        return Passages(tuple(events), tuple(contacts))


def generator(name: str) -> Generator:
    return np.random.default_rng([len(name), *name.encode()])


@pytest.fixture(params=STEPS, scope="module")
def brute(request: pytest.FixtureRequest) -> Brute:
    return Brute(request.param, STEPS[request.param](generator(request.param)))


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_every_pair_within_reach_is_listed(brute: Brute, share: float) -> None:
    """And every one that may hold the greatest ratio; yet more are left out than listed."""
    reach = max(brute.first_reach, share * 2.0 * float(np.median(brute.spheres.half)))
    left_out = brute.table[~brute.listed(reach)]
    assert left_out[:, 3].min() > reach
    assert left_out[:, 2].max() < max(1.0 / RATIO_REACH, brute.local.values[RATIO])
    assert left_out[:, :2].min() > reach
    assert len(left_out) > 0.5 * len(brute.table)


@pytest.mark.parametrize("likely_reach", [0.0, 1.5])
def test_the_numbers_of_a_step_are_those_of_every_pair(brute: Brute, likely_reach: float) -> None:
    """Bit for bit, and whatever the search was told beforehand."""
    m, local = brute.measure(likely_reach), brute.local
    assert m.nu == min(local.values[NU0], brute.table[:, 0].min())
    assert m.nu_end == min(local.values[NU1], brute.table[:, 1].min())
    assert m.ratio == max(local.values[RATIO], brute.table[:, 2].max(), 0.0)
    assert m.rung_pairs.tolist() == (local.rung_pairs + brute.rungs).tolist()
    balls = m.rung <= Rung.TWO_FRAME_BALL
    for kind, rows in ((1, ~brute.inter), (2, brute.inter)):
        least, first = brute.table[rows, 3].min(), np.flatnonzero(rows)[brute.table[rows, 3].argmin()]
        if m.clearance_witness[kind, 0] == -1:
            assert least >= m.clearances[kind] >= m.needed_reach
            continue
        assert m.clearances[kind] == least or (balls and least < m.clearances[kind] <= m.nu)
        assert m.clearance_witness[kind].tolist() == brute.t.edges[brute.pairs[first]].ravel().tolist()


def test_the_crossings_of_a_step_are_those_of_exact_arithmetic(brute: Brute) -> None:
    motion = brute.motion
    strands = Strands.from_lengths(np.diff(brute.t.offsets).tolist(), closed=brute.t.closed.tolist())
    cells = None if brute.cells is None else (brute.cells[0][np.newaxis], brute.cells[1][np.newaxis])
    table, rows = measured(motion.x0[np.newaxis], motion.x1[np.newaxis], strands, cells)
    report = table.report(rows[0])
    exact = brute.exact()
    print(f"\n{brute.name}: {len(brute.pairs)} pairs, {report.verdict.name}, {len(exact.events)} crossings")  # noqa: T201
    assert complaint(report, exact) == ""
    assert report.nu == brute.measure(0.0).nu
    assert report.image_jumps == 0


def test_the_search_has_many_bundles_and_cells(brute: Brute) -> None:
    """And boxes longer than a cell where edges are: else the tests above would try little of the search."""
    pads = search_pads(brute.spheres, brute.first_reach, brute.local.values[RATIO], brute.slack)
    starts = bundle_starts(brute.t.trace)
    boxes = joint_boxes(edge_boxes(brute.motion.x0, brute.motion.x1, brute.t.edges, pads, starts), starts)
    low, high = boxes[:3].T.astype(np.float64), boxes[3:].T.astype(np.float64)
    places = np.column_stack([0.5 * (low + high), 0.5 * (high - low).max(axis=1)])
    _, _, shape, _, width = sorted_into_cells(places, ORDINARY, True)
    assert len(low) >= 75
    listed, order = meeting_boxes(boxes, boxes.shape[1], True)
    found = {(int(i), int(j)) for i, j in np.sort(order[listed], axis=1)}
    meet = ((low[:, None] <= high) & (low <= high[:, None])).all(axis=2)
    assert found == {(int(i), int(j)) for i, j in np.argwhere(meet) if i + 1 < j}
    assert len(found) < 0.5 * len(low) ** 2
    assert np.prod(shape) >= 9
    if brute.name in ("long beside short", "four decades", "far moved", "sparse"):
        assert (2.0 * places[:, 3] > width).any()
