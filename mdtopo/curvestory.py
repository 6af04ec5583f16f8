"""The story of one step of the smooth curve in words, beside the polyline's."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mdtopo.alerts import crossing_in_words
from mdtopo.curvealerts import own_crossings
from mdtopo.records import Crossing, CurveVerdict, Grade, Reason, Rung
from mdtopo.store import Results

CURVE_VERDICTS = {
    CurveVerdict.NONE: "It was not looked at (--curve none).",
    CurveVerdict.CERTIFIED: "CERTIFIED: proved that the curve never meets itself while atoms move on straight paths.",
    CurveVerdict.CROSSING: "CROSSING: proved that the curve passes through itself, or one strand's through another's.",
    CurveVerdict.UNRESOLVED: "UNRESOLVED: it is not known whether the curve passed through itself.",
}

CURVE_REASONS = {
    Reason.LADDER: "halving does not end for two segments: they touch, or pass too close to a frame or an end to tell",
    Reason.FOLD: "halving does not end within a segment or at a joint, as at a cusp or where the curve folds back",
    Reason.CELL: "the images that two segments may meet in cannot be counted",
    Reason.BAD_DATA: "one of the two frames cannot be used",
    Reason.IMAGE_JUMP: "part of a strand jumps by a lattice vector",
}


def curve_story(results: Results, step: int, row: Mapping[str, Any], kind: str) -> Iterator[str]:
    """Yield sentences about the curve in one step; none where the file knows of no curve.

    Parameters
    ----------
    results : Results
    step : int
    row : mapping
        The values of the step's columns.
    kind : str
        The curve of the run.
    """
    if "curve_verdict" not in row:
        return
    verdict = CurveVerdict(int(row["curve_verdict"]))
    shape = "" if verdict is CurveVerdict.NONE else f" ({kind})"
    yield f"The curve{shape}. {CURVE_VERDICTS[verdict]}"
    reason = Reason(int(row["curve_reason"]))
    if reason is not Reason.NONE:
        yield f"Reason {reason.name}: {CURVE_REASONS[reason]}."
        yield from _place(results, row)
    if math.isnan(row["curve_d_star"]):
        return
    yield from _paper(results, row)
    yield from _depth(results, row)
    yield from _crossings(results, step, row)


def _place(results: Results, row: Mapping[str, Any]) -> Iterator[str]:
    if np.isfinite(row["curve_place"]).all():
        (t0, t1), (u0, u1), (v0, v1) = row["curve_place"].tolist()
        pair = results.strands.describe_pair(row["curve_clearance_pair"])
        yield (
            f"  The first such place is {pair}, t = {t0:.6g} to {t1:.6g} of the step, {u0:.4f} to {u1:.4f} and "
            f"{v0:.4f} to {v1:.4f} along the segments."
        )


def _paper(results: Results, row: Mapping[str, Any]) -> Iterator[str]:
    segment = results.strands.describe_edge(row["curve_d_star_segment"])
    yield f"The paper's d*, the least distance of zero to a segment's hull, is {row['curve_d_star']:.4g} Å: {segment}."
    ratio = row["curve_bezier_ratio"]
    says = "below 1 no single segment comes to meet itself" if ratio < 1.0 else "not below 1, so it proves nothing here"
    yield (
        f"The paper's comparison in its sound form is {ratio:.4g} ({says}); as printed, with the motion of control "
        f"points themselves, {row['curve_printed_ratio']:.4g}, which says the same below 1/2 only."
    )


def _depth(results: Results, row: Mapping[str, Any]) -> Iterator[str]:
    verdict, depth, clearance = CurveVerdict(int(row["curve_verdict"])), int(row["curve_depth"]), row["curve_clearance"]
    rung = Rung(int(row["curve_rung"])).name.lower().replace("_", " ")
    if verdict is CurveVerdict.CERTIFIED:
        how = f"after {depth} halvings at most" if depth else "by hulls alone"
        yield f"Every check is settled {how}; the costliest rung is {rung}."
        pair = row["curve_clearance_pair"]
        if not math.isnan(clearance):
            where = f", {results.strands.describe_pair(pair)}" if (pair >= 0).all() else "; nobody looked further"
            yield f"Segments that share no point stay at least {clearance:.4g} Å apart{where}."


def _crossings(results: Results, step: int, row: Mapping[str, Any]) -> Iterator[str]:
    found = results.curve_crossings.of_step(step)
    own = own_crossings(found, results.crossings.of_step(step), results.strands)
    lone = {id_of(crossing) for crossing in own}
    spacing = float(row["time_t1"]) - float(row["time_t0"])
    for crossing in found:
        only = "; the polyline has no crossing there in this step" if id_of(crossing) in lone else ""
        yield f"{curve_crossing_in_words(crossing, spacing)}{only}."


def id_of(crossing: Crossing) -> tuple[object, ...]:
    """Return what tells the crossings of one step apart."""
    return crossing.t, *crossing.edges.ravel().tolist(), *crossing.image.tolist()


def curve_crossing_in_words(crossing: Crossing, spacing: float) -> str:
    """Return what passes through what, as `mdtopo.alerts.crossing_in_words` does for edges."""
    words = crossing_in_words(crossing, spacing)
    if crossing.grade is Grade.PROVEN:
        words = words.split("; proven:")[0] + "; proven: the linking number of the two curves changes"
    return "The curve of " + words.removeprefix("on straight paths ").replace("two edges", "two segments")
