"""``mdtopo doctor``: how an input is understood, before a long run is started on it."""

import argparse
import json
import math
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdtopo.cli.configfile import knobs_of
from mdtopo.cli.exits import Exit
from mdtopo.cli.monitor import add_config, add_inputs, logging_to_stderr, settled_options
from mdtopo.cli.options import INPUT_OPTIONS, VERBOSE, add_options, frame_slice
from mdtopo.cli.summary import aligned
from mdtopo.records.config import MonitorConfig

if TYPE_CHECKING:
    from mdtopo.cli.diagnosis import Box, Diagnosis, Sample, StrandGroup

WIDTH = 100

RUNG_WORDS = {
    "BALL": "no vertex moved half the least distance (the paper's ball)",
    "TWO_FRAME_BALL": "no vertex moved the mean of both frames' least distances",
    "BROAD_PHASE": "the bounding spheres of all pairs stay apart",
    "RELATIVE_MOTION": "pairs moved less than their distances",
    "DIRECTION": "pairs stay on their sides of a plane",
    "HULL": "the convex hull of a pair's differences avoids 0",
    "BISECTION": "pairs were proved piece by piece of the step",
    "EXACT": "exact passage test",
}

DESCRIPTION = """\
Show how an input is understood, before a long run: strands, gaps, box, times, edge lengths; and what 50 steps,
spread over the trajectory, say of the save interval. Exit code 4 when 'mdtopo monitor' would stop.
"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "doctor",
        help="show how an input is understood, before a long run",
        description=DESCRIPTION,
        usage="mdtopo doctor [options] TOPOLOGY [TRAJECTORY ...]",
    )
    add_inputs(parser)
    add_config(parser)
    add_options(parser, (*INPUT_OPTIONS, VERBOSE))
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Print the findings."""
    from mdtopo.cli.diagnosis import diagnose
    from mdtopo.pipeline import open_input

    options = settled_options(arguments)
    config = MonitorConfig.from_mapping(knobs_of(options))
    inputs = [Path(arguments.topology), *(Path(part) for part in arguments.trajectory)]
    title = " + ".join(str(path) for path in inputs)
    with logging_to_stderr({**options, "quiet": False}):
        reader = open_input(
            *inputs, select=options["select"], reader=options["reader"], reader_options=options["reader_option"]
        )
        with reader:
            found = diagnose(reader, title, frame_slice(options["frames"]), config)
    text = json.dumps(_plain(asdict(found)), indent=2, ensure_ascii=False) if arguments.json else diagnosis_text(found)
    sys.stdout.write(f"{text}\n")
    return Exit.BAD_INPUT if found.problems else Exit.DONE


def _plain(value: Any) -> Any:
    """Return a value as JSON knows it: NaN and infinity are null."""
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def diagnosis_text(found: "Diagnosis") -> str:
    """Return the findings as aligned plain text."""
    sections = [
        ("Input", aligned([("files", found.inputs), ("reader", found.reader)])),
        (_strands_title(found), aligned([_strand_row(group) for group in found.strands])),
        ("Gaps (no edge, and no guarantee across them)", _gaps(found)),
        ("Trajectory", aligned(list(_trajectory_rows(found)))),
        ("Notes", _bullets(found.notes)),
        (_sample_title(found.sample), _sample_lines(found.sample)),
        ("Advice", _bullets([found.advice])),
        ("Problems: 'mdtopo monitor' would stop here", _bullets(found.problems)),
    ]
    filled = ((title, list(lines)) for title, lines in sections)
    return "\n\n".join("\n".join([title, *lines]) for title, lines in filled if lines)


def _strands_title(found: "Diagnosis") -> str:
    count = sum(group.count for group in found.strands)
    strands = "1 strand" if count == 1 else f"{count} strands"
    return f"Strands: {found.n_vertices} vertices in {strands}"


def _strand_row(group: "StrandGroup") -> tuple[str, str]:
    kind = "closed" if group.is_closed else "open"
    first, last = group.names
    if group.count == 1:
        return first, f"{group.n_vertices} vertices, {kind}, {group.labels[0]} to {group.labels[1]}"
    each = f"{group.count} x {group.n_vertices} vertices, {kind}"
    return f"{first} ... {last}", f"{each}, {group.labels[0]} to {group.labels[1]}"


def _gaps(found: "Diagnosis") -> Iterator[str]:
    if not found.gaps:
        return iter(["  none"])
    return aligned([(gap.place, gap.reason) for gap in found.gaps])


def _trajectory_rows(found: "Diagnosis") -> Iterator[tuple[str, str]]:
    yield "frames", "not known, a stream" if found.n_frames is None else str(found.n_frames)
    yield "time", _time(found)
    yield "box", _box(found.box)
    rounding = (
        f"by at most {found.coordinate_error:.2g} Å" if found.coordinate_error > 0.0 else "in no way that is known"
    )
    yield "rounding", f"the file rounds positions {rounding} (coordinate error η)"
    if found.edge_frames:
        frames = "first frame" if found.edge_frames == 1 else f"first {found.edge_frames} frames"
        yield (
            "edge length",
            f"median {found.edge_median:.4g} Å, standard deviation {found.edge_spread:.2g} Å ({frames})",
        )


def _time(found: "Diagnosis") -> str:
    if math.isnan(found.time_first):
        return "not known"
    if math.isnan(found.spacing_least):
        return f"{found.time_first:g} ps"
    least, greatest = _short(found.spacing_least), _short(found.spacing_greatest)
    spacing = f"{least} ps" if least == greatest else f"{least} to {greatest} ps"
    last = f" to {found.time_last:g}" if math.isfinite(found.time_last) else ""
    return f"{found.time_first:g}{last} ps, {spacing} between analysed frames"


def _short(number: float) -> str:
    """Return a number to four digits, without an exponent where it is of ordinary size."""
    return f"{float(f'{number:.4g}'):g}"


def _box(box: "Box | None") -> str:
    if box is None:
        return "none: not periodic"
    lengths = " x ".join(_short(x) for x in box.lengths)
    angles = ", ".join(_short(x) for x in box.angles)
    return f"periodic, {lengths} Å, angles {angles} degrees (first frame)"


def _sample_title(sample: "Sample | None") -> str:
    steps = 0 if sample is None else sample.steps
    if sample is not None and sample.places > 1:
        return f"A sample: {steps} steps, at {sample.places} places spread evenly over the trajectory"
    return "The first step" if steps == 1 else f"The first {steps} steps"


def _sample_lines(sample: "Sample | None") -> Iterator[str]:
    if sample is None:
        return
    yield "  proved by the costliest rule that a step needed:"
    rows = [(f"  {_share(n, sample)}", RUNG_WORDS[name]) for name, n in sample.rungs.items() if n]
    undecided = sample.unresolved - sample.bad_data
    rows += [(f"  {_share(undecided, sample)}", "not decided")] if undecided else []
    rows += [(f"  {_share(sample.crossed, sample)}", _crossed_words(sample))] if sample.crossed else []
    rows += [(f"  {_share(sample.bad_data, sample)}", "not measured: unusable data")] if sample.bad_data else []
    yield from aligned(rows)
    yield "  how near the limit of 1:"
    ratios = [
        ("2 x greatest displacement / least distance (2m/ν)", sample.nu_ratio),
        ("relative motion / distances of the worst pair (pair ratio)", sample.pair_ratio),
    ]
    yield from aligned([(f"  {name}", f"median {m:.3g}, greatest {g:.3g}") for name, (m, g) in ratios])


def _crossed_words(sample: "Sample") -> str:
    shown = sample.crossed - sample.undersampled
    counts = [(shown, "proven or resolved"), (sample.undersampled, "undersampled")]
    grades = ", ".join(f"{number} {word}" for number, word in counts if number)
    return f"not proved: straight paths between the frames pass through each other (steps: {grades})"


def _share(number: int, sample: "Sample") -> str:
    return f"{100.0 * number / sample.steps:5.1f} %"


def _bullets(texts: "tuple[str, ...] | list[str]") -> Iterator[str]:
    for text in texts:
        yield from textwrap.wrap(text, WIDTH, initial_indent="  ", subsequent_indent="  ")
