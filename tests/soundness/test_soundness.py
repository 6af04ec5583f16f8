"""No certified step has a contact of edges that do not touch by design: exact rational arithmetic is the judge."""

import os
import zlib
from collections.abc import Sequence

import numpy as np
import pytest
from oracles import is_free, least_distance_during, passages
from soundness.families import FAMILIES, Generator, Motions, Points
from soundness.periodic import LENGTHS, PAIR, PERIODIC_FAMILIES, exact_motion

import mdtopo
from mdtopo.bonds import reference_lengths
from mdtopo.curves import step_motion
from mdtopo.geometry.rigid import best_rotations, covariance
from mdtopo.measure import Setting, measure_block
from mdtopo.records import FrameBlock, MonitorConfig, StepTable, Strands, Traces, Verdict

LAB = MonitorConfig(motion="lab")
PAIR_STRANDS = Strands.from_lengths([2, 2])
LONG_RUN = int(os.environ.get("MDTOPO_CAMPAIGN", "20000"))


def generator(name: str, salt: int = 0) -> Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), salt])


def measured(x0: Points, x1: Points, strands: Strands) -> StepTable:
    """Return the table of the steps x0[k] → x1[k]; no edge ever counts as broken."""
    frames = np.stack([x0, x1], axis=1).reshape(-1, *x0.shape[1:])
    reference = reference_lengths(np.full((1, len(strands.edges)), np.nan))
    n, setting = len(frames), Setting.start(strands, LAB, reference)
    block = FrameBlock(0, np.arange(n), np.arange(n, dtype=float), frames, None, ("",) * n)
    return measure_block(block, setting)[0]


def apart_by_boxes(x0: Points, x1: Points) -> bool:
    """Return whether the boxes swept by the two edges are apart, which floats decide exactly."""
    first, second = np.concatenate([x0[:2], x1[:2]]), np.concatenate([x0[2:], x1[2:]])
    return bool((first.max(axis=0) < second.min(axis=0)).any() or (second.max(axis=0) < first.min(axis=0)).any())


def false_certificates(x0: Points, x1: Points, verdict: Sequence[int]) -> list[int]:
    certified = np.flatnonzero(np.asarray(verdict) == Verdict.CERTIFIED)
    return [
        int(k)
        for k in certified
        if not apart_by_boxes(x0[k], x1[k]) and not is_free(x0[k].reshape(2, 2, 3), x1[k].reshape(2, 2, 3))
    ]


def say(name: str, n: int, unresolved: float, n_false: int) -> None:
    line = f"{name}: {n} steps, {unresolved:.1%} unresolved, {n_false} false certificates"
    print(line)  # noqa: T201 - how many steps a campaign judged is its result


def campaign(name: str, n: int, salt: int) -> None:
    x0, x1 = FAMILIES[name](generator(name, salt), n)
    verdict = measured(x0, x1, PAIR_STRANDS).verdict[::2]
    wrong = false_certificates(x0, x1, verdict)
    say(name, n, float(np.mean(verdict == Verdict.UNRESOLVED)), len(wrong))
    assert not wrong, f"{name}: {x0[wrong[0]].tolist()} -> {x1[wrong[0]].tolist()}"


@pytest.mark.parametrize("name", FAMILIES)
def test_no_certified_pair_meets_in_exact_arithmetic(name: str) -> None:
    campaign(name, 1000, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_no_certified_pair_meets_in_a_long_campaign(name: str) -> None:
    for salt in range(1, 1 + -(-LONG_RUN // 1000)):
        campaign(name, 1000, salt)


def periodic_campaign(name: str, n: int, salt: int) -> None:
    rng, strands = generator(name, salt), Strands.from_lengths(LENGTHS)
    unresolved, wrong = 0, []
    for _ in range(n):
        step = PERIODIC_FAMILIES[name](rng)
        report = mdtopo.polyline_step(step.x0, step.x1, strands, cell_t0=step.cell0, cell_t1=step.cell1, config=LAB)
        if report.verdict is not Verdict.CERTIFIED:
            unresolved += 1
            continue
        x0, x1, cell0, cell1 = exact_motion(step, strands)
        found = passages(x0, x1, strands.offsets, strands.closed, cell0=cell0, cell1=cell1, pairs=PAIR)
        if found.events or found.contacts:
            wrong.append(step)
    say(name, n, unresolved / n, len(wrong))
    assert not wrong, f"{name}: {wrong[0]}"


@pytest.mark.parametrize("name", PERIODIC_FAMILIES)
def test_no_certified_pair_meets_in_any_image(name: str) -> None:
    periodic_campaign(name, 500, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", PERIODIC_FAMILIES)
def test_no_certified_pair_meets_in_any_image_in_a_long_campaign(name: str) -> None:
    periodic_campaign(name, LONG_RUN // 10, 1)


def rigid_motions(rng: Generator, x0: Points, x1: Points) -> Motions:
    """Return what is certified where a rigid motion is taken out: the turned second frame, as the package rounds it."""
    t = Traces.of(PAIR_STRANDS)
    group = np.array([0, 4])
    turned = np.empty_like(x1)
    for k in range(len(x0)):
        correlation, size = covariance(x0[k], x1[k], t.vertices, group)
        rotation = best_rotations(correlation[np.newaxis], np.array([size]))[0]
        zero = np.zeros((3, 3))
        motion = step_motion(
            x0[k], x1[k], zero, zero, 0.0, False, True, np.ascontiguousarray(rotation), t.vertices, t.offsets
        )
        turned[k] = motion.x1
    return x0, turned


@pytest.mark.parametrize("name", ["random", "near touching", "lattice points"])
def test_no_certified_pair_meets_once_the_rigid_motion_is_out(name: str) -> None:
    rng = generator(name, 7)
    x0, x1 = FAMILIES[name](rng, 150)
    reports = [mdtopo.polyline_step(a, b, PAIR_STRANDS) for a, b in zip(x0, x1, strict=True)]
    assert not false_certificates(*rigid_motions(rng, x0, x1), [r.verdict for r in reports])


def chains(rng: Generator, n: int) -> Motions:
    """An open chain of five and a ring of four on a coarse grid, with small moves: contacts are common."""
    x0 = rng.integers(-2, 3, size=(n, 9, 3)).astype(float)
    x0 += rng.normal(size=(n, 9, 3)) * rng.choice([0.0, 1e-12, 1e-3, 0.3], size=(n, 1, 1))
    return x0, x0 + rng.normal(size=(n, 9, 3)) * rng.choice([0.0, 1e-3, 0.1, 0.5], size=(n, 1, 1))


def test_no_certified_step_of_chains_has_a_contact_of_non_adjacent_edges() -> None:
    rng, strands = generator("chains"), Strands.from_lengths([5, 4], closed=[False, True])
    x0, x1 = chains(rng, 400)
    verdict = measured(x0, x1, strands).verdict[::2]
    certified = np.flatnonzero(verdict == Verdict.CERTIFIED)
    wrong = []
    for k in certified:
        found = passages(x0[k], x1[k], strands.offsets, strands.closed)
        if found.events or any(c.first[0] != c.first[1] for c in found.contacts):  # end terms let nothing pass
            wrong.append((x0[k].tolist(), x1[k].tolist()))
    say("chains", len(x0), 1 - len(certified) / len(x0), len(wrong))
    assert len(certified) > 20
    assert not wrong, wrong[0]


@pytest.mark.parametrize("name", ["random", "near touching", "near parallel", "far away", "hundredths"])
def test_no_clearance_is_above_the_least_distance_during_the_step(name: str) -> None:
    x0, x1 = FAMILIES[name](generator(name, 3), 60)
    table = measured(x0, x1, PAIR_STRANDS)
    for k in np.flatnonzero(table.verdict[::2] == Verdict.CERTIFIED):
        start, end = x0[k] - x0[k, 0], x1[k] - x0[k, 0]  # the oracle rounds at the size of the coordinates
        clearance = table.clearance_inter[2 * k]
        _, above = least_distance_during(start.reshape(2, 2, 3), end.reshape(2, 2, 3), tolerance=1e-4)
        assert clearance <= above * (1 + 1e-9) + 1e-14
