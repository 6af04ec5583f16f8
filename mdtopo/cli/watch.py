"""``mdtopo watch``: follow a trajectory while another program writes it."""

import argparse
import math
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from mdtopo.cli.configfile import knobs_of
from mdtopo.cli.exits import EXIT_HELP, Exit, say
from mdtopo.cli.monitor import add_config, add_inputs, logging_to_stderr, settled_options
from mdtopo.cli.options import INPUT_OPTIONS, OUTPUT_OPTIONS, add_options, knob_options
from mdtopo.cli.progress import ProgressDisplay
from mdtopo.cli.summary import counts_as_failure, print_summary, summary_text
from mdtopo.records.config import MonitorConfig

DESCRIPTION = """\
Follow a trajectory while a simulation writes it, and raise alerts as frames come: on standard output, one line of JSON
each, unless --alerts names another place. Only whole frames are looked at. The watch ends on Ctrl-C, on SIGTERM, or
when the file has stood still for --idle-timeout seconds; each of these is a good end (exit code 0).
"""

EXAMPLE = """\
example:
  mdtopo watch top.pdb running.xtc --idle-timeout 600 --prometheus /var/lib/node_exporter/mdtopo.prom

"""

NOT_FOR_A_WATCH = frozenset({"out", "report", "threads", "max-hours", "part-minutes", "part-steps"})
"""They are about results files, which a watch does not write, and about runs that are put down and go on."""

OPTIONS = (
    *(option for option in INPUT_OPTIONS if option.name != "frames"),
    *(option for option in OUTPUT_OPTIONS if option.name not in NOT_FOR_A_WATCH),
    *knob_options(),
)


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "watch",
        help="follow a trajectory while it is written",
        usage="mdtopo watch [options] TOPOLOGY [TRAJECTORY ...]",
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_inputs(parser)
    add_config(parser)
    group = parser.add_argument_group("watch")
    group.add_argument(
        "--idle-timeout", metavar="SECONDS", type=_seconds, help="end when the file has stood still so long"
    )
    group.add_argument(
        "--poll", metavar="SECONDS", type=_seconds, default=1.0, help="time between two looks (default: %(default)s)"
    )
    group.add_argument(
        "--prometheus", metavar="FILE", type=Path, help="write the counts there for Prometheus' node exporter"
    )
    add_options(parser, OPTIONS)
    parser.set_defaults(run=run, parser=parser)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return seconds


def run(arguments: argparse.Namespace) -> Exit:
    """Watch until the end, and print what was found."""
    from mdtopo.pipeline.watching import watch

    options = settled_options(arguments)
    config = MonitorConfig.from_mapping(knobs_of(dict(options)))
    alerts = options["alerts"] or "-"
    with (
        _stopping_on_signals() as stop,
        ProgressDisplay(bar=False) as display,
        logging_to_stderr(options, display),
    ):
        summary = watch(
            arguments.topology,
            *arguments.trajectory,
            select=options["select"],
            alerts=alerts,
            prometheus=arguments.prometheus,
            config=config,
            reader=options["reader"],
            reader_options=options["reader_option"],
            poll=arguments.poll,
            idle_timeout=arguments.idle_timeout,
            overwrite=options["overwrite"],
            is_stopped=lambda: bool(stop),
            on_progress=None if options["quiet"] else display.show,
        )
    if not options["quiet"]:
        to_log = alerts == "-"
        print_summary(summary_text(summary, config, alerts_at="" if to_log else alerts), to_log=to_log)
    if summary.stopped:
        say(f"the trajectory has stood still, and ends badly: {summary.stopped}")
        return Exit.BAD_INPUT
    return Exit.ALERTS if counts_as_failure(summary.alerts, options["fail_on"]) else Exit.DONE


@contextmanager
def _stopping_on_signals() -> Iterator[list[int]]:
    """Yield a list that holds the signal which asked for the end, as soon as one has."""
    received: list[int] = []

    def receive(number: int, _: FrameType | None) -> None:
        received.append(number)

    before = {number: signal.signal(number, receive) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
