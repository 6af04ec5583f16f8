"""The self-audit: crossings against linking numbers, writhes and knot determinants, and what it says of a false one."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import oracles
import pytest
from cases import polyline_cases
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import mdtopo.measure
from mdtopo import AuditError, polyline_step
from mdtopo.audit import STEADY, changed_invariants, close_rings, steady_change
from mdtopo.cli import main
from mdtopo.cli.exits import Exit
from mdtopo.curves import StepMotion
from mdtopo.passages import Decided, Meeting
from mdtopo.records import Grade, MonitorConfig, Reason, StepReport, Strands, Traces, Verdict

Points = NDArray[np.float64]

HOME = (0, 0, 0)
SQUARE = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
UPRIGHT = np.array([[0.0, 0, 1], [0, 0, -1], [3, 0, -1], [3, 0, 1]])
RINGS = Strands.from_lengths([4, 4], closed=True)
T1 = polyline_cases()["T1"]


@dataclass
class Audit:
    """What the audit of one step was given, and what it found."""

    motion: StepMotion
    traces: Traces
    decided: Decided
    where: str
    changed: set[Meeting]

    def again(self, decided: Decided) -> set[Meeting]:
        return changed_invariants(self.motion, self.traces, decided, self.where)


@pytest.fixture
def audits(monkeypatch: pytest.MonkeyPatch) -> list[Audit]:
    """Every audit that a test makes, in order."""
    seen: list[Audit] = []

    def watched(motion: StepMotion, traces: Traces, decided: Decided, where: str) -> set[Meeting]:
        changed = changed_invariants(motion, traces, decided, where)
        seen.append(Audit(motion, traces, decided, where, changed))
        return changed

    monkeypatch.setattr(mdtopo.measure, "changed_invariants", watched)
    return seen


def step(x0: Points, x1: Points, strands: Strands = RINGS, cell: Points | None = None, **knobs: Any) -> StepReport:
    config = MonitorConfig(**({"motion": "lab"} | knobs))
    return polyline_step(x0, x1, strands, cell_t0=cell, cell_t1=cell, config=config)


def link(x: float) -> Points:
    """Two squares: the upright one reaches from x to x + 3, and links with the flat one for -1 < x < 1."""
    return np.concatenate([SQUARE, UPRIGHT + np.array([x, 0, 0])])


def eight(h: float) -> Points:
    """A ring like a figure eight, whose edges 0-1 and 3-4 pass over each other at the heights -h and h."""
    return np.array([[-1.0, -1, -h], [1, 1, -h], [2, 0, 0], [1, -1, h], [-1, 1, h], [-2, 0, 0]])


# --- what changes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", ["lab", "rigid"])
def test_a_link_that_comes_apart_is_a_proven_crossing(audits: list[Audit], motion: str) -> None:
    assert (oracles.linking_number_exact(SQUARE, UPRIGHT), oracles.linking_number_exact(SQUARE, link(2)[4:])) == (-1, 0)
    report = step(link(0), link(2), motion=motion, resolution_length=0.0)
    (crossing,) = report.crossings
    assert (crossing.sign, crossing.grade) == (1, Grade.PROVEN)
    assert [audit.changed for audit in audits] == [{(0, 1, HOME)}]
    assert audits[0].where == "frames 0-1"


@pytest.mark.parametrize(("length", "grade"), [(None, Grade.UNDERSAMPLED), (100.0, Grade.RESOLVED)])
def test_there_and_back_leaves_the_linking_number_and_proves_nothing(
    audits: list[Audit], length: float | None, grade: Grade
) -> None:
    report = step(link(2), link(-1.5), resolution_length=length)
    assert report.crossings.sign.tolist() in ([1, -1], [-1, 1])
    assert {crossing.grade for crossing in report.crossings} == {grade}
    assert audits[0].changed == set()


def test_a_ring_that_becomes_a_trefoil_has_another_determinant(audits: list[Audit]) -> None:
    report = step(*T1.floats, Strands.from_lengths([6], closed=True), resolution_length=0.0)
    assert audits[0].changed == {(0, 0, HOME)}
    assert report.crossings[0].grade is Grade.PROVEN


def test_a_ring_that_stays_unknotted_has_a_self_crossing_that_is_not_proven(audits: list[Audit]) -> None:
    report = step(eight(0.5), eight(-0.5), Strands.from_lengths([6], closed=True))
    (crossing,) = report.crossings
    assert crossing.edges.tolist() == [[0, 1], [3, 4]]
    assert crossing.grade is Grade.RESOLVED
    assert audits[0].changed == set()
    jump = oracles.writhe(eight(-1e-6)) - oracles.writhe(eight(1e-6))
    assert jump == pytest.approx(2 * crossing.sign, abs=1e-3)


def test_each_pair_of_rings_is_graded_on_its_own(audits: list[Audit]) -> None:
    strands = Strands.from_lengths([4, 4, 4, 4], closed=True)
    far = np.array([[0.0, 40, 0]])
    x0, x1 = np.concatenate([link(0), link(2) + far]), np.concatenate([link(2), link(-1.5) + far])
    report = step(x0, x1, strands)
    grades = {tuple(crossing.strands): crossing.grade for crossing in report.crossings}
    assert grades == {("strand 0", "strand 1"): Grade.PROVEN, ("strand 2", "strand 3"): Grade.UNDERSAMPLED}
    assert audits[0].changed == {(0, 1, HOME)}


def test_a_ring_that_touches_the_other_in_a_frame_has_nothing_to_compare(audits: list[Audit]) -> None:
    report = step(link(0), link(1.0))
    assert (report.verdict, report.reason) == (Verdict.UNRESOLVED, Reason.FRAME)
    assert [audit.changed for audit in audits] == [set()]


def test_open_strands_have_no_invariants(audits: list[Audit]) -> None:
    report = step(link(0), link(2), Strands.from_lengths([4, 4], closed=[True, False]))
    assert report.verdict is Verdict.CROSSING
    assert report.crossings[0].grade is Grade.UNDERSAMPLED
    assert audits[0].changed == set()
    assert audits[0].again(flipped(audits[0].decided)) == set()


# --- passages that are false ------------------------------------------------------------------------------------------


def flipped(decided: Decided) -> Decided:
    rows = decided.passages.copy()
    rows[0, 11] *= -1.0
    return decided._replace(passages=rows)


def dropped(decided: Decided) -> Decided:
    return decided._replace(passages=decided.passages[1:])


def doubled(decided: Decided) -> Decided:
    return decided._replace(passages=np.concatenate([decided.passages, decided.passages[:1]]))


def delayed(decided: Decided) -> Decided:
    rows = decided.passages.copy()
    rows[0, 5] += 0.1
    return decided._replace(passages=rows)


@pytest.mark.parametrize(("tamper", "total"), [(flipped, "-1"), (dropped, r"\+0"), (doubled, r"\+2")])
def test_passages_of_two_rings_that_do_not_add_up_are_a_bug(audits: list[Audit], tamper: Any, total: str) -> None:
    step(link(0), link(2))
    words = (
        r"Self-audit, frames 0-1: the linking number of rings 0 and 1 \(image \(0, 0, 0\)\) goes from -1 to 0, "
        rf"but their signed crossings add up to {total}\. This is a bug in mdtopo"
    )
    with pytest.raises(AuditError, match=words):
        audits[0].again(tamper(audits[0].decided))


@pytest.mark.parametrize("tamper", [flipped, delayed, doubled])
def test_a_self_crossing_without_its_jump_of_the_writhe_is_a_bug(audits: list[Audit], tamper: Any) -> None:
    strands = Strands.from_lengths([6], closed=True)
    for x0, x1 in (T1.floats, (eight(0.5), eight(-0.4))):
        step(x0, x1, strands)
        with pytest.raises(AuditError, match=r"Self-audit, frames 0-1: the writhe of ring 0 does not jump by 2 .* bug"):
            audits[-1].again(tamper(audits[-1].decided))


def test_what_an_undecided_pair_touches_is_not_audited(audits: list[Audit]) -> None:
    step(link(0), link(2))
    false = dropped(audits[0].decided)
    row = np.array([[0, 4, 0, 0, 0, 2]])  # an edge of each ring
    assert audits[0].again(false._replace(open_pairs=row)) == set()
    other = np.array([[0, 2, 0, 0, 0, 1]])  # of one ring with itself
    with pytest.raises(AuditError):
        audits[0].again(false._replace(open_pairs=other))


@pytest.mark.parametrize("tamper", [flipped, dropped, doubled])
def test_the_step_itself_ends_with_the_error(monkeypatch: pytest.MonkeyPatch, tamper: Any) -> None:
    decide = mdtopo.measure.decide_exactly
    monkeypatch.setattr(mdtopo.measure, "decide_exactly", lambda *given: tamper(decide(*given)))
    with pytest.raises(AuditError, match="Self-audit, frames 0-1: the linking number of rings 0 and 1"):
        step(link(0), link(2))


def without_passages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the ladder find nothing."""
    measure = mdtopo.measure.measure_steps

    def blind(*given: Any) -> Any:
        starts, found = measure(*given)
        return np.zeros_like(starts), found._make(array[:0] for array in found)

    monkeypatch.setattr(mdtopo.measure, "measure_steps", blind)


def test_a_passage_that_the_ladder_misses_is_noticed_where_every_step_is_audited(
    monkeypatch: pytest.MonkeyPatch, audits: list[Audit]
) -> None:
    without_passages(monkeypatch)
    assert step(link(0), link(2)).n_crossings == 0
    assert not audits  # by default, steps without a crossing are not looked at
    with pytest.raises(AuditError, match="goes from -1 to 0"):
        step(link(0), link(2), audit=True)


def test_every_step_of_rings_is_audited_if_asked_and_none_of_open_strands(audits: list[Audit]) -> None:
    assert step(link(0), link(0.5), audit=True).verdict is Verdict.CERTIFIED
    assert [audit.changed for audit in audits] == [set()]
    step(link(0), link(0.5), Strands.from_lengths([4, 4]), audit=True)
    assert len(audits) == 1


# --- rings in a cell --------------------------------------------------------------------------------------------------

CELLS = {
    "cube": 12.0 * np.eye(3),
    "triclinic": np.array([[12.0, 0, 0], [3, 11, 0], [-2, 1, 13]]),
    "skewed": np.array([[12.0, 0, 0], [36, 11, 0], [-22, 40, 13]]),
}


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("image", [(0, 0, 0), (1, 0, 0), (0, -1, 1), (-2, 1, 1)])
def test_a_ring_that_links_with_an_image_of_another_one(
    audits: list[Audit], cell: str, image: tuple[int, int, int]
) -> None:
    h = CELLS[cell]
    x0, x1 = link(2), link(0)
    x0[4:] -= np.array(image) @ h
    x1[4:] -= np.array(image) @ h
    report = step(x0, x1, cell=h, resolution_length=0.0)
    (crossing,) = report.crossings
    assert (crossing.image.tolist(), crossing.sign, crossing.grade) == (list(image), -1, Grade.PROVEN)
    with pytest.raises(AuditError, match="goes from 0 to -1"):
        audits[0].again(flipped(audits[0].decided))


def twisted(length: float) -> Points:
    """A ring that is wide along y at its left end, and along z at its right end, with short edges."""
    left, right = np.array([[0.0, -1, 0], [0, 1, 0]]), np.array([[length, 0, 1], [length, 0, -1]])
    shares = np.linspace(0, 1, 8)[:-1, np.newaxis]
    there = (1 - shares) * left[1] + shares * right[0]
    back = (1 - shares) * right[1] + shares * left[0]
    return np.concatenate([there, right[:1], back, left[:1]])


def test_a_ring_that_links_with_its_own_image(audits: list[Audit]) -> None:
    strands, cell = Strands.from_lengths([len(twisted(1.0))], closed=True), np.diag([4.0, 12, 12])
    before, after = twisted(3.5), twisted(5.0)
    away = np.array([4.0, 0, 0])
    assert oracles.linking_number(before, before + away) == pytest.approx(0, abs=1e-9)
    linked = oracles.linking_number(after, after + away)
    assert abs(linked) == pytest.approx(1, abs=1e-9)
    report = step(before, after, strands, cell, resolution_length=0.0)
    (crossing,) = report.crossings
    assert (crossing.sign, crossing.grade) == (round(linked), Grade.PROVEN)
    assert np.abs(crossing.image).tolist() == [1, 0, 0]
    (changed,) = audits[0].changed
    assert changed[:2] == (0, 0)
    assert {changed[2], tuple(-n for n in changed[2])} == {(1, 0, 0), (-1, 0, 0)}
    for tamper in (flipped, dropped, doubled):
        with pytest.raises(AuditError, match="rings 0 and 0"):
            audits[0].again(tamper(audits[0].decided))


LENGTHS = [5, 4, 6]
THREE_RINGS = Strands.from_lengths(LENGTHS, closed=True)


def random_rings(rng: np.random.Generator, spread: float) -> Points:
    """Three rings of 1.2 Å radius, in random places and directions."""
    pieces = []
    for n in LENGTHS:
        angle = 2 * np.pi * np.arange(n) / n
        flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        pieces.append(1.2 * flat @ turn + rng.normal(0, 0.1, (n, 3)) + rng.uniform(-spread, spread, 3))
    return np.concatenate(pieces)


def ring(x: Points, g: int) -> Points:
    return x[THREE_RINGS.offsets[g] : THREE_RINGS.offsets[g + 1]]


def moved_rings(seed: int, periodic: bool, move: float = 0.35) -> tuple[Points, Points, Points | None]:
    rng = np.random.default_rng(seed)
    cell = 5.0 * (np.eye(3) + rng.uniform(-0.15, 0.15, (3, 3))) if periodic else None
    x0 = random_rings(rng, 2.5 if periodic else 1.2)
    shifts = np.repeat(rng.normal(0, move, (3, 3)), LENGTHS, axis=0)
    return x0, x0 + shifts + rng.normal(0, 0.1, x0.shape), cell


@pytest.mark.parametrize("periodic", [False, True])
def test_audited_motions_of_rings_change_what_the_oracle_says(audits: list[Audit], periodic: bool) -> None:
    n_changed = n_crossings = 0
    for seed in range(40):
        x0, x1, cell = moved_rings(seed, periodic)
        report = step(x0, x1, THREE_RINGS, cell, audit=True)  # raises where it finds a contradiction
        assert len(audits) == seed + 1
        audit = audits[-1]
        h = np.zeros((3, 3)) if cell is None else audit.motion.cell0
        for a, b, image in {*close_rings(audit.motion, audit.traces)}:
            away = np.array(image) @ h
            ends = (audit.motion.x0, audit.motion.x1)
            before, after = (round(oracles.linking_number(ring(x, a), ring(x, b) + away)) for x in ends)
            assert ((a, b, image) in audit.changed) == (before != after)
        n_changed += len(audit.changed)
        n_crossings += report.n_crossings
    assert n_changed >= 4
    assert n_crossings >= n_changed


# --- which rings are near ---------------------------------------------------------------------------------------------


def overlapping(x: Points, cell: Points | None) -> Iterator[Meeting]:
    """Yield pairs of rings and images whose boxes overlap: along the axes, or along the cell's where there is one."""
    scaled = x if cell is None else x @ np.linalg.inv(cell)
    boxes = [(ring(scaled, g).min(axis=0), ring(scaled, g).max(axis=0)) for g in range(3)]
    images = [HOME] if cell is None else list(product(range(-4, 5), repeat=3))
    for a, b, image in product(range(3), range(3), images):
        (low, high), (other_low, other_high) = boxes[a], boxes[b]
        apart = (low > other_high + image).any() or (other_low + image > high).any()
        if not apart and (a < b or (a == b and image < HOME)):
            yield a, b, image


@given(seed=st.integers(0, 2**32 - 1), periodic=st.booleans())
@settings(max_examples=40)
def test_close_rings_are_those_whose_boxes_overlap(seed: int, periodic: bool) -> None:
    x0, _, cell = moved_rings(seed, periodic)
    h = np.zeros((3, 3)) if cell is None else cell
    found = list(close_rings(motion_of(x0, x0, h, h), Traces.of(THREE_RINGS)))
    assert len(found) == len(set(found))
    assert set(found) == set(overlapping(x0, cell))


@given(seed=st.integers(0, 2**32 - 1), periodic=st.booleans())
@settings(max_examples=40)
def test_close_rings_of_a_motion_are_all_that_overlap_at_either_end(seed: int, periodic: bool) -> None:
    x0, x1, cell = moved_rings(seed, periodic, move=3.0)
    h = np.zeros((3, 3)) if cell is None else cell
    found = list(close_rings(motion_of(x0, x1, h, 1.1 * h), Traces.of(THREE_RINGS)))
    assert len(found) == len(set(found))
    cell1 = None if cell is None else 1.1 * cell
    assert set(found) >= set(overlapping(x0, cell)) | set(overlapping(x1, cell1))


def motion_of(x0: Points, x1: Points, cell0: Points, cell1: Points) -> StepMotion:
    return StepMotion(x0, x1, cell0, cell1, False, (0.0, 0.0, 0.0), True, 0.0)


def test_open_strands_are_no_rings() -> None:
    x, strands = link(0), Strands.from_lengths([4, 4], closed=[True, False])
    assert list(close_rings(motion_of(x, x, np.zeros((3, 3)), np.zeros((3, 3))), Traces.of(strands))) == []
    both = Traces.of(RINGS)
    assert list(close_rings(motion_of(x, x, np.zeros((3, 3)), np.zeros((3, 3))), both)) == [(0, 1, HOME)]


# --- the writhe -------------------------------------------------------------------------------------------------------


def to_nearest_even(change: float) -> float:
    """Return a change of the writhe without the jumps by 2 of self crossings."""
    return abs((change + 1.0) % 2.0 - 1.0)


def smooth_ring(rng: np.random.Generator, n: int = 12) -> Points:
    angle = 2 * np.pi * np.arange(n) / n
    waves = [rng.normal(0, 1 / k, (2, 3)) for k in (1, 2, 3)]
    return np.array(
        sum(np.outer(np.cos(k * angle), w[0]) + np.outer(np.sin(k * angle), w[1]) for k, w in enumerate(waves, start=1))
    )


@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1e-2, 1e-3, 1e-4]))
@settings(max_examples=60)
def test_the_writhe_changes_by_no_more_than_its_bound_but_for_jumps(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    before = smooth_ring(rng)
    after = before + size * rng.normal(size=before.shape)
    bound = steady_change(before, after)
    assume(bound < STEADY)  # it is proved to first order
    change = oracles.writhe(after) - oracles.writhe(before)
    assert to_nearest_even(change) <= bound * 1.02 + 1e-9


def test_the_bound_tells_little_moves_from_none() -> None:
    before = smooth_ring(np.random.default_rng(2))
    direction = np.random.default_rng(3).normal(size=before.shape)
    bounds = [steady_change(before, before + size * direction) for size in (0.0, 1e-6, 1e-5)]
    assert bounds[0] == 0.0
    assert 0.0 < bounds[1] < 1e-3
    assert bounds[2] == pytest.approx(10 * bounds[1], rel=1e-3)


@pytest.mark.parametrize("angle", [1e-5, 1e-3])
def test_a_ring_that_turns_keeps_its_writhe_and_has_a_small_bound(angle: float) -> None:
    before = smooth_ring(np.random.default_rng(4))
    c, s = np.cos(angle), np.sin(angle)
    after = before @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert oracles.writhe(after) == pytest.approx(oracles.writhe(before), abs=1e-9)
    assert 0.0 < steady_change(before, after) < 100 * angle
    assert steady_change(before, before + 5.0) < 1e-12


def test_a_self_crossing_is_no_steady_change() -> None:
    before, after = eight(1e-6), eight(-1e-6)
    assert steady_change(before, after) < 1e-4
    assert abs(mdtopo.writhe(after) - mdtopo.writhe(before)) == pytest.approx(2.0, abs=1e-4)


def test_nothing_is_bounded_where_an_edge_folds_back() -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.5, 1, 0], [0, 1, 1]])
    y = x.copy()
    y[2] += [0, 1e-6, 1e-6]
    assert not steady_change(x, y) < STEADY


# --- how a run ends ---------------------------------------------------------------------------------------------------


@pytest.fixture
def rings_file(tmp_path: Path) -> Path:
    """A link that comes apart between the third and the fourth frame of five."""
    frames = np.stack([link(x) for x in (0.0, 0.3, 0.8, 1.2, 1.5)])
    path = tmp_path / "rings.npz"
    np.savez(path, positions=frames, offsets=RINGS.offsets, closed=RINGS.closed, time=np.arange(5.0))
    return path


def tampered(monkeypatch: pytest.MonkeyPatch) -> None:
    decide = mdtopo.measure.decide_exactly
    monkeypatch.setattr(mdtopo.measure, "decide_exactly", lambda *given: flipped(decide(*given)))


def test_without_a_bug_the_run_ends_well(rings_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["monitor", str(rings_file), "--audit"]) == Exit.DONE
    assert "1 proven" in capsys.readouterr().out


@pytest.mark.parametrize("threads", ["1", "3"])
def test_a_failed_audit_ends_the_run_as_an_internal_error(
    rings_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], threads: str
) -> None:
    monkeypatch.delenv("MDTOPO_DEBUG", raising=False)
    tampered(monkeypatch)
    assert main(["monitor", str(rings_file), "--threads", threads]) == Exit.INTERNAL == 1
    captured = capsys.readouterr()
    assert "internal error: AuditError: Self-audit, frames 2-3: the linking number of rings 0 and 1" in captured.err
    assert "Traceback" not in captured.err
    assert "PASS" not in captured.out + captured.err


def test_whoever_wants_the_traceback_of_a_failed_audit_gets_it(
    rings_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MDTOPO_DEBUG", "1")
    tampered(monkeypatch)
    assert main(["monitor", str(rings_file)]) == Exit.INTERNAL
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert "changed_invariants" in err


def test_a_failed_audit_reaches_who_calls_the_package(rings_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tampered(monkeypatch)
    with pytest.raises(AuditError, match="frames 2-3"):
        mdtopo.monitor(rings_file)


def test_a_missed_passage_ends_a_run_that_audits_every_step(rings_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_passages(monkeypatch)
    assert main(["monitor", str(rings_file), "-q"]) == Exit.DONE
    assert main(["monitor", str(rings_file), "-q", "--audit"]) == Exit.INTERNAL
