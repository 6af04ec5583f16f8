"""No false certificate of a moving curve: exact subdivision judges composite curves that nearly meet, fold and cusp."""

import os
import zlib
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from oracles.curves import Meeting, Meetings, Place
from soundness.curves import FAMILIES, Claim, Motion, Points, Tally, complaint, is_touching, judged

from mdtopo import CompositeBezier, Rung, Verdict, curve_step, d_star
from mdtopo.curveladder import measure_curve

MOTIONS = 60
CAMPAIGN = int(os.environ.get("MDTOPO_CURVE_CAMPAIGN", "20000"))

NOTHING = Claim(certified=False, undecided=True, passages=())
SURE = Claim(certified=True, undecided=False, passages=())


def generator(name: str, seed: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), seed])


def vectors(points: Points, i: int, j: int, following: list[int]) -> Points:
    """Return V of the certificates: of one segment with itself, of two with a joint, of two without."""
    if i == j:
        return np.diff(points[i], axis=0)
    if following[j] == i:
        i, j = j, i
    if following[i] == j:
        return np.concatenate([points[i, -1] - points[i, :-1], points[j, 1:] - points[j, 0]])
    return (points[i][:, np.newaxis] - points[j][np.newaxis]).reshape(-1, 3)


def by_hulls(motion: Motion) -> Claim:
    """Say that a motion is free where d* of all V at both ends is positive: S1, S2 and S3 without subdivision."""
    after, m = motion.following, len(motion.start)
    pairs = [*combinations(range(m), 2), *((i, i) for i in range(m))]
    hulls = (np.concatenate([vectors(x, i, j, after) for x in (motion.start, motion.end)]) for i, j in pairs)
    return SURE if all(d_star(v) > 0 for v in hulls) else NOTHING


def by_hodographs(motion: Motion) -> Claim:
    """Say of one segment that it never meets itself where each difference moves less than d*: Prop. 3.2, sound."""
    if len(motion.start) > 1:
        return NOTHING
    q0, q1 = (np.diff(x[0], axis=0) for x in (motion.start, motion.end))
    return SURE if np.linalg.norm(q1 - q0, axis=1).max() * (1 + 1e-12) < d_star(q0) else NOTHING


def as_printed(motion: Motion) -> Claim:
    """Say the same where each control point moves less than d*, as the paper prints it."""
    if len(motion.start) > 1:
        return NOTHING
    moved = np.linalg.norm(motion.end - motion.start, axis=2).max()
    return SURE if moved < d_star(np.diff(motion.start[0], axis=0)) else NOTHING


def by_curve_step(motion: Motion) -> Claim:
    """Say what the package says of the step from one curve to the other, its crossings with their signs."""
    if motion.cells is not None:
        return by_measure_curve(motion, *motion.cells)
    start, end = (
        CompositeBezier.from_control_points(x, lengths=motion.lengths, closed=motion.closed)
        for x in (motion.start, motion.end)
    )
    report = curve_step(start, end)
    passages = tuple(
        Meeting(c.t, *(Place(k, u) for k, u in zip(c.segments, c.parameters, strict=True)), c.sign)
        for c in report.crossings
    )
    undecided = report.verdict is Verdict.UNRESOLVED or report.n_open > 0
    return Claim(report.verdict is Verdict.CERTIFIED, undecided, passages)


def by_measure_curve(motion: Motion, cell0: Points, cell1: Points) -> Claim:
    """Say the same of a motion with periodic images."""
    following = np.array(motion.following)
    measure = measure_curve(motion.start, motion.end, following, cell0, cell1, True, 0.0)
    passages = tuple(
        Meeting(t, Place(int(i), u), Place(int(j), v), int(sign))
        for i, j, _, _, _, t, u, v, sign in measure.found[:, :9]
    )
    is_open = measure.rung == Rung.OPEN
    return Claim(not is_open and not passages, is_open, passages)


def said(name: str, tally: Tally) -> None:
    print("\n" + tally.sentence(name))  # noqa: T201 - how many motions a campaign judged is its result
    assert not tally.false, tally.false[0]


HULLS = ("composite", "spline", "nearly cusped", "folds")
"""Families of which hulls certify some motions without subdivision."""


@pytest.mark.parametrize("name", HULLS)
def test_no_certificate_by_hulls_is_false(name: str) -> None:
    tally = judged(name, generator(name, 0), MOTIONS, by_hulls)
    said(name, tally)
    assert tally.certified > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", HULLS)
def test_no_certificate_by_hulls_is_false_in_a_long_campaign(name: str) -> None:
    said(name, judged(name, generator(name, 1), -(-CAMPAIGN // len(HULLS)), by_hulls))


JUDGED = {
    "composite": 60,
    "spline": 60,
    "near touching": 60,
    "grazing": 60,
    "sized": 60,
    "nearly cusped": 60,
    "folds": 60,
    "exact touch": 10,
    "planar at rest": 40,
    "through the boundary": 40,
}
"""Motions of each family; the exact judge takes from a hundredth of a second to a second for one."""


@pytest.mark.parametrize("name", FAMILIES)
def test_no_answer_of_curve_step_is_false(name: str) -> None:
    tally = judged(name, generator(name, 2), JUDGED[name], by_curve_step)
    said(name, tally)
    assert tally.certified + tally.crossing > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_no_answer_of_curve_step_is_false_in_a_long_campaign(name: str) -> None:
    said(name, judged(name, generator(name, 3), -(-CAMPAIGN * JUDGED[name] // sum(JUDGED.values())), by_curve_step))


def single(rng: np.random.Generator) -> Motion:
    """One cubic of which the first two points are pushed towards each other, as in case T3."""
    points = np.cumsum(np.array([1.0, 0, 0]) + rng.normal(size=(4, 3)) * [0.2, 0.6, 0.3], axis=0)
    push = rng.uniform(0.2, 1.0) * np.array([[1, 0, 0], [-1, 0, 0], [0, 0, 0], [0, 0, 0]])
    return Motion(points[np.newaxis], (points + push)[np.newaxis], (1,), (False,))


def test_no_certificate_by_the_motion_of_a_hodograph_is_false(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(FAMILIES, "single", single)
    tally = judged("single", generator("single", 0), 400, by_hodographs)
    said("single", tally)
    assert tally.certified > 20


def test_the_bound_as_printed_is_found_false(monkeypatch: pytest.MonkeyPatch) -> None:
    """Case T3 with its heights times 10, so that all its numbers are floats: the judge can tell."""
    start = np.array([[[0.0, 0, 0], [1, -1, 0], [2, 2, 0], [3, 9, 0]]])
    end = start + np.array([[[0.75, 0, 0], [-0.75, 0, 0], [0, 0, 0], [0, 0, 0]]])
    motion = Motion(start, end, (1,), (False,), touch=(1.0, (0, 0.0), (0, 0.25)))
    monkeypatch.setitem(FAMILIES, "T3", lambda rng: motion)
    assert len(judged("T3", generator("T3", 0), 1, as_printed).false) == 1
    assert not judged("T3", generator("T3", 0), 1, by_hodographs).false


PLACES = Place(0, 0.25), Place(1, 0.5)
PASSAGE = Meeting(0.5, *PLACES, 1)
ONCE, NEVER, MAYBE = Meetings((PASSAGE,), ()), Meetings((), ()), Meetings((), (PASSAGE,))
FOUND = Claim(certified=False, undecided=False, passages=(PASSAGE,))


@pytest.mark.parametrize(
    ("claim", "exact", "touches", "expected"),
    [
        (SURE, NEVER, False, ""),
        (SURE, ONCE, False, "false certificate"),
        (SURE, NEVER, True, "false certificate"),
        (SURE, MAYBE, False, ""),
        (NOTHING, ONCE, True, ""),
        (FOUND, ONCE, False, ""),
        (FOUND, NEVER, False, "false crossing"),
        (FOUND, MAYBE, False, ""),
        (FOUND._replace(passages=(replace(PASSAGE, sign=-1),)), ONCE, False, "false crossing"),
        (FOUND._replace(passages=(replace(PASSAGE, t=0.5 + 2e-7),)), ONCE, False, "false crossing"),
        (FOUND._replace(passages=(replace(PASSAGE, t=0.5 + 5e-8),)), ONCE, False, ""),
        (FOUND._replace(passages=(replace(PASSAGE, first=PLACES[1], second=PLACES[0]),)), ONCE, False, ""),
        (FOUND._replace(passages=(PASSAGE, PASSAGE)), ONCE, False, "false crossing"),
        (FOUND._replace(passages=()), ONCE, False, "missed crossing"),
    ],
)
def test_the_judge_names_what_is_false(claim: Claim, exact: Meetings, touches: bool, expected: str) -> None:
    assert complaint(claim, exact, touches) == expected


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("near touching", 1),
        ("grazing", 10),
        ("sized", 1),
        ("nearly cusped", 1),
        ("exact touch", 12),
        ("planar at rest", 4),
        ("through the boundary", 4),
    ],
)
def test_a_campaign_counts_false_certificates(name: str, least: int) -> None:
    tally = judged(name, generator(name, 5), 12, lambda motion: SURE)
    assert (tally.motions, tally.certified) == (12, 12)
    assert len(tally.false) >= least
    assert tally.false[0].startswith("false certificate: [[[['")


def test_an_exact_touch_is_one() -> None:
    motion = FAMILIES["exact touch"](generator("exact touch", 2))
    assert is_touching(motion)
    assert not is_touching(replace(motion, end=motion.end + np.array([0.0, 1.0])[:, np.newaxis, np.newaxis]))
