"""``mdtopo explain``: the story of one step."""

import argparse
import sys
import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from mdtopo.cli.alertformats import printable
from mdtopo.cli.exits import Exit
from mdtopo.cli.options import VERBOSE, add_options, whole_number
from mdtopo.cli.resultsfile import add_results_command, say_if_unfinished

if TYPE_CHECKING:
    from mdtopo.explanation import Section

WIDTH = 100

DESCRIPTION = """\
Tell the story of one step in plain words with its numbers: what moved, how near pairs came, which rule decided, what
crossed, and which frame spacing would have settled it. Everything is taken from the results file.
"""

EXAMPLE = """\
example:
  mdtopo explain run.h5 489
  mdtopo explain run.h5 --frame 250

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = add_results_command(
        commands,
        "explain",
        "tell the story of one step in plain words",
        "[options] RESULTS (STEP | --frame N)",
        DESCRIPTION,
        EXAMPLE,
    )
    parser.add_argument("step", metavar="STEP", type=whole_number, nargs="?", help="number of the step, counted from 0")
    parser.add_argument(
        "--frame",
        metavar="N",
        type=whole_number,
        help="instead of a step: the one that begins at this frame of the trajectory",
    )
    add_options(parser, (VERBOSE,))
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Print the story."""
    if (arguments.step is None) == (arguments.frame is None):
        arguments.parser.error("name a step, or a frame with --frame, and not both")
    from mdtopo.explanation import explain, step_of_frame
    from mdtopo.store import read_so_far

    path, step = arguments.results, arguments.step
    if step is None:
        step = step_of_frame(read_so_far(path, columns=("frame_t0", "frame_t1")), arguments.frame)
    results = read_so_far(path, steps=range(step, step + 1))
    say_if_unfinished(path, results)
    sys.stdout.write("\n".join(_lines(explain(results, step))) + "\n")
    return Exit.DONE


def _lines(sections: "Sequence[Section]") -> Iterator[str]:
    for k, section in enumerate(sections):
        if k:
            yield ""
        yield section.title
        for sentence in section.sentences:
            indent = "    " if sentence.startswith("  ") else "  "
            text = printable(sentence.strip())
            yield from textwrap.wrap(
                text, WIDTH, initial_indent=indent, subsequent_indent=indent + "  ", break_on_hyphens=False
            )
