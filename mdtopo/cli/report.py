"""``mdtopo report``: one page that answers what passed, how close it was, and where to look."""

import argparse
import sys
from pathlib import Path

from mdtopo.cli.exits import EXIT_HELP, Exit
from mdtopo.cli.options import VERBOSE, add_options, given_options, settled

DESCRIPTION = """\
Write the report of a results file: one page that opens in any browser, works offline, and answers in ten seconds
whether anything passed, how close it was, where to look, and what was not checked.
"""

EXAMPLE = """\
example:
  mdtopo report run.h5 -o run.html

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "report",
        help="one self-contained page from a results file",
        usage="mdtopo report [options] RESULTS -o PAGE",
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("results", metavar="RESULTS", type=Path, help="results file of 'mdtopo monitor'")
    parser.add_argument("-o", "--out", metavar="PAGE", type=Path, help="the page (default: RESULTS with .html)")
    parser.add_argument(
        "--input",
        metavar="FILE",
        action="append",
        type=Path,
        default=[],
        help="topology, then trajectory, where they are not any more where they were; once for each",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a page that exists")
    add_options(parser, (VERBOSE,))
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Write the page, and say where it is."""
    from mdtopo.cli.monitor import logging_to_stderr
    from mdtopo.reporting import write_report

    out = arguments.out or arguments.results.with_suffix(".html")
    verbose = settled((VERBOSE,), given_options(arguments, (VERBOSE,)))
    with logging_to_stderr({**verbose, "quiet": True}):
        found = write_report(arguments.results, out, arguments.input, overwrite=arguments.overwrite)
    sys.stdout.write(f"{found.summary.verdict.value}: {found.n_steps} steps; the report is in {out}\n")
    return Exit.DONE
