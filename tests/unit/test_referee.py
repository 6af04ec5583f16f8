"""The slow judge behind ``mdtopo verify``: against another judge, by hand, and against the true answers of engines."""

import gzip
import json
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.distances import image_terms
from soundness.families import FAMILIES

from mdtopo import polyline_step
from mdtopo.errors import AuditError
from mdtopo.pipeline.tables import open_input
from mdtopo.records import Frame, MonitorConfig, Strands
from mdtopo.referee import Meeting, StepCase, cells, distances, judge_pair, open_step, paths, polynomials, search

Points = NDArray[np.float64]
BAR = [[-1, 0, 0], [1, 0, 0]]
grid = st.integers(-2, 2)
four_points = st.lists(st.lists(grid, min_size=3, max_size=3), min_size=4, max_size=4)
SKEWED = np.array([[8.0, 0.0, 0.0], [3.0, 7.0, 0.0], [-2.0, 3.0, 6.5]])


def frame(x: Any, cell: Any = None, *, index: int = 0, time: float = np.nan) -> Frame:
    box = None if cell is None else np.asarray(cell, dtype=np.float64)
    return Frame(index, time, np.asarray(x, dtype=np.float64), box)


def step(
    x0: Any, x1: Any, strands: Strands, cell0: Any = None, cell1: Any = None, *, rigid: bool = False
) -> StepCase | str:
    frames = frame(x0, cell0), frame(x1, cell1 if cell1 is not None else cell0, index=1)
    return open_step(*frames, strands, (), rigid=rigid, periodic=cell0 is not None)


def case(*arguments: Any, **options: Any) -> StepCase:
    found = step(*arguments, **options)
    assert isinstance(found, StepCase), found
    return found


def chains(rng: np.random.Generator, lengths: Sequence[int], bond: float = 1.0, size: float = 2.0) -> Points:
    starts = [rng.normal(0, size, 3) + np.cumsum(rng.normal(0, bond / 1.7, (n, 3)), axis=0) for n in lengths]
    return np.concatenate(starts)


# --- polynomials ------------------------------------------------------------------------------------------------------


def product_of(*factors: tuple[int, ...]) -> tuple[int, ...]:
    total: tuple[int, ...] = (1,)
    for factor in factors:
        total = polynomials.times(total, factor)
    return total


@pytest.mark.parametrize(
    ("factors", "roots"),
    [
        ([(-1, 3)], [Fraction(1, 3)]),
        ([(-1, 2), (-1, 2), (-3, 4)], [Fraction(1, 2), Fraction(3, 4)]),  # a double root
        ([(0, 1), (-1, 1), (-1, 8)], [0, Fraction(1, 8), 1]),  # both ends
        ([(1, 0, 1)], []),
        ([(-(2**60), 2**60 + 1), (-(2**60) + 1, 2**60)], [Fraction(2**60, 2**60 + 1), 1 - Fraction(1, 2**60)]),
        ([(7,)], []),
    ],
)
def test_roots_of_products(factors: list[tuple[int, ...]], roots: list[Fraction]) -> None:
    p = product_of(*factors)
    found = polynomials.unit_roots(p)
    middles = [root.fine().middle for root in found]
    assert len(found) == len(roots)
    assert all(abs(one - other) < Fraction(1, 2**120) for one, other in zip(middles, sorted(roots), strict=True))
    assert [polynomials.sign_at(p, root) for root in found] == [0] * len(roots)


@given(st.lists(st.integers(-9, 9), max_size=5), st.lists(st.integers(-9, 9), min_size=1, max_size=4))
def test_roots_and_signs_agree_with_sturm_sequences(first: list[int], second: list[int]) -> None:
    p, q = polynomials.trimmed(first), polynomials.trimmed(second)
    if not q:
        return
    fractions = [Fraction(x) for x in p], [Fraction(x) for x in q]
    ours, theirs = polynomials.unit_roots(q), oracles.polynomials.unit_roots(fractions[1])
    assert len(ours) == len(theirs)
    for root, other in zip(ours, theirs, strict=True):
        assert abs(root.fine().middle - other.middle) < Fraction(1, 2**90)
        assert polynomials.sign_at(p, root) == oracles.polynomials.sign_at(fractions[0], other)


def test_a_sign_changes_at_roots_of_odd_order_only() -> None:
    p = product_of((-1, 4), (-1, 2), (-1, 2), (-3, 4), (-3, 4), (-3, 4))
    assert [polynomials.turn_at(p, root) for root in polynomials.unit_roots(p)] == [-1, 0, 1]


# --- two edges --------------------------------------------------------------------------------------------------------


def agrees_with_the_oracle(start: Any, end: Any, scale: int = 1) -> tuple[Meeting, ...]:
    ours = judge_pair(*(np.rint(np.asarray(x) * scale).astype(object).tolist() for x in (start, end)))
    theirs = oracles.pair_passages(*([x[:2], x[2:]] for x in (start, end)))
    crossings = [m for m in ours if m.kind == "crossing"]
    for m, event in zip(crossings, theirs.events, strict=True):
        assert m.sign == event.sign
        assert (m.t, m.s, m.r) == pytest.approx((event.t, float(event.s), float(event.r)), rel=1e-12, abs=1e-13)
    contacts = [m for m in ours if m.kind != "crossing"]
    if any(contact.reason == "coplanar" for contact in theirs.contacts):
        assert {m.kind for m in contacts} == {"coplanar"}
        assert contacts[0].t == pytest.approx(float(theirs.contacts[0].t_low), abs=1e-12)
    else:
        assert [m.kind for m in contacts] == [contact.reason for contact in theirs.contacts]
    return ours


def test_a_passage_by_hand() -> None:
    start, end = [*BAR, [0, -1, 1], [0, 1, 1]], [*BAR, [0, -1, -2], [0, 1, -2]]
    assert judge_pair(start, end) == (Meeting(1 / 3, 1, 0.5, 0.5, "crossing"),)
    assert judge_pair(end, start) == (Meeting(2 / 3, -1, 0.5, 0.5, "crossing"),)


@pytest.mark.parametrize(("x", "kinds"), [(999, ["crossing"]), (1000, ["vertex"]), (1001, [])])
def test_near_misses_at_the_end_of_an_edge(x: int, kinds: list[str]) -> None:
    bar = [[-1000, 0, 0], [1000, 0, 0]]
    found = judge_pair([*bar, [x, -1, 1], [x, 1, 1]], [*bar, [x, -1, -2], [x, 1, -2]])
    assert [m.kind for m in found] == kinds


@pytest.mark.parametrize(
    ("start", "end", "kind"),
    [
        ([[0, -1, 0], [0, 1, 0]], [[0, -1, 1], [0, 1, 1]], "frame"),
        ([[0, -1, 1], [0, 1, 1]], [[0, -1, 0], [0, 1, 0]], "frame"),
        ([[2, 0, 0], [3, 0, 0]], [[0, 0, 0], [3, 0, 0]], "coplanar"),
        ([[0, 1, 0], [0, 3, 0]], [[0, -1, 0], [0, 1, 0]], "coplanar"),
        ([[-1, 0, 2], [1, 0, 2]], [[-1, 0, -2], [1, 0, -2]], "coplanar"),
    ],
)
def test_contacts_that_are_no_crossing(start: Any, end: Any, kind: str) -> None:
    found = judge_pair([*BAR, *start], [*BAR, *end])
    assert found
    assert {m.kind for m in found} == {kind}
    assert {m.sign for m in found} == {0}


@settings(max_examples=200)
@given(four_points, four_points)
def test_small_integers_agree_with_the_other_judge(start: Any, end: Any) -> None:
    agrees_with_the_oracle(start, end)


@pytest.mark.parametrize("family", [name for name in FAMILIES if name != "extreme scales"])
def test_hard_motions_agree_with_the_other_judge(family: str) -> None:
    starts, ends = FAMILIES[family](np.random.default_rng(5), 25)
    for x0, x1 in zip(starts, ends, strict=True):
        numbers = paths_of_numbers(x0, x1)
        ours = judge_pair(numbers[:4], numbers[4:])
        theirs = oracles.pair_passages([x0[:2], x0[2:]], [x1[:2], x1[2:]])
        assert [m.sign for m in ours if m.sign] == [event.sign for event in theirs.events]
        assert bool([m for m in ours if not m.sign]) == bool(theirs.contacts)


def paths_of_numbers(x0: Points, x1: Points) -> list[list[int]]:
    from mdtopo.referee.steps import _whole_numbers

    return _whole_numbers([x0, x1])


def test_floats_are_taken_as_they_are_stored() -> None:
    assert paths_of_numbers(np.array([[0.5, 3.0, -0.125]]), np.array([[1e300, 0.0, 2.0]])) == [
        [4, 24, -1],
        [int(1e300) * 8, 0, 16],
    ]


# --- whole steps ------------------------------------------------------------------------------------------------------


def events_of(found: oracles.Passages) -> list[Any]:
    return sorted((e.first, e.second, e.sign, e.shift, e.t) for e in found.events)


def ordered(event: tuple[Any, ...]) -> tuple[Any, ...]:
    first, second, sign, shift, t = event
    if first[0] > second[0]:
        first, second, shift = second, first, tuple(-k for k in shift)
    return (first, second, sign, shift), t


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("lengths", [[12], [7, 6, 1 + 4], [4, 5]])
def test_all_crossings_of_free_chains(seed: int, lengths: list[int]) -> None:
    rng = np.random.default_rng(seed)
    closed = [n > 3 and seed % 2 == 1 for n in lengths]
    strands = Strands.from_lengths(lengths, closed=closed)
    x0, x1 = chains(rng, lengths), chains(rng, lengths)
    crossings, contacts = case(x0, x1, strands).meetings or ((), ())
    theirs = oracles.passages(x0, x1, strands.offsets.tolist(), closed)
    want = dict(ordered(e) for e in events_of(theirs))
    got = {(c.edges[0], c.edges[1], c.sign, c.image): c.t for c in crossings}
    assert got == pytest.approx(want)
    assert contacts == ()


@pytest.mark.parametrize("seed", [0, 4, 7, 9, 11, 12])  # in which edges pass
def test_all_crossings_in_a_cell_that_changes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    strands = Strands.from_lengths([5, 4], closed=[False, True])
    cell0 = 0.6 * SKEWED
    cell1 = cell0 * 1.03
    ring = np.array([[0.6, 0, 0], [0, 0.6, 0], [-0.6, 0, 0], [0, -0.6, 0]])
    x0 = np.concatenate([chains(rng, [5], 1.2, 0.3), 1.5 * ring + rng.normal(0, 0.1, (4, 3))])
    x1 = x0 + rng.normal(0, 0.5, x0.shape)
    moved = [x + rng.integers(-2, 3, x.shape) @ cell for x, cell in ((x0, cell0), (x1, cell1))]
    found = case(*moved, strands, cell0, cell1)
    crossings, contacts = found.meetings or ((), ())
    # the same path, whole, for the other judge; an image there counts from the whole strands
    whole0, whole1 = found.path.ends
    theirs = oracles.passages(whole0, whole1, [0, 5, 9], [False, True], cell0=cell0, cell1=cell1)
    counts = found.path.counts0
    want = {}
    for event in events_of(theirs):
        (first, second, sign, shift), t = ordered(event)
        image = tuple((np.array(shift) + counts[second[0]] - counts[first[0]]).tolist())
        want[first, second, sign, image] = t
    assert len(want) > 0
    assert {(c.edges[0], c.edges[1], c.sign, c.image): c.t for c in crossings} == pytest.approx(want)
    assert contacts == ()
    assert found.separation == pytest.approx(oracles.nu(whole0, [0, 5, 9], [False, True], cell0).value, rel=1e-12)


def test_the_image_of_a_crossing_counts_from_stored_vertices() -> None:
    strands, cell = Strands.from_lengths([2, 2]), np.diag([10.0, 11.0, 12.0])
    x0 = np.array([[4.0, 5, 5], [6, 5, 5], [5, 4, 6], [5, 6, 6]])
    x1 = x0 - np.array([[0, 0, 0], [0, 0, 0], [0, 0, 2], [0, 0, 2.0]])
    stored = x0 + np.array([[0, 0, 0], [1, 0, 0], [0, -2, 1], [0, 0, 0]]) @ cell
    (crossing,), _ = case(stored, x1, strands, cell).meetings or ((), ())
    assert crossing.edges == ((0, 1), (2, 3))
    assert (crossing.t, crossing.parameters, crossing.sign) == (0.5, (0.5, 0.5), 1)
    assert crossing.image == (0, 2, -1)


def read_truth(path: Path) -> Any:
    with gzip.open(path) as file:
        return json.load(file)


@pytest.mark.parametrize("stride", [1, 5, 10])
def test_the_true_crossings_of_soft_chains(shared_data: Path, stride: int) -> None:
    truth = read_truth(shared_data / "soft" / "soft.truth.json.gz")
    events = truth[f"stride{stride}"]["crossings"]
    reader = open_input(shared_data / "soft" / "soft.data", shared_data / "soft" / "soft_fine.dcd")
    chosen = sorted({(e["frame0"], e["frame1"]) for e in events})[:6]
    for t0, t1 in chosen:
        x0, x1 = (next(reader.frames(k, k + 1)).positions for k in (t0, t1))
        crossings, contacts = case(x0, x1, Strands.from_lengths([100] * 20), truth["H"]).meetings or ((), ())
        here = [e for e in events if e["frame0"] == t0]
        # these files give the sign that the volume has before the crossing
        want = {(*e["seg_i"], *e["seg_j"], -e["sign"], *e["shift"]): (e["t"], e["s"], e["u"]) for e in here}
        got = {(*c.edges[0], *c.edges[1], c.sign, *c.image): (c.t, *c.parameters) for c in crossings}
        assert got.keys() == want.keys()
        for key, place in want.items():
            assert got[key] == pytest.approx(place, abs=1e-9)
        assert contacts == ()
    reader.close()


# --- paths ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_numbers_of_a_step_agree_with_the_job(seed: int, periodic: bool, rigid: bool) -> None:
    rng = np.random.default_rng(seed)
    strands = Strands.from_lengths([20, 15, 10], closed=[False, True, False])
    t = np.linspace(0, 2 * np.pi, 16)[:-1]
    ring = 2.0 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    x0 = np.concatenate([chains(rng, [20]), ring, chains(rng, [10])])
    angle = 0.1
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    x1 = (x0 + rng.normal(0, 0.02, x0.shape)) @ turn.T
    cell = SKEWED if periodic else None
    if periodic:
        x0, x1 = (x + rng.integers(-1, 2, x.shape) @ SKEWED for x in (x0, x1))
    config = MonitorConfig(motion="rigid" if rigid else "lab")
    job = polyline_step(x0, x1, strands, cell_t0=cell, cell_t1=cell, config=config)
    found = case(x0, x1, strands, cell, rigid=rigid)
    assert found.displacement == pytest.approx(job.displacement_max, rel=1e-12)
    assert found.separation == pytest.approx(job.nu, rel=1e-12)
    assert found.angle == pytest.approx(job.rotation_angle, abs=1e-9)
    claimed = np.array([job.clearance_local, job.clearance_self, job.clearance_inter])
    near = found.least_distances(claimed + 0.5)
    assert near is not None
    assert (near >= claimed - 1e-12).all()
    assert np.isfinite(near).any()


@pytest.mark.parametrize(
    ("closed", "broken", "pieces"),
    [
        (False, [], [[0, 1, 2, 3, 4]]),
        (False, [(1, 2)], [[0, 1], [2, 3, 4]]),
        (False, [(0, 1), (3, 4)], [[0], [1, 2, 3], [4]]),
        (True, [], [[0, 1, 2, 3, 4]]),
        (True, [(1, 2)], [[2, 3, 4, 0, 1]]),
        (True, [(4, 0)], [[0, 1, 2, 3, 4]]),
        (True, [(0, 1), (4, 0)], [[1, 2, 3, 4], [0]]),
    ],
)
def test_strands_are_cut_at_broken_edges(closed: bool, broken: list[tuple[int, int]], pieces: list[list[int]]) -> None:
    found = paths.pieces_of(Strands.from_lengths([5], closed=closed), broken)
    assert [piece.vertices.tolist() for piece in found] == pieces
    assert {piece.is_closed for piece in found} == {closed and not broken}
    edges = {tuple(edge) for piece in found for edge in piece.edges.tolist()}
    every = {*pairwise(range(5)), *([(4, 0)] if closed else [])}
    assert edges == every - set(broken)


def test_a_broken_edge_lets_others_pass() -> None:
    strands = Strands.from_lengths([2, 2])
    x0 = np.array([*BAR, [0, -1, 1], [0, 1, 1]], dtype=float)
    x1 = x0 - np.array([[0, 0, 0], [0, 0, 0], [0, 0, 2], [0, 0, 2.0]])
    frames = frame(x0), frame(x1)
    whole = open_step(*frames, strands, (), rigid=False, periodic=False)
    cut = open_step(*frames, strands, [(2, 3)], rigid=False, periodic=False)
    assert isinstance(whole, StepCase)
    assert isinstance(cut, StepCase)
    assert len((whole.meetings or [()])[0]) == 1
    assert cut.meetings == ((), ())


LINE = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
CUBE = 10.0 * np.eye(3)


@pytest.mark.parametrize(
    ("one", "other", "periodic", "words"),
    [
        (frame(LINE), frame(LINE * np.nan, index=7), False, "frame 7 has coordinates that are no numbers"),
        (frame(LINE), frame(LINE * 1e13), False, "too large"),
        (frame(LINE, CUBE), frame(LINE), True, "has no periodic box"),
        (frame(LINE), frame(LINE, CUBE), False, "has a periodic box"),
        (frame(LINE, CUBE), frame(LINE, 0 * CUBE), True, "has no volume"),
        (frame(LINE, CUBE), frame(LINE, 1e-100 * CUBE), True, "has no volume"),
        (frame(LINE, CUBE), frame(LINE, CUBE[[0, 1, 1]] + 1e-12), True, "has no volume"),
        (frame(LINE, time=2.0), frame(LINE, time=2.0), False, "does not come after"),
        (frame(LINE, CUBE), frame(LINE, np.diag([10.0, 10.0, 200.0])), True, "changes too much"),
    ],
)
def test_steps_that_cannot_be_judged(one: Frame, other: Frame, periodic: bool, words: str) -> None:
    found = open_step(one, other, Strands.from_lengths([3]), (), rigid=False, periodic=periodic)
    assert isinstance(found, str)
    assert words in found


def test_unknown_and_rising_times_are_no_objection() -> None:
    for times in ((np.nan, np.nan), (1.0, 1.0 + 1e-9)):
        frames = [frame(LINE, time=time) for time in times]
        assert isinstance(open_step(*frames, Strands.from_lengths([3]), (), rigid=False, periodic=False), StepCase)


def test_a_ring_through_the_boundary_cannot_be_judged() -> None:
    x = np.array([[0.0, 0, 0], [3, 0, 0], [6, 0, 0]])
    ring = Strands.from_lengths([3], closed=True)
    assert "closes through the periodic boundary" in str(step(x, x, ring, 9.0 * np.eye(3)))
    assert isinstance(step(x, x, ring, 30.0 * np.eye(3)), StepCase)


def test_too_many_images_are_said() -> None:
    x = np.array([[0.0, 0, 0], [9, 0, 0], [18, 0, 0]])
    found = case(x, x, Strands.from_lengths([3]), np.diag([40.0, 0.2, 0.2]))
    assert found.meetings is None
    assert found.separation is None
    assert found.least_distances(np.array([1.0, 1.0, 1.0])) is None


def test_a_rotation_that_is_none_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paths, "best_rotations", lambda *_: -np.eye(3)[np.newaxis])
    with pytest.raises(AuditError, match="no rotation"):
        step(LINE, LINE, Strands.from_lengths([3]), rigid=True)


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 1.0, 89.0, 120.0, 179.0, 180.0])
def test_angles_of_rotations(degrees: float) -> None:
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    assert paths.angle_of(turn) == pytest.approx(degrees, abs=1e-6)


# --- cells ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_short_vectors_and_nearest_images(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cell = np.array([[1, 0, 0], [rng.integers(-9, 9), 1, 0], [rng.integers(-9, 9), rng.integers(-9, 9), 1]]) @ SKEWED
    counts = cells.short_vectors(cell)
    assert round(abs(np.linalg.det(counts))) == 1
    basis = counts @ cell
    lengths = np.linalg.norm(basis, axis=1)
    lattice = np.array([s for s in product(range(-3, 4), repeat=3) if any(s)]) @ basis
    assert lengths.min() <= np.linalg.norm(lattice, axis=1).min() + 1e-9
    differences = rng.normal(0, 10, (20, 3))
    nearest = differences + cells.nearest_counts(differences, basis) @ basis
    for one, other in zip(nearest, differences, strict=True):
        brute, _ = oracles.nearest_image_brute(other - np.rint(other @ np.linalg.inv(basis)) @ basis, basis)
        assert np.linalg.norm(one) == pytest.approx(np.linalg.norm(brute))


def test_a_flipped_cell_is_the_same_cell() -> None:
    flip = np.array([[1, 0, 0], [1, 1, 0], [0, -1, 1]])
    matched = cells.matched_counts(SKEWED, flip @ SKEWED * 1.01)
    assert np.allclose(matched @ flip, np.eye(3))
    strands = Strands.from_lengths([3, 3])
    x = np.concatenate([LINE, LINE + np.array([0, 1, 1])])
    plain, flipped = case(x, x, strands, SKEWED), case(x, x, strands, SKEWED, flip @ SKEWED)
    assert flipped.displacement == pytest.approx(plain.displacement, abs=1e-12) == 0.0


# --- search and distances ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reach", [0.2, 0.7])
def test_no_pair_within_reach_is_missed(reach: float) -> None:
    rng = np.random.default_rng(2)
    strands = Strands.from_lengths([6, 5])
    x0 = chains(rng, [6, 5])
    x1 = x0 + rng.normal(0, 0.3, x0.shape)
    cell = 0.6 * SKEWED
    found = case(x0, x1, strands, cell, cell * 1.02)
    edges = found.edges
    pairs = search.near_pairs(found.path, edges, reach)
    assert pairs is not None
    listed = list(zip(pairs.first.tolist(), pairs.second.tolist(), map(tuple, pairs.image.tolist()), strict=True))
    assert len(listed) == len(set(listed))
    index = {tuple(edge): k for k, edge in enumerate(edges.tolist())}
    ends = found.path.ends
    n = 0
    for first, second, *_ in image_terms([0, 6, 11], [False, False]):
        for shift in product(range(-2, 3), repeat=3):
            i, j = index[first], index[second]
            if shift == (0, 0, 0) and set(first) & set(second):
                continue
            start, end = (
                [x[list(first)], x[list(second)] + np.array(shift) @ h]
                for x, h in zip(ends, found.path.cells or (), strict=True)
            )
            if oracles.sampled_distance_during(start, end, n=9) <= reach:
                n += 1
                assert (i, j, shift) in listed or (i == j and (i, j, tuple(-k for k in shift)) in listed)
    assert n > 2


@pytest.mark.parametrize("family", ["random", "near touching", "near parallel", "lattice points", "coplanar"])
def test_distances_agree_with_going_through_every_case(family: str) -> None:
    points = FAMILIES[family](np.random.default_rng(1), 60)[0]
    ours = distances.edge_distances(points)
    theirs = [float(oracles.squared_edge_distance_exact(*four)) ** 0.5 for four in points.tolist()]
    assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-13)


def test_filters_keep_what_meets() -> None:
    rng = np.random.default_rng(3)
    x0, x1 = FAMILIES["grazing"](rng, 20)
    strands = Strands.from_lengths([2] * 40)
    found = case(x0.reshape(-1, 3), x1.reshape(-1, 3), strands)
    expected = sum(
        len(oracles.pair_passages([a[:2], a[2:]], [b[:2], b[2:]]).events) for a, b in zip(x0, x1, strict=True)
    )
    crossings, _ = found.meetings or ((), ())
    mine = [c for c in crossings if c.edges[1][0] == c.edges[0][0] + 2 and c.edges[0][0] % 4 == 0]
    assert len(mine) == expected > 0


def test_separation_of_lone_triangles_and_nothing() -> None:
    triangle = np.array([[0.0, 0, 0], [2, 0, 0], [1, 1, 0]])
    assert case(triangle, triangle, Strands.from_lengths([3], closed=True)).separation == pytest.approx(1.0)
    bar = np.array([[0.0, 0, 0], [2, 0, 0]])
    assert case(bar, bar, Strands.from_lengths([2])).separation == pytest.approx(2.0)
    cut = open_step(frame(bar), frame(bar), Strands.from_lengths([2]), [(0, 1)], rigid=True, periodic=False)
    assert isinstance(cut, StepCase)
    assert cut.separation == np.inf
    assert cut.meetings == ((), ())


def test_classes_of_pairs() -> None:
    pieces = paths.pieces_of(Strands.from_lengths([6, 4, 4], closed=[True, True, False]), ())
    first, second = np.array([0, 0, 0, 6, 6, 0]), np.array([2, 3, 4, 8, 10, 2])
    image = np.zeros((6, 3), dtype=np.int64)
    image[5, 0] = 1
    kinds = distances.classes(search.Pairs(first, second, image), pieces)
    assert kinds.tolist() == [0, 1, 0, 0, 2, 1]
