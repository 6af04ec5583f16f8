"""The judge of passages: hand values, near misses, invariances, and the true answers of real engines."""

import gzip
import json
from collections.abc import Sequence
from fractions import Fraction
from math import sqrt
from pathlib import Path
from typing import Any

import cases
import numpy as np
import oracles
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

HALF = Fraction(1, 2)
LITTLE = Fraction(1, 10**12)
X_EDGE = [[-1, 0, 0], [1, 0, 0]]
STILL = [X_EDGE, X_EDGE]

Motion = tuple[list[list[list[Any]]], list[list[list[Any]]]]

grid = st.integers(-3, 3)
four_points = st.lists(st.lists(grid, min_size=3, max_size=3), min_size=4, max_size=4)


def motion(second0: Sequence[Any], second1: Sequence[Any], first: Sequence[Any] = STILL) -> Motion:
    """A pair of edges, the first at rest along x unless told."""
    return [list(first[0]), list(second0)], [list(first[1]), list(second1)]


def lowered(x: Any, z0: Any, z1: Any) -> Motion:
    """An edge along y above the x axis at x, lowered from z0 to z1."""
    return motion([[x, -1, z0], [x, 1, z0]], [[x, -1, z1], [x, 1, z1]])


def summary(found: oracles.Passages) -> tuple[list[Any], list[Any]]:
    return (
        [(e.t_low, e.t_high, e.s, e.r, e.sign) for e in found.events],
        [(c.t_low, c.t_high, c.reason) for c in found.contacts],
    )


def test_a_passage_by_hand() -> None:
    event = (Fraction(1, 3), Fraction(1, 3), Fraction(3, 4), HALF, 1)
    assert summary(oracles.pair_passages(*lowered(HALF, 1, -2))) == ([event], [])


@pytest.mark.parametrize("x", [1 + LITTLE, -1 - LITTLE, 5])
def test_a_miss_beside_the_edge(x: Fraction) -> None:
    assert oracles.is_free(*lowered(x, 1, -2))


@pytest.mark.parametrize("x", [1 - LITTLE, -1 + LITTLE])
def test_a_passage_close_to_the_end_of_the_edge(x: Fraction) -> None:
    events, contacts = summary(oracles.pair_passages(*lowered(x, 1, -2)))
    assert events == [(Fraction(1, 3), Fraction(1, 3), (1 + x) / 2, HALF, 1)]
    assert not contacts


@pytest.mark.parametrize("x", [1, -1])
def test_a_passage_through_a_vertex_is_a_contact(x: int) -> None:
    found = oracles.pair_passages(*lowered(x, 1, -2))
    assert summary(found) == ([], [(Fraction(1, 3), Fraction(1, 3), "vertex")])


@pytest.mark.parametrize(("z0", "z1", "t"), [(1, 0, 1), (0, 1, 0), (0, -1, 0)])
def test_contact_in_a_saved_frame(z0: int, z1: int, t: int) -> None:
    assert summary(oracles.pair_passages(*lowered(HALF, z0, z1))) == ([], [(t, t, "frame")])


def test_near_misses_of_a_saved_frame() -> None:
    assert oracles.is_free(*lowered(HALF, 1, LITTLE))
    (event,) = oracles.pair_passages(*lowered(HALF, 1, -LITTLE)).events
    assert event.t_low == event.t_high == 1 / (1 + LITTLE)


def dipping(gap: Fraction) -> Motion:
    """Two edges whose signed gap is (2t - 1)²/2 + gap: they come near and go back on the same side.

    The first has the height h·x with h = 2t - 1; the second lies along y at x = h/2 and at height -gap.
    """
    first = [[[-1, 0, -h], [1, 0, h]] for h in (-1, 1)]
    second = [[[h * HALF, -1, -gap], [h * HALF, 1, -gap]] for h in (-1, 1)]
    return motion(*second, first=first)


def test_a_touch_lies_between_a_miss_and_two_passages() -> None:
    assert oracles.is_free(*dipping(LITTLE))
    assert summary(oracles.pair_passages(*dipping(Fraction(0)))) == ([], [(HALF, HALF, "touch")])
    found = oracles.pair_passages(*dipping(-LITTLE))
    first, second = found.events
    assert first.t_high < HALF < second.t_low
    assert first.sign == -second.sign
    assert (2 * first.t - 1) ** 2 == pytest.approx(float(2 * LITTLE), rel=1e-6)
    assert not found.contacts


def falling(x: Fraction | int) -> Motion:
    """An edge of length 4 that turns while it falls; at t = 1/2 it lies on the x axis and begins at x."""
    ends = [[[x, -y, y], [x + 4, y, y]] for y in (1, -1)]
    return motion(*ends)


def test_edges_that_are_parallel_when_they_touch() -> None:
    contact = (HALF, HALF, "parallel")
    assert summary(oracles.pair_passages(*falling(-2))) == ([], [contact])
    assert summary(oracles.pair_passages(*falling(1))) == ([], [contact])
    assert oracles.is_free(*falling(1 + LITTLE))


def test_three_passages_of_one_pair() -> None:
    x0 = [[2, 2, 2], [-2, 1, 1], [-2, 1, 2], [2, 1, -1]]
    x1 = [[-3, 2, 1], [2, -2, -2], [-1, 2, 0], [-1, 0, 3]]
    found = oracles.pair_passages([x0[:2], x0[2:]], [x1[:2], x1[2:]])
    assert [e.sign for e in found.events] == [1, -1, 1]
    assert found.contacts == ()


@pytest.mark.parametrize(("y", "expected"), [(0, [(0, 1, "coplanar")]), (LITTLE, [])])
def test_a_vertex_that_slides_along_an_edge(y: Fraction, expected: list[Any]) -> None:
    found = oracles.pair_passages(*motion([[0, y, 0]] * 2, [[HALF, y, 0]] * 2))
    assert summary(found) == ([], expected)


def test_two_vertices_that_meet() -> None:
    pair0 = [[[0, 0, 0]] * 2, [[3, 3, 3]] * 2]
    found = oracles.pair_passages(pair0, [[[1, 1, 1]] * 2, [[0, 0, 0]] * 2])
    assert summary(found) == ([], [(Fraction(3, 4), Fraction(3, 4), "coplanar")])
    assert oracles.is_free(pair0, [[[1, 1, 1]] * 2, [[0, 0, LITTLE]] * 2])


def test_two_separate_contacts_in_one_plane() -> None:
    pair0 = [[[-2, 1, 0], [-1, 1, 0]], [[3, 1, 0], [-1, 1, 0]]]
    pair1 = [[[1, 3, 0], [-2, -1, 0]], [[0, -3, 0], [-2, 1, 0]]]
    found = oracles.pair_passages(pair0, pair1)
    assert summary(found) == ([], [(0, 0, "coplanar"), (Fraction(1, 4), 1, "coplanar")])


@settings(max_examples=80)
@given(four_points, four_points, st.booleans())
def test_contact_is_where_the_exact_distance_is_zero(x0: list[list[int]], x1: list[list[int]], in_plane: bool) -> None:
    if in_plane:
        x0, x1 = ([[p[0], p[1], p[0] - p[1]] for p in x] for x in (x0, x1))
    found = oracles.pair_passages([x0[:2], x0[2:]], [x1[:2], x1[2:]])
    meetings = [*found.events, *found.contacts]
    times = {Fraction(k, 24) for k in range(25)} | {t for m in meetings for t in (m.t_low, m.t_high)}
    for t in times:
        inside = [m for m in meetings if m.t_low <= t <= m.t_high]
        at_t = [[(1 - t) * p + t * q for p, q in zip(a, b, strict=True)] for a, b in zip(x0, x1, strict=True)]
        distance = oracles.squared_edge_distance_exact(*at_t)
        if any(m.t_low == m.t_high or m.t_low < t < m.t_high for m in inside) or not inside:
            assert (distance == 0) == bool(inside)
        else:  # one end of the enclosure of an irrational time
            assert distance < Fraction(1, 2**100)


def changed(pair: Any, change: Any) -> Any:
    return [[change(point) for point in edge] for edge in pair]


def outcome(pair0: Any, pair1: Any) -> list[Any]:
    """The crossings, their numbers rounded: an irrational time has more than one enclosure."""
    found = oracles.pair_passages(pair0, pair1).events
    return sorted((round(e.t, 10), round(float(e.s), 9), round(float(e.r), 9), e.sign) for e in found)


@settings(max_examples=60)
@given(four_points, four_points)
def test_invariances_of_passages(x0: list[list[int]], x1: list[list[int]]) -> None:
    pairs = [x0[:2], x0[2:]], [x1[:2], x1[2:]]
    found = outcome(*pairs)

    def become(*expected: tuple[float, float, float, int]) -> Any:
        return [pytest.approx(event, abs=1e-8) for event in sorted(expected)]

    assert outcome(*([f, e] for e, f in pairs)) == become(*((t, r, s, n) for t, s, r, n in found))
    assert outcome(*([e[::-1], f] for e, f in pairs)) == become(*((t, 1 - s, r, -n) for t, s, r, n in found))
    both = ([e[::-1], f[::-1]] for e, f in pairs)
    assert outcome(*both) == become(*((t, 1 - s, 1 - r, n) for t, s, r, n in found))
    assert outcome(*pairs[::-1]) == become(*((1 - t, s, r, -n) for t, s, r, n in found))
    mirrored = (changed(pair, lambda p: [p[0], p[1], -p[2]]) for pair in pairs)
    assert outcome(*mirrored) == become(*((t, s, r, -n) for t, s, r, n in found))
    turned = (changed(pair, lambda p: [p[1] + 7, p[2] - 1, p[0]]) for pair in pairs)
    assert outcome(*turned) == become(*found)
    sheared = (changed(pair, lambda p: [2 * p[0] + p[1], p[1], 3 * p[2] - p[0]]) for pair in pairs)
    assert outcome(*sheared) == become(*found)


def test_invariances_of_a_pair_with_three_passages() -> None:
    x0 = [[2, 2, 2], [-2, 1, 1], [-2, 1, 2], [2, 1, -1]]
    x1 = [[-3, 2, 1], [2, -2, -2], [-1, 2, 0], [-1, 0, 3]]
    test_invariances_of_passages.hypothesis.inner_test(x0, x1)


@settings(max_examples=60)
@given(four_points, four_points)
def test_freedom_is_the_truth_about_the_distance(x0: list[list[int]], x1: list[list[int]]) -> None:
    pair0, pair1 = [x0[:2], x0[2:]], [x1[:2], x1[2:]]
    low, high = oracles.least_distance_during(pair0, pair1, tolerance=1e-4)
    assert high <= low + 1e-4 + 1e-12
    assert 0 <= low <= oracles.sampled_distance_during(pair0, pair1, n=20) + 1e-12
    if not oracles.is_free(pair0, pair1):
        assert low == 0
    elif low == 0:  # too near to tell: look closer
        low, _ = oracles.least_distance_during(pair0, pair1, tolerance=1e-9)
        assert low > 0


def test_least_distance_during_by_hand() -> None:
    # from (1, *, 1/2) on, an edge moves away over the end of the other
    below = [[[-1, 0, 0], [1, 0, 0]], [[1, -1, HALF], [1, 1, HALF]]]
    above = [[[-1, 0, 0], [1, 0, 0]], [[7, -1, HALF], [7, 1, HALF]]]
    low, high = oracles.least_distance_during(below, above)
    assert low <= 0.5 == high
    passing = [[[-1, 0, 0], [1, 0, 0]], [[4, -1, 1], [4, 1, 1]]]
    beyond = [[[-1, 0, 0], [1, 0, 0]], [[-2, -1, -1], [-2, 1, -1]]]
    assert oracles.least_distance_during(passing, beyond)[0] == 0
    # a vertex comes to (2, 0, 3), still beyond the end (1, 0, 0)
    dot0, dot1 = [X_EDGE, [[4, 0, 3]] * 2], [X_EDGE, [[2, 0, 3]] * 2]
    assert oracles.least_distance_during(dot0, dot1) == (pytest.approx(sqrt(10), abs=1e-6), sqrt(10))


@settings(max_examples=40)
@given(four_points, four_points)
def test_the_point_of_a_passage_lies_on_both_edges(x0: list[list[int]], x1: list[list[int]]) -> None:
    found = oracles.pair_passages([x0[:2], x0[2:]], [x1[:2], x1[2:]]).events
    assume(found)
    for event in found:
        a, b, c, d = (1 - event.t) * np.array(x0) + event.t * np.array(x1)
        s, r = float(event.s), float(event.r)
        np.testing.assert_allclose(a + s * (b - a), c + r * (d - c), atol=1e-12)
        assert 0 < event.s < 1
        assert 0 < event.r < 1


def two_random_pentagons(seed: int) -> tuple[list[list[int]], list[list[int]]]:
    x0, x1 = np.random.default_rng(seed).integers(-99, 100, size=(2, 10, 3)).tolist()
    return x0, x1


@pytest.mark.parametrize("seed", range(12))
def test_signs_add_up_to_the_change_of_linking_number(seed: int) -> None:
    x0, x1 = two_random_pentagons(seed)
    found = oracles.passages(x0, x1, [0, 5, 10], [True, True])
    assert not found.contacts
    between = [e.sign for e in found.events if e.first[0] < 5 <= e.second[0]]
    before, after = (oracles.linking_number_exact(x[:5], x[5:]) for x in (x0, x1))
    assert sum(between) == after - before


def test_some_random_steps_change_the_linking_number() -> None:
    steps = [two_random_pentagons(seed) for seed in range(12)]
    links = [[oracles.linking_number_exact(x[:5], x[5:]) for x in step] for step in steps]
    assert len({after - before for before, after in links}) >= 3


@pytest.mark.parametrize("seed", range(4))
def test_a_self_crossing_changes_the_writhe_by_twice_its_sign(seed: int) -> None:
    x0, x1 = np.random.default_rng(seed).integers(-99, 100, size=(2, 7, 3)).astype(np.float64)
    found = oracles.passages(x0, x1, [0, 7], [True]).events
    assert found
    for event in found:
        before, after = (oracles.writhe((1 - t) * x0 + t * x1) for t in (event.t - 1e-8, event.t + 1e-8))
        assert after - before == pytest.approx(2 * event.sign, abs=1e-4)


def test_relabelling_a_ring_moves_its_crossings_along() -> None:
    case = cases.polyline_cases()["T1"]
    for k in range(6):
        moved = [x[k:] + x[:k] for x in (case.x0, case.x1)]
        (event,) = oracles.passages(*moved, [0, 6], [True]).events
        edges = {frozenset((v + k) % 6 for v in edge) for edge in (event.first, event.second)}
        assert edges == {frozenset({0, 1}), frozenset({2, 3})}
        assert (event.t_low, event.sign) == (Fraction(59, 95), 1)


def test_only_a_ring_has_a_closing_edge() -> None:
    # the edge from the last to the first vertex rises through the edge (1, 2), and no other does
    x0 = [[-1, 0, -1], [0, -1, 0], [0, 1, 0], [5, 5, 5], [1, 0, -1]]
    x1 = [[-1, 0, 1], [0, -1, 0], [0, 1, 0], [5, 5, 5], [1, 0, 1]]
    (event,) = oracles.passages(x0, x1, [0, 5], [True]).events
    assert (event.first, event.second, event.t_low) == ((1, 2), (4, 0), HALF)
    assert oracles.passages(x0, x1, [0, 5], [False]) == oracles.Passages((), ())


def test_pairs_restrict_the_search() -> None:
    case = cases.polyline_cases()["T12"]
    everything = oracles.passages(case.x0, case.x1, case.offsets, case.closed)
    some = oracles.passages(case.x0, case.x1, case.offsets, case.closed, pairs=[((4, 5), (0, 1))])
    assert len(everything.events) == 2
    adjacent = oracles.passages(case.x0, case.x1, case.offsets, case.closed, pairs=[((2, 3), (3, 4))])
    assert adjacent == oracles.Passages((), ())
    assert [(e.first, e.second, e.s, e.r) for e in some.events] == [((4, 5), (0, 1), HALF, Fraction(2, 3))]


CELL = [[10, 0, 0], [0, 12, 0], [0, 0, 14]]


def test_a_passage_through_the_boundary() -> None:
    # the second strand is one cell off in x and two in z; the first rises through it
    x0 = [[-1, 0, 0], [1, 0, 0], [10, -1, 28 + HALF], [10, 1, 28 + HALF]]
    x1 = [[-1, 0, 1], [1, 0, 1], [10, -1, 28 + HALF], [10, 1, 28 + HALF]]
    assert oracles.passages(x0, x1, [0, 2, 4], [False, False]) == oracles.Passages((), ())
    (event,) = oracles.passages(x0, x1, [0, 2, 4], [False, False], cell0=CELL, cell1=CELL).events
    assert (event.shift, event.t_low, event.s, event.r) == ((-1, 0, -2), HALF, HALF, HALF)


def test_the_image_moves_with_the_cell() -> None:
    # strands at rest; the cell shrinks from 10 to 9 in z and lifts the image up through the first strand
    x = [[-1, 0, 0], [1, 0, 0], [0, -1, 9.75], [0, 1, 9.75]]
    cells = [[[20, 0, 0], [0, 20, 0], [0, 0, z]] for z in (10, 9)]
    (event,) = oracles.passages(x, x, [0, 2, 4], [False, False], cell0=cells[0], cell1=cells[1]).events
    assert (event.shift, event.t_low) == ((0, 0, -1), Fraction(1, 4))


def test_a_strand_passes_through_its_own_image() -> None:
    x0 = [[0, 0, 0], [4, 0, 0], [8, -3, 1], [8, 3, 1]]
    x1 = [[0, 0, 0], [4, 0, 0], [8, -3, -1], [8, 3, -1]]
    assert oracles.passages(x0, x1, [0, 4], [False]).events == ()
    cell = [[6, 0, 0], [0, 40, 0], [0, 0, 40]]
    (event,) = oracles.passages(x0, x1, [0, 4], [False], cell0=cell, cell1=cell).events
    assert (event.first, event.second, event.shift, event.t_low) == ((0, 1), (2, 3), (-1, 0, 0), HALF)


def test_a_strand_that_lies_on_its_own_image() -> None:
    x = [[0, 0, 0], [7, 0, 0]]
    cell = [[6, 0, 0], [0, 40, 0], [0, 0, 40]]
    found = oracles.passages(x, x, [0, 2], [False], cell0=cell, cell1=cell)
    assert [(c.first, c.second, c.shift) for c in found.contacts] == [((0, 1), (0, 1), (1, 0, 0))]
    assert found.events == ()


def read_truth(path: Path) -> Any:
    with gzip.open(path, "rt", encoding="utf-8") as file:
        return json.load(file)


def read_dcd(path: Path, frames: Sequence[int], n_atoms: int) -> list[Any]:
    """Return the coordinates of some frames of a little-endian DCD file that has a cell in every frame."""
    raw = np.memmap(path, dtype="<i4", mode="r")
    record = n_atoms + 2
    length = (12 + 2) + 3 * record  # the cell is six float64; every record stands between two counts of bytes
    start = len(raw) % length
    found = []
    for frame in frames:
        block = raw[start + frame * length :][14:length].reshape(3, record)
        assert (block[:, [0, -1]] == 4 * n_atoms).all()
        found.append(np.ascontiguousarray(block[:, 1:-1]).view("<f4").T)
    return found


def check_event(truth: Any, path: Path, strands: tuple[list[int], list[bool]], cell: Any) -> None:
    x0, x1 = read_dcd(path, (truth["frame0"], truth["frame1"]), strands[0][-1])
    pairs = [(truth["seg_i"], truth["seg_j"])]
    found = oracles.passages(x0, x1, *strands, cell0=cell, cell1=cell, pairs=pairs)
    assert not found.contacts
    (event,) = [e for e in found.events if e.t == pytest.approx(truth["t"], abs=1e-9)]
    assert (float(event.s), float(event.r)) == pytest.approx((truth["s"], truth["u"]), abs=1e-9)
    assert list(event.shift) == truth["shift"]
    assert event.sign == -truth["sign"]  # these files give the sign that the volume has before the crossing


def test_true_passages_of_soft_chains(shared_data: Path) -> None:
    truth = read_truth(shared_data / "soft" / "soft.truth.json.gz")
    strands = list(range(0, 2001, 100)), [False] * 20
    chosen = truth["stride1"]["crossings"][::20]
    assert {event["sign"] for event in chosen} == {-1, 1}
    assert any(any(event["shift"]) for event in chosen)
    for event in chosen:
        check_event(event, shared_data / "soft" / "soft_fine.dcd", strands, truth["H"])


def test_true_passages_of_two_linked_rings(shared_data: Path) -> None:
    truth = read_truth(shared_data / "rings" / "pair_hopf.truth.json.gz")
    path, strands = shared_data / "rings" / "pair_hopf_fine.dcd", ([0, 64, 128], [True, True])
    assert {event["sign"] for event in truth["cr"][::20]} == {-1, 1}
    for event in truth["cr"][::20]:
        check_event(event, path, strands, None)


def test_all_pairs_of_the_step_in_which_the_rings_come_apart(shared_data: Path) -> None:
    truth = read_truth(shared_data / "rings" / "pair_hopf.truth.json.gz")
    x0, x1 = read_dcd(shared_data / "rings" / "pair_hopf_fine.dcd", (489, 490), 128)
    found = oracles.passages(x0, x1, [0, 64, 128], [True, True])
    assert [(e.first, e.second, e.sign) for e in found.events] == [((62, 63), (97, 98), 1)]
    assert found.contacts == ()
    assert [oracles.linking_number_exact(x[:64], x[64:]) for x in (x0, x1)] == truth["L"][489:491] == [-1, 0]
