"""What a run comes to, as text."""

import math
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from mdtopo.cli.exits import write_log
from mdtopo.records import CurveCounts, MonitorConfig, RunSummary, Severity
from mdtopo.records.headline import headline, state_meanings


def print_summary(text: str, *, to_log: bool) -> None:
    """Print a summary on standard output, or among the log where standard output carries data."""
    if to_log:
        write_log(sys.stderr, text)
    else:
        sys.stdout.write(text)
        sys.stdout.flush()


def aligned(rows: Sequence[tuple[str, str]], *, indent: str = "  ") -> Iterator[str]:
    """Yield one line per row, the second column aligned."""
    width = max((len(name) for name, _ in rows), default=0)
    for name, value in rows:
        yield f"{indent}{name.ljust(width)}  {value}".rstrip()


def summary_text(
    summary: RunSummary,
    config: MonitorConfig,
    *,
    alerts_at: str = "",
    results_at: str = "",
    report_at: str = "",
) -> str:
    """Return the summary of a run, as ``mdtopo monitor`` prints it.

    Parameters
    ----------
    summary : RunSummary
        What the run came to.
    config : MonitorConfig
        Says what counts as near the limit.
    alerts_at, results_at, report_at : str
        Where they were written; empty where they were not.
    """
    lines = [headline(summary), "", *_count_lines(summary, config), ""]
    rows = [("closest pair", _closest(summary)), ("alerts", _alerts(summary, alerts_at))]
    if summary.curve is not None:
        rows.insert(1, ("smooth curve", _curve(summary.curve, config)))
    if results_at:
        note = " (incomplete)" if summary.stopped else ""
        rows.append(("results", f"{results_at}{note}"))
    if report_at:
        rows.append(("report", report_at))
    return "\n".join([*lines, *aligned(rows)]) + "\n"


def _count_lines(summary: RunSummary, config: MonitorConfig) -> Iterator[str]:
    counts = summary.counts
    numbers = (counts.ball, counts.pairs, counts.near_limit, counts.unresolved, counts.crossed)
    named = zip(state_meanings(config).values(), numbers, strict=True)
    table = [("steps", counts.steps, ""), *((f"  {word}", number, meaning) for (word, meaning), number in named)]
    width = max(len(str(number)) for _, number, _ in table)
    yield from aligned([(name, f"{number:{width}d}  {meaning}") for name, number, meaning in table])


def _closest(summary: RunSummary) -> str:
    if not math.isfinite(summary.clearance):
        return "not known, no step was proved"
    pair = f" between {summary.closest}" if summary.closest else ""
    if summary.clearance == 0.0:
        return f"proved never to meet, too close to say how far apart (step {summary.clearance_step}{pair})"
    return f"proved to stay at least {summary.clearance:.4g} Å apart (step {summary.clearance_step}{pair})"


def _curve(counts: CurveCounts, config: MonitorConfig) -> str:
    found = [f"{counts.certified} steps proved"] + [f"{counts.unresolved} unresolved"] * bool(counts.unresolved)
    if counts.crossed:
        grades = [f"{n} {grade.name.lower()}" for grade, n in sorted(counts.crossings.items(), reverse=True) if n]
        found.append(f"{counts.crossed} crossed ({', '.join(grades)})")
    return f"{config.curve}: {', '.join(found)}"


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
