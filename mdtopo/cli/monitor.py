"""``mdtopo monitor``: the main job."""

import argparse
import logging
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdtopo.cli.configfile import knobs_of, read_config
from mdtopo.cli.exits import EXIT_HELP, Exit, say
from mdtopo.cli.options import MONITOR_OPTIONS, add_options, frame_slice, given_options, settled
from mdtopo.cli.progress import ProgressDisplay, StderrHandler
from mdtopo.cli.summary import counts_as_failure, print_summary, summary_text
from mdtopo.errors import InputError, OptionError
from mdtopo.records.config import MonitorConfig

if TYPE_CHECKING:
    from mdtopo.pipeline import Progress
    from mdtopo.records import RunSummary

DESCRIPTION = """\
Look at every step of a trajectory (a step joins two consecutive frames) and prove that no strand passed through
another in it, or say that this is not proved. Raise alerts, and keep every number in a results file.
"""

EXAMPLE = """\
example:
  mdtopo monitor top.pdb traj.xtc -s "protein and name CA" -o run.h5 --alerts alerts.jsonl

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "monitor",
        help="watch every step of a trajectory: the main job",
        usage="mdtopo monitor [options] TOPOLOGY [TRAJECTORY ...]",
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_inputs(parser)
    add_config(parser)
    add_options(parser, MONITOR_OPTIONS)
    parser.set_defaults(run=run, parser=parser)


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """Add the input files."""
    parser.add_argument(
        "topology", metavar="TOPOLOGY", help="file that names the atoms: PDB, PSF, TPR, GRO, LAMMPS data, npz, ..."
    )
    parser.add_argument(
        "trajectory",
        metavar="TRAJECTORY",
        nargs="*",
        default=[],  # else argparse calls it required
        help="trajectory file, or its parts in order: XTC, DCD, TRR, ...",
    )


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add the configuration file."""
    parser.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="TOML file with any of these options ('mdtopo config' prints one); the command line wins over it",
    )


def settled_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return a value for every option of the job, from its default, the configuration file and the command line."""
    given = given_options(arguments, MONITOR_OPTIONS)
    try:
        MonitorConfig.check_each(knobs_of(given))
    except OptionError as error:
        arguments.parser.error(str(error))
    stored = read_config(arguments.config) if arguments.config is not None else {}
    options = settled(MONITOR_OPTIONS, stored, given)
    try:
        MonitorConfig.from_mapping(knobs_of(options))
    except OptionError as error:
        arguments.parser.error(str(error))
    return options


def run(arguments: argparse.Namespace) -> Exit:
    """Run the job as the command line says, and print what it came to."""
    options = settled_options(arguments)
    inputs = [Path(arguments.topology), *(Path(part) for part in arguments.trajectory)]
    _check_lengths(options, arguments.parser)
    summary = run_job(inputs, options, argv=arguments.argv)
    if summary.checkpoint:
        kept = "shards" if options["dask"] is not None else "parts"
        say(
            f"put down after {summary.n_steps} steps, because {summary.checkpoint}; they are in "
            f"{options['out']}.{kept}, and the same command goes on with them."
        )
        return Exit.CHECKPOINT
    if summary.stopped:
        kept = f" The {summary.n_steps} steps before are in {summary.results}." if summary.results else ""
        say(f"the run stopped early: {summary.stopped}{kept}")
        return Exit.BAD_INPUT
    return Exit.ALERTS if counts_as_failure(summary.alerts, options["fail_on"]) else Exit.DONE


def _check_lengths(options: Mapping[str, Any], parser: argparse.ArgumentParser) -> None:
    from mdtopo.pipeline import PartLength, StopRequest

    try:
        StopRequest(options["max_hours"])
        PartLength(options["part_steps"], options["part_minutes"])
    except OptionError as error:
        parser.error(str(error))


def run_job(inputs: list[Path], options: Mapping[str, Any], *, argv: list[str]) -> "RunSummary":
    """Run the job with settled options, and print its summary.

    Raises
    ------
    MdtopoError
        As `mdtopo.pipeline.monitor` does.
    """
    from mdtopo.pipeline import PartLength, StopRequest, monitor, monitor_on_cluster, stopping_on_signals

    _refuse_same_file(inputs, options)
    _refuse_report(options)
    config = MonitorConfig.from_mapping(knobs_of(dict(options)))
    to_stdout = options["alerts"] == "-"
    display = _Display(quiet=options["quiet"], bar=sys.stderr.isatty() and not (to_stdout and sys.stdout.isatty()))
    stop = StopRequest(options["max_hours"])
    can_go_on = options["out"] is not None and threading.current_thread() is threading.main_thread()
    signals = stopping_on_signals(stop) if can_go_on else nullcontext()
    with signals:  # to the end: whatever comes then comes too late to stop anything
        with display, logging_to_stderr(options, display.progress), _interruptible(display, options["out"]):
            job = monitor if options["dask"] is None else partial(monitor_on_cluster, **_cluster(options))
            summary = job(
                *inputs,
                select=options["select"],
                out=options["out"],
                alerts=options["alerts"],
                frames=frame_slice(options["frames"]),
                config=config,
                reader=options["reader"],
                reader_options=options["reader_option"],
                threads=options["threads"],
                overwrite=options["overwrite"],
                on_progress=display.show,
                argv=argv,
                stop=stop,
                parts=PartLength(options["part_steps"], options["part_minutes"]),
                broken_from=options["broken_from"],
            )
        if summary.checkpoint:
            return summary
        if options["report"] is not None and summary.n_steps:
            _write_report(inputs, options)
        if not options["quiet"]:
            print_summary(_summary(summary, config, options), to_log=to_stdout)
        return summary


def _cluster(options: Mapping[str, Any]) -> dict[str, Any]:
    if options["out"] is None:
        raise InputError("--dask needs --out: what the workers measure is kept in files beside it.")
    return {"cluster": options["dask"], "shard_steps": options["shard_steps"]}


def _refuse_report(options: Mapping[str, Any]) -> None:
    """Refuse, before hours are spent, a report that could not be written after them."""
    if options["report"] is None:
        return
    from mdtopo.store.atomic import check_target

    if options["out"] is None:
        raise InputError(f"--report {options['report']} is made from the results file; name one with --out.")
    check_target(Path(options["report"]), overwrite=options["overwrite"])


def _write_report(inputs: list[Path], options: Mapping[str, Any]) -> None:
    from mdtopo.reporting import write_report

    write_report(Path(options["out"]), Path(options["report"]), inputs, overwrite=options["overwrite"])


def _summary(summary: "RunSummary", config: MonitorConfig, options: Mapping[str, Any]) -> str:
    results = str(summary.results) if summary.results is not None else ""
    alerts = "" if options["alerts"] in (None, "-") else str(options["alerts"])
    report = str(options["report"] or "") if summary.n_steps else ""
    return summary_text(summary, config, alerts_at=alerts, results_at=results, report_at=report)


def _refuse_same_file(inputs: list[Path], options: Mapping[str, Any]) -> None:
    """Refuse to write over an input, or two outputs to one file: --overwrite must not destroy a trajectory."""
    taken = {path.resolve(): "an input file" for path in inputs}
    if options["broken_from"] is not None:
        taken[Path(options["broken_from"]).resolve()] = "the shard of --broken-from"
    for name in ("out", "alerts", "report"):
        if options[name] in (None, "-"):
            continue
        path = Path(options[name]).resolve()
        if path in taken and (path.is_file() or not path.exists()):
            raise InputError(f"--{name} {options[name]} is {taken[path]} too; choose another name.")
        taken[path] = {"out": "the results file", "alerts": "the alert file"}.get(name, "the report")


class _Display:
    """The progress display, or none when all is to be quiet; remembers whether any step was measured."""

    def __init__(self, *, quiet: bool, bar: bool) -> None:
        self.progress = None if quiet else ProgressDisplay(bar=bar)
        self.steps = 0

    def show(self, progress: "Progress") -> None:
        """Show how far the run is, and remember it."""
        self.steps = progress.steps
        if self.progress is not None:
            self.progress.show(progress)

    def __enter__(self) -> "_Display":
        return self

    def __exit__(self, *_: object) -> None:
        if self.progress is not None:
            self.progress.clear()


@contextmanager
def _interruptible(display: _Display, out: str | None) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as error:
        if out is not None and display.steps:
            error.add_note(
                f"The {display.steps} steps measured until then are in {out}.parts; the same command goes on with them."
            )
        raise


@contextmanager
def logging_to_stderr(options: Mapping[str, Any], progress: ProgressDisplay | None = None) -> Iterator[None]:
    """Show what mdtopo logs on standard error, and nothing of other packages."""
    logger = logging.getLogger("mdtopo")
    handler, before = StderrHandler(progress), (logger.level, logger.propagate)
    level = logging.DEBUG if options["verbose"] else logging.INFO
    logger.setLevel(logging.WARNING if options["quiet"] else level)
    logger.propagate = False
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.level, logger.propagate = before
