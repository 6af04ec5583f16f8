"""``mdtopo report``: one page that answers what passed, how close it was, and where to look."""

import argparse
import sys
from pathlib import Path

from mdtopo.cli.exits import EXIT_HELP, Exit
from mdtopo.cli.options import VERBOSE, add_options, given_options, settled, whole_number

DESCRIPTION = """\
Write the report of a results file: one page that opens in any browser, works offline, and answers in ten seconds
whether anything passed, how close it was, where to look, and what was not checked.
"""

EXAMPLE = """\
example:
  mdtopo report run.h5 -o run.html
  mdtopo report a.h5 b.h5 c.h5 -o all.html

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "report",
        help="one self-contained page from a results file",
        usage="mdtopo report [options] RESULTS [RESULTS ...] [-o PAGE]",
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "results",
        metavar="RESULTS",
        nargs="+",
        type=Path,
        help="results files; one page names several",
    )
    parser.add_argument("-o", "--out", metavar="PAGE", type=Path, help="the page (default: RESULTS with .html)")
    parser.add_argument("--multiqc", action="store_true", help="write *_mqc.json files for MultiQC beside the page")
    parser.add_argument(
        "--input",
        metavar="FILE",
        action="append",
        type=Path,
        default=[],
        help="topology, then trajectory, where they are not any more where they were; once for each",
    )
    parser.add_argument(
        "--views",
        metavar="N",
        type=whole_number,
        help="3D views of the N worst events, however large the page becomes (default: up to 16, below 8 MB)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a page that exists")
    add_options(parser, (VERBOSE,))
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Write the page, and say where it is."""
    from mdtopo.cli.monitor import logging_to_stderr
    from mdtopo.reporting import write_multiqc, write_overview, write_report

    many, overwrite = len(arguments.results) > 1, arguments.overwrite
    if many and arguments.out is None:
        arguments.parser.error("the page of several runs needs a name; give one with --out")
    if many and arguments.input:
        arguments.parser.error("--input is for one run; make the reports one at a time")
    out = arguments.out or arguments.results[0].with_suffix(".html")
    verbose = settled((VERBOSE,), given_options(arguments, (VERBOSE,)))
    with logging_to_stderr({**verbose, "quiet": True}):
        if many:
            pages = {"views": arguments.views, "overwrite": overwrite}
            rows = write_overview(arguments.results, out, multiqc=arguments.multiqc, **pages)
            sys.stdout.write(f"{len(rows)} runs; the overview is in {out}\n")
            return Exit.DONE if all(row.run is not None for row in rows) else Exit.BAD_INPUT
        found = write_report(arguments.results[0], out, arguments.input, views=arguments.views, overwrite=overwrite)
        if arguments.multiqc:
            write_multiqc(found, out, overwrite=overwrite)
    so_far = " in finished parts, the run has not ended" if found.in_progress else ""
    sys.stdout.write(f"{found.summary.verdict.value}: {found.n_steps} steps{so_far}; the report is in {out}\n")
    return Exit.DONE
