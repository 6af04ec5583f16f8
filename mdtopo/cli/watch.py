"""``mdtopo watch``: follow a trajectory while another program writes it, or a run of ``mdtopo monitor``."""

import argparse
import math
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from mdtopo.cli.configfile import knobs_of
from mdtopo.cli.exits import EXIT_HELP, Exit, say
from mdtopo.cli.monitor import add_config, add_inputs, logging_to_stderr, settled_options
from mdtopo.cli.options import INPUT_OPTIONS, OUTPUT_OPTIONS, add_options, given_options, knob_options
from mdtopo.cli.progress import ProgressDisplay
from mdtopo.cli.summary import counts_as_failure, print_summary, summary_text
from mdtopo.errors import MissingFileError
from mdtopo.records.config import MonitorConfig

if TYPE_CHECKING:
    from mdtopo.pipeline.following import Followed
    from mdtopo.records import RunSummary

DESCRIPTION = """\
Follow a trajectory while a simulation writes it, and raise alerts as frames come: on standard output, one line of JSON
each, unless --alerts names another place. Only whole frames are looked at. The watch ends on Ctrl-C, on SIGTERM, or
when the file has stood still for --idle-timeout seconds; each of these is a good end (exit code 0).

Named the results file of 'mdtopo monitor' instead, finished or not, it follows that run: it prints the run's own alerts
as its parts are finished, and ends with the run. Exit code 75 then says that the run was put down or killed, and that
its command goes on with it.
"""

EXAMPLE = """\
example:
  mdtopo watch top.pdb running.xtc --idle-timeout 600 --prometheus /var/lib/node_exporter/mdtopo.prom
  mdtopo watch run.h5

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
        help="follow a trajectory while it is written, or a run",
        usage="mdtopo watch [options] TOPOLOGY [TRAJECTORY ...]\n       mdtopo watch [options] RESULTS",
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
    from mdtopo.store.stages import is_output

    if not arguments.trajectory and is_output(Path(arguments.topology)):
        return _follow_run(Path(arguments.topology), arguments)
    return _watch_trajectory(arguments)


def _follow_run(out: Path, arguments: argparse.Namespace) -> Exit:
    from mdtopo.pipeline.following import follow
    from mdtopo.store.stages import Stage

    given = given_options(arguments, (option for option in OPTIONS if option not in OUTPUT_OPTIONS))
    foreign = [*given, *(["config"] if arguments.config is not None else [])]
    if foreign:
        arguments.parser.error(f"{out} is the output of a run, which has settings of its own; leave --{foreign[0]} out")
    options = settled_options(arguments)
    alerts = options["alerts"] or "-"
    with (
        _stopping_on_signals() as stop,
        ProgressDisplay(bar=False) as display,
        logging_to_stderr(options, display),
    ):
        followed = follow(
            out,
            alerts=alerts,
            prometheus=arguments.prometheus,
            poll=arguments.poll,
            idle_timeout=arguments.idle_timeout,
            overwrite=options["overwrite"],
            is_stopped=lambda: bool(stop),
            on_progress=None if options["quiet"] else display.show,
        )
    if followed.end.stage is Stage.NOT_BEGUN and not stop:
        raise MissingFileError(f"{out} does not exist, and no run has begun to write it.")
    if not options["quiet"]:
        _print(followed.summary, followed.config, alerts)
    code = _say_end(out, followed)
    if code is not Exit.DONE:
        return code
    return Exit.ALERTS if counts_as_failure(followed.summary.alerts, options["fail_on"]) else Exit.DONE


def _say_end(out: Path, followed: "Followed") -> Exit:
    """Say of a run that has ended before its last step how it did, and return the exit code for that."""
    from mdtopo.store.stages import Stage

    n_steps, reason = followed.summary.n_steps, followed.end.reason
    because = f", because {reason}" if reason else ""
    match followed.end.stage:
        case Stage.PUT_DOWN:
            say(f"the run of {out} was put down after {n_steps} steps{because}; its command goes on with it.")
            return Exit.CHECKPOINT
        case Stage.KILLED:
            say(f"the run of {out} was killed; {n_steps} steps are safe, and its command goes on with them.")
            return Exit.CHECKPOINT
        case Stage.FAILED:
            say(f"the run of {out} has failed, with {n_steps} steps safe. {reason}".rstrip())
            return Exit.BAD_INPUT
        case Stage.STOPPED_EARLY:
            say(f"the run of {out} stopped early: {reason}")
            return Exit.BAD_INPUT
    return Exit.DONE


def _print(summary: "RunSummary", config: MonitorConfig, alerts: str) -> None:
    to_log = alerts == "-"
    print_summary(summary_text(summary, config, alerts_at="" if to_log else alerts), to_log=to_log)


def _watch_trajectory(arguments: argparse.Namespace) -> Exit:
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
        _print(summary, config, alerts)
    if summary.stopped:
        say(f"the trajectory has stood still, and ends badly: {summary.stopped}")
        return Exit.BAD_INPUT
    return Exit.ALERTS if counts_as_failure(summary.alerts, options["fail_on"]) else Exit.DONE


@contextmanager
def _stopping_on_signals() -> Iterator[list[int]]:
    """Yield a list that holds the signal which asked for the end, as soon as one has."""
    received: list[int] = []

    def receive(number: int, _: FrameType | None) -> None:
        """Note the signal."""
        received.append(number)

    before = {number: signal.signal(number, receive) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
