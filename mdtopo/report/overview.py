"""Many runs on one page: a row for each, worst first, with a link to its own page."""

from collections.abc import Sequence
from dataclasses import dataclass

from mdtopo.records import RunVerdict
from mdtopo.records.headline import headline
from mdtopo.report.page import SHAPES, VERDICT_SHAPES, figure, render_template
from mdtopo.report.rundata import RunData

WORST_FIRST = (RunVerdict.FAIL, RunVerdict.UNPROVEN, RunVerdict.WARN, RunVerdict.PASS)


@dataclass(frozen=True, slots=True, eq=False)
class OverviewRow:
    """One run of an overview, and the name of its page; `problem` says why there is none."""

    name: str
    run: RunData | None
    page: str
    problem: str = ""


def render_overview(rows: Sequence[OverviewRow]) -> str:
    """Return the page of many runs: those that cannot be read first, then worst first."""
    ordered = sorted(rows, key=_concern)
    shown = [
        {
            "row": row,
            "summary": row.run.summary if row.run is not None else None,
            "shape": VERDICT_SHAPES[row.run.summary.verdict.value] if row.run is not None else ("◆", "#CC79A7"),
            "text": headline(row.run.summary).split(": ", 1)[1] if row.run is not None else row.problem,
        }
        for row in ordered
    ]
    return render_template("overview.html.j2", {"rows": shown, "figure": figure, "shapes": list(SHAPES.values())})


def _concern(row: OverviewRow) -> tuple[int, int, int, float, str]:
    if row.run is None:
        return -1, 0, 0, 0.0, row.name
    summary = row.run.summary
    known = summary.clearance_step >= 0
    rank = WORST_FIRST.index(summary.verdict)
    counts = summary.counts
    return rank, -counts.crossed, -counts.unresolved, summary.clearance if known else 0.0, row.name
