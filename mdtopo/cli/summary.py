"""What a run comes to, as text."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from mdtopo.records import MonitorConfig, RunSummary, RunVerdict, Severity

HEADLINES = {
    RunVerdict.PASS: "every step is proved: no strand passed through another.",
    RunVerdict.WARN: "every step is proved, but something came near a limit; see the alerts.",
    RunVerdict.UNPROVEN: "some steps are not decided; nothing is said about them.",
    RunVerdict.FAIL: "a strand passed through another, or broke; see the alerts.",
}

NEAR = {
    "pair": "proved, but the motion is {limit:g} of the limit or more",
    "nu": "proved, but 2 x displacement is {limit:g} of the least distance or more",
    "clearance": "proved, but some pair is only {limit:g} Å apart or less",
}


def aligned(rows: Sequence[tuple[str, str]], *, indent: str = "  ") -> Iterator[str]:
    """Yield one line per row, the second column aligned."""
    width = max((len(name) for name, _ in rows), default=0)
    for name, value in rows:
        yield f"{indent}{name.ljust(width)}  {value}".rstrip()


def headline(summary: RunSummary) -> str:
    """Return the verdict with its meaning, in one line."""
    text = HEADLINES[summary.verdict]
    counts = summary.counts
    if summary.verdict is RunVerdict.FAIL:
        found = [_crossings(summary)] if any(summary.crossings.values()) else []
        found += [_count(summary.n_fractures, "broken edge", "broken edges")] if summary.n_fractures else []
        text = f"{' and '.join(found)}; see the alerts."
    if summary.verdict is RunVerdict.UNPROVEN and counts.crossed:
        text = f"{_crossings(summary)}: the frames are too far apart to tell a passage from a detour."
        if counts.unresolved:
            text += f" {_count(counts.unresolved, 'step is', 'steps are')} not decided."
    if summary.stopped and summary.verdict is RunVerdict.UNPROVEN:
        text = "the trajectory could not be read to its end; the counts are of what was read."
    if not counts.steps:
        text = "there is no step to look at: a step needs two frames."
    return f"{summary.verdict.value}: {text}"


def _crossings(summary: RunSummary) -> str:
    grades = [f"{n} {grade.name.lower()}" for grade, n in sorted(summary.crossings.items(), reverse=True) if n]
    return f"{_count(sum(summary.crossings.values()), 'crossing', 'crossings')} ({', '.join(grades)})"


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def summary_text(
    summary: RunSummary, config: MonitorConfig, *, closest: str = "", alerts_at: str = "", results_at: str = ""
) -> str:
    """Return the summary of a run, as ``mdtopo monitor`` prints it.

    Parameters
    ----------
    summary : RunSummary
        What the run came to.
    config : MonitorConfig
        Says what counts as near the limit.
    closest : str
        Which pair is the closest, in words; empty where that is not known.
    alerts_at, results_at : str
        Where they were written; empty where they were not.
    """
    lines = [headline(summary), "", *_count_lines(summary, config), ""]
    rows = [("closest pair", _closest(summary, closest)), ("alerts", _alerts(summary, alerts_at))]
    if results_at:
        note = " (incomplete)" if summary.stopped else ""
        rows.append(("results", f"{results_at}{note}"))
    return "\n".join([*lines, *aligned(rows)]) + "\n"


def _count_lines(summary: RunSummary, config: MonitorConfig) -> Iterator[str]:
    counts = summary.counts
    near = NEAR[config.criterion].format(limit=config.near_limit)
    table = [
        ("steps", counts.steps, ""),
        ("  proved by ball", counts.ball, "every vertex moved less than the least distances of the strands allow"),
        ("  proved by pairs", counts.pairs, "every pair of edges was shown to stay apart"),
        ("  near the limit", counts.near_limit, near),
        ("  unresolved", counts.unresolved, "not decided, or the data were unusable"),
        ("  crossed", counts.crossed, "straight paths between the frames pass through each other"),
    ]
    width = max(len(str(number)) for _, number, _ in table)
    yield from aligned([(name, f"{number:{width}d}  {meaning}") for name, number, meaning in table])


def _closest(summary: RunSummary, closest: str) -> str:
    if not math.isfinite(summary.clearance):
        return "not known, no step was proved"
    pair = f" between {closest}" if closest else ""
    if summary.clearance == 0.0:
        return f"proved never to meet, too close to say how far apart (step {summary.clearance_step}{pair})"
    return f"proved to stay at least {summary.clearance:.4g} Å apart (step {summary.clearance_step}{pair})"


def _alerts(summary: RunSummary, alerts_at: str) -> str:
    where = f" in {alerts_at}" if alerts_at else ""
    found = [_counted(n, s) for s, n in sorted(summary.alerts.items(), reverse=True) if n]
    return (", ".join(found) or "none") + where


def _counted(n: int, severity: Severity) -> str:
    plural = "s" if n > 1 and severity is Severity.WARNING else ""
    return f"{n} {severity.name.lower()}{plural}"


def counts_as_failure(alerts: dict[Severity, int] | Any, fail_on: str) -> bool:
    """Return whether there are alerts of the named severity or a higher one."""
    names = {severity.name.lower(): severity for severity in Severity}
    return fail_on in names and any(n for severity, n in alerts.items() if severity >= names[fail_on])
