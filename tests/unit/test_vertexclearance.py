"""The clearance of every vertex of a step: by hand, against all pairs, and what must not change it."""

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.ladder import WIDEST_REACH
from mdtopo.pipeline import step_tables
from mdtopo.readers import ReaderRequest, Source, open_reader
from mdtopo.records import MonitorConfig, StepTable, Strands, Traces, Verdict
from mdtopo.records.profile import rounded_down
from mdtopo.spheres import LEAST_SLACK, PLACING_ERROR, mean_edge_length, spheres_of
from mdtopo.vertexclearance import edge_clearances, lower_bounds

Points = NDArray[np.float64]
SHAPES = (([9], [False]), ([8], [True]), ([6, 5, 4], [False, True, False]), ([2, 2, 3], [False] * 3))
CELL = np.array([[9.0, 0, 0], [1.5, 8, 0], [-1, 1, 8.5]])


def table_of(frames: Points, strands: Strands, cell: Points | None = None, **knobs: object) -> StepTable:
    options = {} if cell is None else {"cell": cell}
    config = MonitorConfig(**{"motion": "lab", "profile_steps": 1, **knobs})  # type: ignore[arg-type]
    with open_reader(Source(object=frames), ReaderRequest(strands=strands, options=options)) as reader:
        return StepTable.joined(list(step_tables(reader, config=config, threads=1)))


def values_of(x0: Points, x1: Points, strands: Strands, cell: Points | None = None) -> Points:
    """The values of the one step from x0 to x1."""
    profile = table_of(np.stack([x0, x1]), strands, cell).profile
    assert profile.clearance.shape == (1, len(x0))
    return profile.clearance[0].astype(np.float64)


def chains(lengths: Sequence[int], closed: Sequence[bool], seed: int, spread: float = 2.0) -> tuple[Points, Strands]:
    """Random walks with bonds of 1 Å that start close to each other; the last vertex of a ring need not come back."""
    rng = np.random.default_rng(seed)
    pieces = []
    for n in lengths:
        bonds = rng.normal(size=(n, 3))
        bonds /= np.linalg.norm(bonds, axis=1)[:, np.newaxis]
        pieces.append(rng.uniform(-spread, spread, 3) + np.cumsum(bonds, axis=0))
    return np.concatenate(pieces), Strands.from_lengths(lengths, closed=closed)


def sampled(pairs0: Points, pairs1: Points, n: int = 161) -> Points:
    """The least distance of each pair of edges, shape (m, 2, 2, 3), over n times: never below what is kept in truth.

    The nearest points are both inside their edges, or one is an end.
    """
    t = np.linspace(0, 1, n)[:, None, None, None, None]
    x = (1 - t) * pairs0 + t * pairs1
    (a, b), (c, d) = np.moveaxis(x[:, :, 0], 2, 0), np.moveaxis(x[:, :, 1], 2, 0)

    def to_edge(p: Points, q: Points, r: Points) -> Points:
        along = np.clip(((p - q) * (r - q)).sum(-1) / np.maximum(((r - q) ** 2).sum(-1), 1e-300), 0, 1)
        return np.linalg.norm(p - q - along[..., None] * (r - q), axis=-1)

    ends = np.min([to_edge(a, c, d), to_edge(b, c, d), to_edge(c, a, b), to_edge(d, a, b)], axis=0)
    normal = np.cross(b - a, d - c)
    parallel = 1e-12 * ((b - a) ** 2).sum(-1) * ((d - c) ** 2).sum(-1) + 1e-300
    size = np.maximum((normal**2).sum(-1), parallel)
    s = (np.cross(c - a, d - c) * normal).sum(-1) / size
    r = (np.cross(c - a, b - a) * normal).sum(-1) / size
    inside = (s >= 0) & (s <= 1) & (r >= 0) & (r <= 1) & (size > parallel)
    lines = np.abs(((c - a) * normal).sum(-1)) / np.sqrt(size)
    return np.where(inside, np.minimum(lines, ends), ends).min(axis=0)


def least_during(x0: Points, x1: Points, strands: Strands) -> Points:
    """The least distance that the edges of each vertex keep to all others in the step, at many times of it."""
    pairs = [(p, q) for p, q in combinations(strands.edges.tolist(), 2) if not set(p) & set(q)]
    found = np.full(len(x0), np.inf)
    for pair, least in zip(pairs, sampled(x0[np.array(pairs)], x1[np.array(pairs)]), strict=True):
        found[np.ravel(pair)] = np.minimum(found[np.ravel(pair)], least)
    return found


def test_the_sampled_distance_is_that_of_the_slow_oracle() -> None:
    pairs = np.random.default_rng(5).normal(0, 1.5, (2, 12, 2, 2, 3))
    for k, least in enumerate(sampled(*pairs, n=41)):
        assert least == pytest.approx(oracles.sampled_distance_during(pairs[0][k], pairs[1][k], n=41), abs=1e-9)


def test_two_rods_that_cross_and_a_third_that_does_not() -> None:
    rods = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 1], [0, 1, 1], [-1, 0, -3], [1, 0, -3]])
    moved = rods.copy()
    moved[2:4, 2] = -1.0  # straight through the first one
    strands = Strands.from_lengths([2, 2, 2])
    table = table_of(np.stack([rods, moved]), strands)
    assert table.verdict.tolist() == [Verdict.CROSSING]
    # the third comes within 2 Å of the second: (4 + 2 - 2)/2 by the relative motion, and it is 2 exactly
    assert table.profile.clearance[0] == pytest.approx([0, 0, 0, 0, 2, 2], abs=1e-6)
    assert (table.profile.clearance[0] <= [0, 0, 0, 0, 2, 2]).all()


def test_two_rods_that_stay_apart_have_their_distance() -> None:
    rods = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 1.25], [0, 1, 1.25]])
    values = values_of(rods, rods + np.array([0, 0, 0.5]), Strands.from_lengths([2, 2]))
    assert values == pytest.approx([1.25] * 4, abs=1e-6)
    assert (values <= 1.25).all()


@pytest.mark.parametrize(("lengths", "closed"), SHAPES)
@pytest.mark.parametrize("seed", [1, 2])
def test_at_rest_it_is_the_distance_to_the_nearest_edge(lengths: list[int], closed: list[bool], seed: int) -> None:
    x, strands = chains(lengths, closed, seed)
    values, exact = values_of(x, x, strands), least_during(x, x, strands)
    assert (values <= exact * (1 + 1e-12)).all()
    # nothing is looked for beyond the greatest local distance, so a value may be that one instead
    local = values_of(x, x, strands).max()
    assert values == pytest.approx(np.minimum(exact, local), rel=1e-6)


@pytest.mark.parametrize(("lengths", "closed"), SHAPES)
@pytest.mark.parametrize("size", [0.02, 0.15, 0.6, 2.0])
def test_in_motion_it_is_a_lower_bound_and_close_where_the_motion_is_small(
    lengths: list[int], closed: list[bool], size: float
) -> None:
    for seed in range(3):
        x0, strands = chains(lengths, closed, seed)
        x1 = x0 + np.random.default_rng(seed).normal(0, size, x0.shape)
        table = table_of(np.stack([x0, x1]), strands)
        values, exact = table.profile.clearance[0].astype(float), least_during(x0, x1, strands)
        assert (values <= exact + 1e-12).all()
        assert values.min() == rounded_down(table.clearance)[0]
        motion = 2.0 * np.linalg.norm(x1 - x0, axis=1).max()
        assert (values >= np.minimum(exact, values.max()) - motion - 1e-6).all()


@given(
    x=st.lists(st.integers(-2, 2), min_size=36, max_size=36),
    scale=st.sampled_from([1e-4, 1.0, 1e3]),
    far=st.sampled_from([0.0, 1e5]),
)
@settings(max_examples=120, deadline=None, derandomize=True)
def test_on_a_lattice_where_edges_touch_coincide_and_vanish_it_is_a_lower_bound(
    x: list[int], scale: float, far: float
) -> None:
    x0, x1 = scale * np.array(x, dtype=float).reshape(2, 6, 3) + far
    strands = Strands.from_lengths([2, 4])
    table = table_of(np.stack([x0, x1]), strands)
    values, exact = table.profile.clearance[0].astype(float), least_during(x0, x1, strands)
    assert (values <= exact + 1e-12 * (scale + far)).all()
    assert (values >= 0.0).all()
    for crossing in table.crossings:
        assert (values[crossing.edges.ravel()] == 0.0).all()


def test_some_of_these_bounds_are_positive_in_a_step_that_crosses() -> None:
    x0, strands = chains([6, 5, 4], [False, True, False], 0)
    x1 = x0 + np.random.default_rng(0).normal(0, 2.0, x0.shape)
    table = table_of(np.stack([x0, x1]), strands)
    assert table.verdict.tolist() == [Verdict.CROSSING]
    crossed = set(table.crossings.edges.ravel().tolist())
    values = table.profile.clearance[0]
    assert (values[sorted(crossed)] == 0.0).all()
    assert (values > 0.0).any()


@pytest.mark.parametrize("seed", range(3))
def test_it_moves_with_its_vertices_when_strands_are_listed_otherwise_or_backwards(seed: int) -> None:
    x0, strands = chains([6, 5, 4], [False, True, False], seed)
    x1 = x0 + np.random.default_rng(seed).normal(0, 0.1, x0.shape)
    order = np.array([*range(14, 10, -1), *range(10, 5, -1), *range(6)])
    other = Strands.from_lengths([4, 5, 6], closed=[False, True, False])
    assert values_of(x0[order], x1[order], other) == pytest.approx(values_of(x0, x1, strands)[order], rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_time_reversal_and_a_shift_change_nothing(seed: int) -> None:
    x0, strands = chains([6, 5, 4], [False, True, False], seed)
    x1 = x0 + np.random.default_rng(seed).normal(0, 0.1, x0.shape)
    values = values_of(x0, x1, strands)
    assert values_of(x1, x0, strands) == pytest.approx(values, rel=1e-6)
    shift = np.array([3, -20, 7])
    assert values_of(x0 + shift, x1 + shift, strands) == pytest.approx(values, rel=1e-6)


@pytest.mark.parametrize("growth", [1.0, 1.03])
@pytest.mark.parametrize("seed", range(3))
def test_in_a_cell_the_images_count_and_wrapping_does_not(seed: int, growth: float) -> None:
    x0, strands = chains([6, 5], [False, False], seed, spread=1.0)
    x1 = x0 + np.random.default_rng(seed).normal(0, 0.1, x0.shape)
    cells = np.stack([CELL, growth * CELL])
    values = values_of(x0, x1, strands, cells)
    exact, motion = least_during(x0, x1, strands), 2.0 * np.linalg.norm(x1 - x0, axis=1).max()
    ends = np.array(list(product(strands.edges.tolist(), repeat=2)))
    for counts in product((-2, -1, 0, 1, 2), repeat=3):
        if any(counts):
            pairs0, pairs1 = x0[ends], x1[ends]
            pairs0[:, 1] += np.array(counts) @ cells[0]
            pairs1[:, 1] += np.array(counts) @ cells[1]
            least = sampled(pairs0, pairs1, n=41)
            for place in (0, 1):
                np.minimum.at(exact, ends[:, place], least[:, None])
    assert (values <= exact + 1e-12).all()
    drift = 4.0 * np.abs(cells[1] - cells[0]).sum()
    assert (values >= np.minimum(exact, values.max()) - motion - drift - 1e-6).all()
    counts = np.random.default_rng(seed).integers(-2, 3, (2, len(x0), 3))
    wrapped = values_of(x0 + counts[0] @ cells[0], x1 + counts[1] @ cells[1], strands, cells)
    assert wrapped == pytest.approx(values, rel=1e-6)


def test_two_strands_that_meet_only_in_another_image() -> None:
    cell = np.diag([10.0, 10, 10])
    x0 = np.array([[0.5, 0, 0], [0.5, 1, 0], [9.0, 0.5, -0.5], [9.0, 0.5, 0.5]])
    x1 = x0.copy()
    x1[2:, 0] = 11.0  # through the first one's image at x = 10.5
    table = table_of(np.stack([x0, x1]), Strands.from_lengths([2, 2]), cell)
    assert table.verdict.tolist() == [Verdict.CROSSING]
    assert table.profile.clearance[0].tolist() == [0.0] * 4


def test_a_vertex_without_a_pair_has_no_value() -> None:
    x = np.cumsum(np.ones((3, 3)), axis=0)
    table = table_of(np.stack([x, x]), Strands.from_lengths([3]))
    assert np.isnan(table.clearance).all()
    assert len(table.profile) == 0


@pytest.mark.parametrize(("lengths", "closed"), [([120], [False]), ([60, 3, 2, 40], [False, False, False, True])])
@pytest.mark.parametrize("size", [0.02, 0.3, 1.5])
def test_what_is_passed_over_would_lower_nothing(lengths: list[int], closed: list[bool], size: float) -> None:
    for seed in range(3):
        x0, strands = chains(lengths, closed, seed)
        rng, t, none = np.random.default_rng(seed), Traces.of(strands), np.zeros((3, 3))
        x0 *= rng.uniform(0.5, 1.5, 3)  # so that edges differ in length, and in how near the next ones are
        x1 = x0 + rng.normal(0, size, x0.shape)
        motion = StepMotion(x0, x1, none, none, False, (0.0, 0.0, 0.0), True, 0.0)
        slack = PLACING_ERROR * np.abs([x0, x1]).max() + LEAST_SLACK
        both = combinations(range(len(t.edges)), 2)
        pairs = np.array([(i, j) for i, j in both if not set(t.edges[i]) & set(t.edges[j])])
        expected = np.full(len(t.edges), np.inf)
        no_images = np.empty((0, 3), dtype=np.int64)
        lower_bounds(pairs, no_images, motion, t.edges, slack, 0.0, expected)
        expected = np.minimum(expected, WIDEST_REACH * mean_edge_length(spheres_of(motion, t.edges)))
        found = edge_clearances(motion, False, t.edges, t.following, t.trace, t.local_pairs)
        np.testing.assert_array_equal(found, expected)
        assert size > 1.0 or len(set(found.tolist())) > len(found) // 3


def test_of_two_strands_far_from_each_other_no_value_exceeds_four_edges() -> None:
    rods = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 3.9], [1, 0, 3.9], [0, 0, 100.0], [1, 0, 100.0]])
    strands = Strands.from_lengths([2, 2, 2])
    assert values_of(rods, rods, strands) == pytest.approx([3.9] * 4 + [4.0] * 2, rel=1e-6)
    rods[2:4, 2] = 4.1
    assert values_of(rods, rods, strands).tolist() == [4.0] * 6
