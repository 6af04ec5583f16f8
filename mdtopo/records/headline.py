"""A run's verdict and its five counts in words: the same ones on the terminal and in the report."""

from mdtopo.records.config import MonitorConfig
from mdtopo.records.summary import RunSummary, RunVerdict, StepState

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


def state_meanings(config: MonitorConfig) -> dict[StepState, tuple[str, str]]:
    """Return a name and a meaning for each of the five counts."""
    near = NEAR[config.criterion].format(limit=config.near_limit)
    return {
        StepState.BALL: ("proved by ball", "every vertex moved less than the least distances of the strands allow"),
        StepState.PAIRS: ("proved by pairs", "every pair of edges was shown to stay apart"),
        StepState.NEAR_LIMIT: ("near the limit", near),
        StepState.UNRESOLVED: ("unresolved", "not decided, or the data were unusable"),
        StepState.CROSSED: ("crossed", "straight paths between the frames pass through each other"),
    }


def headline(summary: RunSummary) -> str:
    """Return the verdict with its meaning, in one line."""
    text = HEADLINES[summary.verdict]
    counts = summary.counts
    if summary.verdict is RunVerdict.WARN and not counts.near_limit:
        text = f"every step is proved, but {_warning(summary)}; see the alerts."
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


def _warning(summary: RunSummary) -> str:
    """Return what is to be warned of in a run without a near-limit step."""
    curve = summary.curve
    if curve is not None and curve.crossed:
        return f"the smooth curve passes in {_count(curve.crossed, 'step', 'steps')}, where its edges do not"
    if curve is not None and curve.unresolved:
        return f"{_count(curve.unresolved, 'step is', 'steps are')} not decided for the smooth curve"
    return "there are warnings"


def _crossings(summary: RunSummary) -> str:
    grades = [f"{n} {grade.name.lower()}" for grade, n in sorted(summary.crossings.items(), reverse=True) if n]
    return f"{_count(sum(summary.crossings.values()), 'crossing', 'crossings')} ({', '.join(grades)})"


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"
