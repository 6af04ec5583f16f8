"""No false certificate and no false crossing: exact rational arithmetic judges many steps of a single pair of edges.

10^5 steps run by default. A long campaign is run on demand; two halves with different seeds keep two processors busy
for an hour or two:

    MDTOPO_CAMPAIGN=5000000 MDTOPO_CAMPAIGN_SEED=1 pytest tests/soundness/test_campaign.py -m slow -s &
    MDTOPO_CAMPAIGN=5000000 MDTOPO_CAMPAIGN_SEED=2 pytest tests/soundness/test_campaign.py -m slow -s
"""

import os
import zlib

import numpy as np
import pytest
from soundness.families import FAMILIES, Generator
from soundness.judge import Count, complaint, judged_pairs, measured
from soundness.periodic import LENGTHS, PAIR, PERIODIC_FAMILIES, ExactMotion, Periodic

from mdtopo.records import StepReport, Strands, Verdict

PAIR_STRANDS = Strands.from_lengths([2, 2])
PERIODIC_STRANDS = Strands.from_lengths(LENGTHS)

BLOCK = 1000
BLOCKS, PERIODIC_STEPS = 9, 500
"""Blocks of each family, and steps of each periodic one, by default: 103,500 steps in all."""

CAMPAIGN = int(os.environ.get("MDTOPO_CAMPAIGN", "10000000"))
SEED = int(os.environ.get("MDTOPO_CAMPAIGN_SEED", "1"))
PERIODIC_SHARE = 0.001
"""Of a long campaign, for each periodic family: a step in a cell costs some hundred times as much to judge."""

MOST_UNRESOLVED = 1e-4

DEGENERATE = {
    "lattice points": "common points, overlaps and edges without length are frequent among small integers",
    "coplanar": "all points in one plane, or in one but for rounding",
    "far away": "all heights are a few units in the last place, so that edges often touch in a frame",
}
"""Families in which edges touch without passing, by design and exactly; such a step has to be UNRESOLVED."""

WITHIN_ROUNDING = set(PERIODIC_FAMILIES) - {"clear of rounding"}
"""Their gaps go down to units in the last place, and what is placed by whole cells is known to some 64 of these."""


PLACED = 1024 * 2.0**-53
"""What a position may be off by once whole cells were added, as a share of the greatest number: 64 roundings, and some
for the part of a motion that is not across the edges."""


def generator(name: str, seed: int, block: int) -> Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), seed, block])


def said(name: str, count: Count, may_hide: bool) -> None:
    print("\n" + count.sentence(name))  # noqa: T201 - how many steps a campaign judged is its result
    assert not count.false, count.false[0]
    assert may_hide or count.unresolved <= MOST_UNRESOLVED * count.steps


def campaign(name: str, blocks: int, seed: int) -> None:
    total = Count()
    for block in range(blocks):
        total += judged_pairs(*FAMILIES[name](generator(name, seed, block), BLOCK), PAIR_STRANDS)
    said(name, total, name in DEGENERATE)


@pytest.mark.parametrize("name", FAMILIES)
def test_nothing_said_of_a_pair_is_false_in_exact_arithmetic(name: str) -> None:
    campaign(name, BLOCKS, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_nothing_said_of_a_pair_is_false_in_a_long_campaign(name: str) -> None:
    campaign(name, -(-CAMPAIGN // (len(FAMILIES) * BLOCK)), SEED)


def wrong_in_a_cell(step: Periodic, report: StepReport) -> str:
    if report.verdict is Verdict.UNRESOLVED and not len(report.crossings):
        return ""
    listed = {((a, b), (c, d)) for (a, b), (c, d) in report.crossings.edges.tolist()}
    exact = ExactMotion.of(step, PERIODIC_STRANDS).passages(PERIODIC_STRANDS, sorted({PAIR, *listed}))
    size = max(np.abs(part).max() for part in (step.x0, step.x1, step.cell0, step.cell1))
    return complaint(report, exact, PLACED * float(size))


def judged_in_cells(name: str, rng: Generator, n: int) -> Count:
    steps = [PERIODIC_FAMILIES[name](rng) for _ in range(n)]
    x0, x1, cell0, cell1 = (np.stack([getattr(s, part) for s in steps]) for part in ("x0", "x1", "cell0", "cell1"))
    table, rows = measured(x0, x1, PERIODIC_STRANDS, (cell0, cell1))
    false = [
        f"{wrong}: {step.in_hex()}"
        for step, row in zip(steps, rows, strict=True)
        if (wrong := wrong_in_a_cell(step, table.report(row)))
    ]
    return Count.of(table.verdict[rows], false)


def periodic_campaign(name: str, steps: int, seed: int) -> None:
    total = Count()
    for block, start in enumerate(range(0, steps, BLOCK)):
        total += judged_in_cells(name, generator(name, seed, block), min(BLOCK, steps - start))
    said(name, total, name in WITHIN_ROUNDING)


@pytest.mark.parametrize("name", PERIODIC_FAMILIES)
def test_nothing_said_of_a_pair_is_false_in_any_image(name: str) -> None:
    periodic_campaign(name, PERIODIC_STEPS, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", PERIODIC_FAMILIES)
def test_nothing_said_of_a_pair_is_false_in_any_image_in_a_long_campaign(name: str) -> None:
    periodic_campaign(name, int(PERIODIC_SHARE * CAMPAIGN), SEED)
