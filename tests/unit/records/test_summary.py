"""The verdict of a run in one word: which counts and grades make it."""

import json
import math
from itertools import product

import pytest

from mdtopo.records import Grade, RunSummary, RunVerdict, Severity, StepCounts
from mdtopo.records.summary import run_verdict

NO_CROSSINGS: dict[Grade, int] = dict.fromkeys(Grade, 0)


@pytest.mark.parametrize(
    ("counts", "crossings", "n_fractures", "n_warnings", "verdict"),
    [
        (StepCounts(ball=1), {}, 0, 0, RunVerdict.PASS),
        (StepCounts(pairs=1), {}, 0, 0, RunVerdict.PASS),
        (StepCounts(ball=3, pairs=4), NO_CROSSINGS, 0, 0, RunVerdict.PASS),
        (StepCounts(ball=3, near_limit=1), {}, 0, 0, RunVerdict.WARN),
        (StepCounts(ball=3), {}, 0, 1, RunVerdict.WARN),
        (StepCounts(), {}, 0, 0, RunVerdict.UNPROVEN),
        (StepCounts(ball=3, unresolved=1), {}, 0, 0, RunVerdict.UNPROVEN),
        (StepCounts(ball=3, near_limit=1, unresolved=1), {}, 0, 2, RunVerdict.UNPROVEN),
        (StepCounts(ball=3, crossed=1), {Grade.UNDERSAMPLED: 1}, 0, 0, RunVerdict.UNPROVEN),
        (StepCounts(ball=3, crossed=1), {Grade.UNDERSAMPLED: 7}, 0, 2, RunVerdict.UNPROVEN),
        (StepCounts(ball=3, crossed=1), {Grade.RESOLVED: 1}, 0, 0, RunVerdict.FAIL),
        (StepCounts(ball=3, crossed=1), {Grade.PROVEN: 1}, 0, 0, RunVerdict.FAIL),
        (StepCounts(ball=3), {}, 1, 0, RunVerdict.FAIL),
        (StepCounts(), {}, 1, 0, RunVerdict.FAIL),
        (StepCounts(unresolved=2), {}, 1, 0, RunVerdict.FAIL),
        (StepCounts(crossed=1, unresolved=2), {Grade.UNDERSAMPLED: 2, Grade.RESOLVED: 1}, 0, 0, RunVerdict.FAIL),
    ],
)
def test_the_verdict_of_a_run(
    counts: StepCounts, crossings: dict[Grade, int], n_fractures: int, n_warnings: int, verdict: RunVerdict
) -> None:
    assert run_verdict(counts, crossings, n_fractures, n_warnings) is verdict


@pytest.mark.parametrize("grades", list(product([0, 1], repeat=len(Grade))))
def test_of_crossings_only_those_of_coarse_frames_fail_nothing(grades: tuple[int, ...]) -> None:
    crossings = dict(zip(Grade, grades, strict=True))
    counts = StepCounts(ball=5, crossed=int(any(grades)))
    found = run_verdict(counts, crossings, 0, 0)
    if crossings[Grade.PROVEN] or crossings[Grade.RESOLVED]:
        assert found is RunVerdict.FAIL
    else:
        assert found is (RunVerdict.UNPROVEN if crossings[Grade.UNDERSAMPLED] else RunVerdict.PASS)


BETTER_FIRST = [RunVerdict.PASS, RunVerdict.WARN, RunVerdict.UNPROVEN, RunVerdict.FAIL]


def test_nothing_bad_that_is_added_makes_a_run_better() -> None:
    ranks = {}
    for near, lost, under, resolved, fractures, warnings in product([0, 1], repeat=6):
        crossings = {Grade.UNDERSAMPLED: under, Grade.RESOLVED: resolved}
        counts = StepCounts(pairs=2, near_limit=near, unresolved=lost, crossed=int(under or resolved))
        verdict = run_verdict(counts, crossings, fractures, warnings)
        ranks[near, lost, under, resolved, fractures, warnings] = BETTER_FIRST.index(verdict)
    assert set(ranks.values()) == {0, 1, 2, 3}
    for bits, rank in ranks.items():
        for k in range(len(bits)):
            if not bits[k]:
                assert ranks[(*bits[:k], 1, *bits[k + 1 :])] >= rank


def test_step_counts_add_up_count_by_count() -> None:
    total = StepCounts(1, 20, 300, 4000, 50000) + StepCounts(5, 40, 300, 2000, 10000)
    assert total == StepCounts(6, 60, 600, 6000, 60000)
    assert total.steps == 66666


def test_the_plain_values_of_a_summary_are_json_and_name_every_grade() -> None:
    crossings = {Grade.UNDERSAMPLED: 3, Grade.RESOLVED: 2, Grade.PROVEN: 1}
    run = RunSummary(
        RunVerdict.FAIL, StepCounts(1, 2, 3, 4, 5), crossings, 6, {Severity.CRITICAL: 7}, math.nan, -1, math.inf, 9
    )
    values = json.loads(json.dumps(run.to_mapping(), allow_nan=False))
    assert values["crossings"] == {"undersampled": 3, "resolved": 2, "proven": 1}
    assert values["counts"] == {"ball": 1, "pairs": 2, "near_limit": 3, "unresolved": 4, "crossed": 5}
    assert (values["verdict"], values["n_steps"], values["n_fractures"]) == ("FAIL", 15, 6)
    assert (values["clearance"], values["clearance_step"], values["ratio"], values["ratio_step"]) == (None, -1, None, 9)
    assert values["alerts"] == {"critical": 7}


def test_a_summary_survives_json() -> None:
    crossings = {Grade.UNDERSAMPLED: 0, Grade.RESOLVED: 2, Grade.PROVEN: 1}
    alerts = {Severity.INFO: 3, Severity.WARNING: 0, Severity.CRITICAL: 3}
    counts = StepCounts(ball=1, pairs=2, near_limit=3, unresolved=4, crossed=5)
    summary = RunSummary(RunVerdict.FAIL, counts, crossings, 1, alerts, 0.25, 3, 1.5, 7, None, "it ended")
    assert RunSummary.from_mapping(json.loads(json.dumps(summary.to_mapping()))) == summary
