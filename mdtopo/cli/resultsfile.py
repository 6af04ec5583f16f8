"""The commands that work on a results file: how they are called, and what is said of a run that has not ended."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mdtopo.cli.exits import EXIT_HELP, say

if TYPE_CHECKING:
    from mdtopo.store import Results


def add_results_command(
    commands: "argparse._SubParsersAction[argparse.ArgumentParser]",
    name: str,
    summary: str,
    usage: str,
    description: str,
    epilog: str,
) -> argparse.ArgumentParser:
    """Add a command whose first word is a results file, and return its parser.

    Parameters
    ----------
    commands : argparse action
        To which it is added.
    name, summary, usage, description, epilog : str
        Its name, one line for the list of commands, how it is called (without program and name), what it does, and what
        stands before the exit codes.
    """
    parser = commands.add_parser(
        name,
        help=summary,
        usage=f"mdtopo {name} {usage}",
        description=description,
        epilog=epilog + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("results", metavar="RESULTS", type=Path, help="results file of 'mdtopo monitor'")
    return parser


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """Add the words that name the trajectory of the results anew."""
    parser.add_argument(
        "inputs",
        metavar="INPUT",
        nargs="*",
        type=Path,
        default=[],
        help="topology and trajectory, where they are not any more where they were",
    )


def say_if_unfinished(path: Path, results: "Results") -> None:
    """Say of a run that has not come to its end that what is printed is about its beginning."""
    count = len(results.stored)
    held = f"{count} step{'' if count == 1 else 's'}"
    if results.in_progress:
        say(f"in progress: the run of {path} has not ended; this is about the {held} of its finished parts.")
    elif not results.complete:
        say(f"{path} is not complete: this is about the {held} that it holds.")
