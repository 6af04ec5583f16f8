"""``mdtopo alerts``: the alerts of a results file, filtered, or drawn anew with another threshold."""

import argparse
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from mdtopo.cli.alertformats import FORMATS, CurveTypeFields, formatted
from mdtopo.cli.exits import Exit, say
from mdtopo.cli.options import VERBOSE, add_options, frame_slice, knob_options
from mdtopo.cli.resultsfile import add_results_command, say_if_unfinished
from mdtopo.errors import InputError, OptionError
from mdtopo.records.alerts import Alert, AlertKind, Severity
from mdtopo.records.config import MonitorConfig
from mdtopo.records.crossings import Shape

if TYPE_CHECKING:
    from mdtopo.records import Strands

DESCRIPTION = """\
Print the alerts of a results file, all or some. With --near-limit or --criterion the near-limit alerts are drawn anew
from the stored numbers, as a run with that threshold would have raised them; the trajectory is not read again.
"""

EXAMPLE = """\
On a terminal the alerts are a table, else JSON Lines, as 'mdtopo monitor --alerts' writes them. An alert passes when it
meets every filter; a filter that can be repeated is met when one of its values is.

example:
  mdtopo alerts run.h5 --severity critical
  mdtopo alerts run.h5 --kind near-limit --criterion clearance --near-limit 1.5 --format csv > near.csv

"""

SHOWN_NAMES = 10
"""Strand names that an error message lists."""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = add_results_command(
        commands,
        "alerts",
        "filter the alerts of a results file, or draw them anew with another threshold",
        "[options] RESULTS [TOPOLOGY TRAJECTORY ...]",
        DESCRIPTION,
        EXAMPLE,
    )
    group = parser.add_argument_group("filters")
    kinds = [kind.value for kind in AlertKind]
    group.add_argument("--kind", choices=kinds, action="append", help="alerts of this kind; can be repeated")
    severities = [severity.name.lower() for severity in Severity]
    group.add_argument("--severity", choices=severities, help="alerts of this severity or a higher one")
    group.add_argument(
        "--strand",
        metavar="NAME",
        action="append",
        help="alerts that concern this strand at their worst step; can be repeated",
    )
    shapes = [shape.name.lower() for shape in Shape]
    group.add_argument(
        "--object", choices=shapes, help="alerts about the polyline (and all that concerns both), or the curve alone"
    )
    group.add_argument(
        "--frames",
        metavar="START:STOP",
        type=_frame_range,
        help="alerts whose frames meet this range of the trajectory's frames, counted from 0; gaps belong to no frame",
    )
    add_options(parser, tuple(option for option in knob_options() if option.name in ("criterion", "near-limit")))
    parser.add_argument(
        "--format", choices=FORMATS, help="how they are printed (default: table on a terminal, else jsonl)"
    )
    parser.add_argument(
        "--curve-type",
        action="store_true",
        help="say of each alert whether the drawn curve of its strands has their own type in the two frames of its "
        "worst step; reads the trajectory again, and takes about a second for each",
    )
    parser.add_argument(
        "inputs",
        metavar="INPUT",
        nargs="*",
        type=Path,
        default=[],
        help="with --curve-type: topology and trajectory, where they are not any more where they were",
    )
    add_options(parser, (VERBOSE,))
    parser.set_defaults(run=run, parser=parser)


def _frame_range(text: str) -> range:
    try:
        wanted = frame_slice(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    start, stop = wanted.start or 0, sys.maxsize if wanted.stop is None else wanted.stop
    if wanted.step is not None or start < 0 or stop < 0:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a range START:STOP of frames counted from 0, such as 100:200"
        )
    return range(start, stop)


def run(arguments: argparse.Namespace) -> Exit:
    """Print the alerts that pass."""
    alerts, strands, config = _read(arguments)
    if arguments.strand is not None:
        _refuse_unknown(arguments.results, arguments.strand, strands)
    chosen = [alert for alert in alerts if all(passes(alert) for passes in _filters(arguments))]
    form = arguments.format or ("table" if sys.stdout.isatty() else "jsonl")
    for line in formatted(chosen, form, _curve_types(arguments, chosen)):
        sys.stdout.write(line)
    if form == "table":
        say(f"{len(chosen)} of {len(alerts)} alerts; near-limit means {_limit_in_words(config)}.")
    elif not chosen:
        say(f"no alerts match, of {len(alerts)}.")
    return Exit.DONE


def _curve_types(arguments: argparse.Namespace, chosen: "list[Alert]") -> "dict[str, CurveTypeFields] | None":
    """Return what `--curve-type` adds to each alert, by its id; None where it is not asked for."""
    if not arguments.curve_type:
        if arguments.inputs:
            arguments.parser.error("input files are only read for --curve-type")
        return None
    from mdtopo.curvetypes import alert_types
    from mdtopo.store import read_so_far

    results = read_so_far(arguments.results, columns=("frame_t0", "frame_t1"))
    found = alert_types(arguments.results, results, chosen, arguments.inputs)
    return {
        key: CurveTypeFields(start.isotopy.name.lower(), end.isotopy.name.lower(), (start.reason, end.reason))
        for key, (start, end) in found.items()
    }


def _read(arguments: argparse.Namespace) -> "tuple[list[Alert], Strands, MonitorConfig]":
    """Return the alerts, drawn anew where another threshold is asked for, the strands, and the configuration."""
    from mdtopo.rethresholding import needed_columns, rethresholded
    from mdtopo.store import read_so_far

    given = {knob: getattr(arguments, knob) for knob in ("criterion", "near_limit") if hasattr(arguments, knob)}
    try:
        MonitorConfig.check_each(given)
    except OptionError as error:
        arguments.parser.error(str(error))
    results = read_so_far(arguments.results, columns=())
    say_if_unfinished(arguments.results, results)
    stored = MonitorConfig.from_mapping(results.config)
    if not given:
        return list(results.alerts), results.strands, stored
    criterion = given.get("criterion", stored.criterion)
    if "near_limit" not in given and criterion != stored.criterion and "clearance" in {stored.criterion, criterion}:
        units = "in Å" if criterion == "clearance" else "a ratio"
        arguments.parser.error(
            f"the stored limit {stored.near_limit:g} is for the criterion {stored.criterion}; pass --near-limit, "
            f"which is {units} for {criterion}"
        )
    try:
        config = replace(stored, **given)
    except OptionError as error:
        arguments.parser.error(str(error))
    results = read_so_far(arguments.results, columns=needed_columns(config))
    return rethresholded(results, config), results.strands, config


def _limit_in_words(config: MonitorConfig) -> str:
    if config.criterion == "clearance":
        return f"a clearance of {config.near_limit:g} Å or less"
    name = "pair ratio" if config.criterion == "pair" else "2m/ν"
    return f"a {name} of {config.near_limit:g} or more"


def _refuse_unknown(path: Path, wanted: Iterable[str], strands: "Strands") -> None:
    for name in wanted:
        if name not in strands.names:
            shown = ", ".join(map(repr, islice(strands.names, SHOWN_NAMES)))
            more = f", ... ({strands.n_strands} strands)" if strands.n_strands > SHOWN_NAMES else ""
            raise InputError(f"{path} has no strand {name!r}; its strands are {shown}{more}.")


def _filters(arguments: argparse.Namespace) -> list[Callable[[Alert], bool]]:
    filters: list[Callable[[Alert], bool]] = []
    if arguments.kind is not None:
        filters.append(lambda alert: alert.kind.value in arguments.kind)
    if arguments.severity is not None:
        least = Severity[arguments.severity.upper()]
        filters.append(lambda alert: alert.severity >= least)
    if arguments.object is not None:
        filters.append(lambda alert: alert.object.name.lower() == arguments.object)
    if arguments.strand is not None:
        filters.append(lambda alert: not set(alert.strands).isdisjoint(arguments.strand))
    if arguments.frames is not None:
        frames: range = arguments.frames
        filters.append(lambda alert: alert.frame_end >= max(frames.start, 0) and 0 <= alert.frame_start < frames.stop)
    return filters
