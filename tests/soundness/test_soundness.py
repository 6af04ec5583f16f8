"""Exact rational arithmetic judges steps of whole strands, steps whose rigid motion is out, and clearances."""

import zlib
from dataclasses import replace

import numpy as np
import pytest
from oracles import least_distance_during, passages
from soundness.families import FAMILIES, Generator, Motions, Points, in_hex
from soundness.judge import Count, complaint, free_of_contact, measured

import mdtopo
from mdtopo.curves import step_motion
from mdtopo.geometry.rigid import best_rotations, covariance
from mdtopo.records import Strands, Traces, Verdict

PAIR_STRANDS = Strands.from_lengths([2, 2])


def generator(name: str, salt: int = 0) -> Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), salt])


def rigid_motions(x0: Points, x1: Points) -> Motions:
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
    verdicts = np.array([mdtopo.polyline_step(a, b, PAIR_STRANDS).verdict for a, b in zip(x0, x1, strict=True)])
    certified = verdicts == Verdict.CERTIFIED
    y0, y1 = rigid_motions(x0[certified], x1[certified])
    assert certified.any()
    assert free_of_contact(y0, y1).all()


def chains(rng: Generator, n: int) -> Motions:
    """An open chain of five and a ring of four on a coarse grid, with small moves: contacts are common."""
    x0 = rng.integers(-2, 3, size=(n, 9, 3)).astype(float)
    x0 += rng.normal(size=(n, 9, 3)) * rng.choice([0.0, 1e-12, 1e-3, 0.3], size=(n, 1, 1))
    return x0, x0 + rng.normal(size=(n, 9, 3)) * rng.choice([0.0, 1e-3, 0.1, 0.5], size=(n, 1, 1))


def test_nothing_said_of_chains_is_false() -> None:
    rng, strands = generator("chains"), Strands.from_lengths([5, 4], closed=[False, True])
    x0, x1 = chains(rng, 400)
    table, rows = measured(x0, x1, strands)
    false = []
    for k, row in enumerate(rows):
        found = passages(x0[k], x1[k], strands.offsets, strands.closed)
        contacts = tuple(c for c in found.contacts if c.first[0] != c.first[1])  # end terms let nothing pass
        if wrong := complaint(table.report(row), replace(found, contacts=contacts)):
            false.append(f"{wrong}: {in_hex(x0[k], x1[k])}")
    count = Count.of(table.verdict[rows], false)
    print("\n" + count.sentence("chains"))  # noqa: T201 - see `test_campaign`
    assert count.certified > 20
    assert not false, false[0]


@pytest.mark.parametrize("name", ["random", "near touching", "near parallel", "far away", "hundredths"])
def test_no_clearance_is_above_the_least_distance_during_the_step(name: str) -> None:
    x0, x1 = FAMILIES[name](generator(name, 3), 60)
    table, rows = measured(x0, x1, PAIR_STRANDS)
    for k in np.flatnonzero(table.verdict[rows] == Verdict.CERTIFIED):
        start, end = x0[k] - x0[k, 0], x1[k] - x0[k, 0]  # the oracle rounds at the size of the coordinates
        clearance = table.clearance_inter[rows[k]]
        _, above = least_distance_during(start.reshape(2, 2, 3), end.reshape(2, 2, 3), tolerance=1e-4)
        assert clearance <= above * (1 + 1e-9) + 1e-14
