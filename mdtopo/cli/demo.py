"""``mdtopo demo``: the main job on a small trajectory that comes with the package."""

import argparse
import shlex
import sys
import textwrap
from collections.abc import Iterator
from importlib.resources import as_file, files
from pathlib import Path
from shutil import copyfile

from mdtopo.cli.exits import Exit
from mdtopo.cli.monitor import run_job
from mdtopo.cli.options import MONITOR_OPTIONS, settled
from mdtopo.cli.summary import aligned
from mdtopo.errors import OutputError

WIDTH = 100
INPUTS = ("duplex.data", "pull.dcd")

PROFILE_STEPS = 2
"""So few steps that the 59 of the example make a heat map."""

BEFORE = """\
A model of a double helix, two strands of 60 beads, is pulled until one strand breaks. The 60 frames come from a LAMMPS
run in the model's own units, which are printed as Å and ps. What runs now is this command:
"""

AFTER = """\
FAIL is the right answer here: in this run the bond between the beads 58 and 59 broke between the frames 38 and 39. No
strand passed through another; a strand that breaks is reported, because from then on it is another molecule. The
stretch is reported from where it begins, and the break when the edge has been too long for 3 frames:
"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "demo",
        help="run the job on a small example that comes with mdtopo",
        description="Run 'mdtopo monitor' on a small trajectory that comes with mdtopo, and say what it found.",
    )
    parser.add_argument(
        "-d",
        "--directory",
        metavar="DIR",
        type=Path,
        default=Path("mdtopo-demo"),
        help="where the example and its results are put; files of an earlier demo are replaced (default: %(default)s)",
    )
    parser.set_defaults(run=run, parser=parser, verbose=False)


def run(arguments: argparse.Namespace) -> Exit:
    """Copy the example, run the job on it, and explain the outcome."""
    directory: Path = arguments.directory
    inputs = _copy_inputs(directory)
    names = {"out": "run.h5", "alerts": "alerts.jsonl", "report": "run.html"}
    options = {option: str(directory / name) for option, name in names.items()}
    command = ["mdtopo", "monitor", *map(str, inputs), "-o", options["out"], "--alerts", options["alerts"]]
    command += ["--report", options["report"], "--profile-steps", str(PROFILE_STEPS), "--overwrite"]
    _print([*_wrapped(BEFORE), "", f"  {shlex.join(map(str, command))}", ""])
    run_job(
        inputs,
        settled(MONITOR_OPTIONS, options, {"overwrite": True, "profile-steps": PROFILE_STEPS}),
        argv=arguments.argv,
    )
    _print(["", *_wrapped(AFTER), "", *_alert_lines(directory / "run.h5"), "", *_next_steps(directory, inputs)])
    return Exit.DONE


def _copy_inputs(directory: Path) -> list[Path]:
    """Copy the example's files.

    Raises
    ------
    OutputError
        If the directory cannot be made or written to.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with as_file(files("mdtopo") / "demo") as source:
            for name in INPUTS:
                copyfile(source / name, directory / name)
    except OSError as error:
        raise OutputError(
            f"The demo cannot write to {directory} ({error.strerror}); choose another place with --directory."
        ) from error
    return [directory / name for name in INPUTS]


def _alert_lines(results: Path) -> Iterator[str]:
    from mdtopo.store import read_results

    alerts = read_results(results, columns=()).alerts
    for alert in sorted(alerts, key=lambda one: one.step_start):
        title = f"{alert.severity.name.lower()}: {alert.kind.value}"
        yield from textwrap.wrap(f"{title}. {alert.message}", WIDTH, initial_indent="  ", subsequent_indent="      ")


def _next_steps(directory: Path, inputs: list[Path]) -> list[str]:
    rows = [
        (str(directory / "run.html"), "the report: one page, open it in a browser"),
        (str(directory / "alerts.jsonl"), "one line of JSON for each alert"),
        (str(directory / "run.h5"), "every number of every step; in Python: mdtopo.read_results"),
        (shlex.join(["mdtopo", "doctor", *map(str, inputs)]), "how the input was understood"),
        ("mdtopo doctor TOPOLOGY TRAJECTORY", "the same for your own files"),
    ]
    return ["What to look at next:", *aligned(rows)]


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(" ".join(text.split()), WIDTH)


def _print(lines: list[str]) -> None:
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()
