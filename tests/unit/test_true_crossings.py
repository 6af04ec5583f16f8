"""The crossings of real runs against their truth files, and against exact arithmetic where a file is silent.

A truth file's `sign` is the negative of ours, which is the change of the linking number (`docs/decisions.md`).
"""

import gzip
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import oracles
import pytest

from mdtopo import Crossing, Grade, Verdict, linking_number, steps
from mdtopo.pipeline import open_input
from mdtopo.records import MonitorConfig, StepReport

SOFT = ("soft/soft.data", "soft/soft_fine.dcd", "soft/soft.truth.json.gz")
KG = ("kg/kg_linear.data", "kg/kg_linear_fine.dcd", "kg/kg_linear.truth.json.gz")
RINGS = ("kg/kg_rings.data", "kg/kg_rings_fine.dcd", "kg/kg_rings.truth.json.gz")
HOPF = ("rings/hopf.data", "rings/pair_hopf_fine.dcd", "rings/pair_hopf.truth.json.gz")
KG_WRAPPED = "kg/kg_linear_fine_wrapped.xtc"

SAME_TIME = 1e-9

Run = Callable[..., list[StepReport]]


@pytest.fixture(scope="module")
def run(shared_data: Path) -> Run:
    """Returns the step reports of a run in the lab frame."""
    done: dict[Any, list[StepReport]] = {}

    def job(topology: str, trajectory: str, stride: int, *, audit: bool = False) -> list[StepReport]:
        key = (trajectory, stride, audit)
        if key not in done:
            config = MonitorConfig(motion="lab", audit=audit)
            inputs = [shared_data / name for name in (topology, trajectory)]
            done[key] = list(steps(*inputs, frames=slice(None, None, stride), config=config))
        return done[key]

    return job


def truth(path: Path, *keys: str) -> list[dict[str, Any]]:
    with gzip.open(path) as file:
        found = json.load(file)
    for key in keys:
        found = found[key]
    return found


def crossings(reports: list[StepReport]) -> list[Crossing]:
    return [crossing for report in reports for crossing in report.crossings]


def is_same(found: Crossing, true: dict[str, Any]) -> bool:
    """Same step, edges, time, places and sign."""
    first, second = tuple(true["seg_i"]), tuple(true["seg_j"])
    places = [true["s"], true["u"]] if first < second else [true["u"], true["s"]]
    return (
        found.frame_t0 == true["frame0"]
        and found.edges.tolist() == [list(edge) for edge in sorted([first, second])]
        and abs(found.t - true["t"]) < SAME_TIME
        and bool(np.allclose(found.parameters, places, rtol=0, atol=1e-9))
        and found.sign == -true["sign"]
    )


def beyond(found: list[Crossing], true: list[dict[str, Any]]) -> list[Crossing]:
    """Return the crossings that the truth does not list; each that it does list must be there, once."""
    left = list(found)
    for event in true:
        (hit,) = [crossing for crossing in left if is_same(crossing, event)]
        left.remove(hit)
    return left


def is_confirmed(crossing: Crossing, frames: dict[int, Any]) -> bool:
    """Return whether exact arithmetic on the stored coordinates, of an unwrapped file, has this passage."""
    pair = []
    for number in (crossing.frame_t0, crossing.frame_t1):
        frame = frames[number]
        shift = crossing.image @ frame.cell if frame.cell is not None else np.zeros(3)
        first, second = frame.positions[crossing.edges]
        exact_shift = oracles.exact_points([shift])[0]
        moved = [[x + d for x, d in zip(point, exact_shift, strict=True)] for point in oracles.exact_points(second)]
        pair.append([oracles.exact_points(first), moved])
    events = oracles.pair_passages(*pair).events
    return any(abs(float(e.t) - crossing.t) < SAME_TIME and e.sign == crossing.sign for e in events)


def frames_of(shared_data: Path, names: tuple[str, ...], stride: int) -> dict[int, Any]:
    with open_input(shared_data / names[0], shared_data / names[1]) as reader:
        return {frame.index: frame for frame in reader.frames(0, None, stride)}


def every(names: tuple[str, str, str], counts: dict[int, tuple[int, int]]) -> Iterator[Any]:
    for stride, (listed, found) in counts.items():
        yield pytest.param(names, stride, listed, found, id=f"{Path(names[1]).stem}-{stride}")


@pytest.mark.parametrize(
    ("names", "stride", "listed", "found"),
    [
        *every(SOFT, {1: (232, 232), 2: (232, 232), 5: (232, 232), 10: (223, 223), 20: (185, 193), 50: (130, 140)}),
        *every(KG, {1: (0, 0), 10: (0, 0), 50: (0, 0), 100: (0, 0), 250: (5, 6)}),
        *every(RINGS, {1: (0, 0), 10: (0, 0), 50: (3, 3), 100: (6, 7), 250: (10, 16)}),
    ],
)
def test_every_true_crossing_is_found_and_what_is_found_beyond_is_exact(
    run: Run, shared_data: Path, names: tuple[str, str, str], stride: int, listed: int, found: int
) -> None:
    """At coarse strides the truth files leave some passages out; exact arithmetic has each of them."""
    key = f"stride{stride}" if names is SOFT else f"fine_stride{stride}"
    true, reports = truth(shared_data / names[2], key, "crossings"), run(*names[:2], stride)
    assert len(true) == listed
    crossed = crossings(reports)
    extra = beyond(crossed, true)
    assert (len(crossed), len(extra)) == (found, found - listed)
    frames = frames_of(shared_data, names, stride) if extra else {}
    assert [crossing for crossing in extra if not is_confirmed(crossing, frames)] == []
    assert all(report.verdict is not Verdict.UNRESOLVED for report in reports)


def test_the_check_against_exact_arithmetic_can_fail(run: Run, shared_data: Path) -> None:
    first = crossings(run(*SOFT[:2], 1))[0]
    frames = frames_of(shared_data, SOFT, 1)
    assert is_confirmed(first, frames)
    object.__setattr__(first, "sign", -first.sign)
    assert not is_confirmed(first, frames)


@pytest.mark.parametrize(("stride", "count"), [(50, 3), (100, 7), (250, 16)])
def test_crossings_of_uncrossable_rings_sampled_too_coarsely_are_called_undersampled(
    run: Run, stride: int, count: int
) -> None:
    grades = [crossing.grade for crossing in crossings(run(*RINGS[:2], stride))]
    assert grades == [Grade.UNDERSAMPLED] * count


def test_crossings_of_uncrossable_chains_sampled_too_coarsely_are_called_undersampled(run: Run) -> None:
    assert {crossing.grade for crossing in crossings(run(*KG[:2], 250))} == {Grade.UNDERSAMPLED}


@pytest.mark.parametrize("stride", [1, 10, 50, 250])
def test_the_wrapped_file_gives_the_same_crossings(run: Run, stride: int) -> None:
    """Its coordinates are rounded to 0.01 Å where edges are about 10 Å long and move about as far: t within 1e-2."""
    one, other = (run(KG[0], name, stride) for name in (KG[1], KG_WRAPPED))
    assert [r.verdict for r in one] == [r.verdict for r in other]
    for a, b in zip(crossings(one), crossings(other), strict=True):
        assert (a.step, a.edges.tolist(), a.sign, a.grade) == (b.step, b.edges.tolist(), b.sign, b.grade)
        assert abs(a.t - b.t) < 1e-2


def test_the_linked_rings_come_apart_once_and_their_linking_number_follows_the_signs(
    run: Run, shared_data: Path
) -> None:
    """The audit is on: at every step the linking number changes by the sum of the signs, and the writhe jumps by 2."""
    reports = run(*HOPF[:2], 1, audit=True)
    crossed = crossings(reports)
    assert beyond(crossed, truth(shared_data / HOPF[2], "cr")) == []
    between = [crossing for crossing in crossed if crossing.strands[0] != crossing.strands[1]]
    assert [(c.step, c.edges.tolist(), c.grade) for c in between] == [(489, [[62, 63], [97, 98]], Grade.PROVEN)]
    assert len(crossed) == 1 + 264
    frames = frames_of(shared_data, HOPF, 1)
    links = [linking_number(frames[k].positions[:64], frames[k].positions[64:]) for k in sorted(frames)]
    signs = np.zeros(len(reports), dtype=int)
    for crossing in between:
        signs[crossing.step] += crossing.sign
    assert np.diff(links).tolist() == signs.tolist()
    assert (links[0], links[-1]) == (-1, 0)
