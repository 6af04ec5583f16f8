import math
from pathlib import Path

import pytest

from mdtopo import MonitorConfig, RunSummary, RunVerdict, Severity
from mdtopo.cli.summary import aligned, counts_as_failure, headline, summary_text
from mdtopo.records import CurveCounts, Grade, StepCounts

NONE = dict.fromkeys(Severity, 0)


def summary(
    verdict: RunVerdict,
    counts: StepCounts,
    *,
    crossings: tuple[int, int, int] = (0, 0, 0),
    n_fractures: int = 0,
    clearance: float = 1.25,
    curve: CurveCounts | None = None,
    closest: str = "",
) -> RunSummary:
    found = dict(zip(Grade, crossings, strict=True))
    path = Path("run.h5")
    return RunSummary(
        verdict, counts, found, n_fractures, NONE, clearance, 7, 0.5, 8, path, curve=curve, closest=closest
    )


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (summary(RunVerdict.PASS, StepCounts(ball=3)), "PASS: every step is proved"),
        (summary(RunVerdict.WARN, StepCounts(near_limit=3)), "WARN: every step is proved, but"),
        (summary(RunVerdict.UNPROVEN, StepCounts(unresolved=3)), "UNPROVEN: some steps are not decided"),
        (summary(RunVerdict.UNPROVEN, StepCounts()), "UNPROVEN: there is no step"),
        (summary(RunVerdict.FAIL, StepCounts(crossed=1), crossings=(0, 1, 0)), "FAIL: 1 crossing (1 resolved);"),
        (
            summary(RunVerdict.FAIL, StepCounts(crossed=2), crossings=(2, 1, 1), n_fractures=1),
            "FAIL: 4 crossings (1 proven, 1 resolved, 2 undersampled) and 1 broken edge;",
        ),
        (
            summary(RunVerdict.UNPROVEN, StepCounts(ball=1, crossed=1, unresolved=1), crossings=(1, 0, 0)),
            "UNPROVEN: 1 crossing (1 undersampled): the frames are too far apart to tell a passage from a detour. "
            "1 step is not decided.",
        ),
        (summary(RunVerdict.FAIL, StepCounts(ball=2), n_fractures=2), "FAIL: 2 broken edges;"),
        (
            summary(RunVerdict.WARN, StepCounts(ball=2, near_limit=1), curve=CurveCounts(certified=2, crossed=1)),
            "WARN: every step is proved, but something came near a limit;",
        ),
        (
            summary(RunVerdict.WARN, StepCounts(ball=2), curve=CurveCounts(certified=1, crossed=1)),
            "WARN: every step is proved, but the smooth curve passes in 1 step, where its edges do not;",
        ),
        (
            summary(RunVerdict.WARN, StepCounts(ball=3), curve=CurveCounts(certified=1, unresolved=2)),
            "WARN: every step is proved, but 2 steps are not decided for the smooth curve;",
        ),
        (summary(RunVerdict.WARN, StepCounts(ball=3)), "WARN: every step is proved, but there are warnings;"),
    ],
)
def test_the_headline_says_what_the_verdict_means(run: RunSummary, words: str) -> None:
    assert headline(run).startswith(words)


def test_the_five_counts_stand_under_their_sum() -> None:
    run = summary(RunVerdict.FAIL, StepCounts(100, 20, 3, 4, 5), n_fractures=0, closest="A:1-2 and B:3-4")
    text = summary_text(run, MonitorConfig(), alerts_at="a.jsonl", results_at="run.h5")
    numbers = [int(line[20:].split()[0]) for line in text.splitlines()[2:8]]
    assert numbers == [132, 100, 20, 3, 4, 5]
    assert "at least 1.25 Å apart (step 7 between A:1-2 and B:3-4)" in text
    assert "  alerts        none in a.jsonl\n" in text
    assert text.endswith("  results       run.h5\n")


def test_an_unknown_clearance_is_not_printed_as_nan() -> None:
    run = summary(RunVerdict.UNPROVEN, StepCounts(unresolved=1), clearance=math.nan)
    assert "nan" not in summary_text(run, MonitorConfig())


def test_a_pair_that_only_exact_arithmetic_keeps_apart_is_not_said_to_keep_a_distance() -> None:
    text = summary_text(summary(RunVerdict.WARN, StepCounts(near_limit=1), clearance=0.0), MonitorConfig())
    assert "proved never to meet, too close to say how far apart (step 7)" in text


@pytest.mark.parametrize(("criterion", "words"), [("pair", "0.8 of the limit"), ("nu", "2 x"), ("clearance", "0.8 Å")])
def test_near_the_limit_is_said_in_the_words_of_the_criterion(criterion: str, words: str) -> None:
    text = summary_text(summary(RunVerdict.PASS, StepCounts(ball=1)), MonitorConfig(criterion=criterion))  # type: ignore[arg-type]
    assert words in text


@pytest.mark.parametrize(
    ("fail_on", "severity", "expected"),
    [
        ("never", Severity.CRITICAL, False),
        ("critical", Severity.WARNING, False),
        ("critical", Severity.CRITICAL, True),
        ("warning", Severity.CRITICAL, True),
        ("info", Severity.INFO, True),
        ("warning", Severity.INFO, False),
    ],
)
def test_which_alerts_count_as_failure(fail_on: str, severity: Severity, expected: bool) -> None:
    assert counts_as_failure({**NONE, severity: 1}, fail_on) is expected
    assert counts_as_failure(NONE, fail_on) is False


def test_columns_are_aligned() -> None:
    assert list(aligned([("a", "1"), ("long", "2"), ("b", "")])) == ["  a     1", "  long  2", "  b"]
