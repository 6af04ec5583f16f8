"""``mdtopo merge``: shards of one trajectory, made one results file."""

import argparse
from pathlib import Path

from mdtopo.cli.exits import EXIT_HELP, Exit
from mdtopo.cli.options import NEVER, add_options, given_options, settled
from mdtopo.cli.options import OUTPUT_OPTIONS as ALL_OUTPUT_OPTIONS
from mdtopo.cli.summary import counts_as_failure, print_summary, summary_text
from mdtopo.errors import InputError
from mdtopo.records import MonitorConfig

OPTIONS = tuple(option for option in ALL_OUTPUT_OPTIONS if option.name in ("alerts", "overwrite", "fail-on", "quiet"))

DESCRIPTION = """\
Join results files of ranges of frames of one trajectory, which share one frame each, to the one that a single run would
have written. Steps that are missing or doubled are refused.
"""

EXAMPLE = """\
example:
  mdtopo monitor top.pdb traj.xtc --frames 0:501 -o a.h5
  mdtopo monitor top.pdb traj.xtc --frames 500:1001 -o b.h5
  mdtopo merge a.h5 b.h5 -o run.h5

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "merge",
        help="join the results of ranges of frames",
        usage="mdtopo merge [options] RESULTS [RESULTS ...] -o FILE",
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("shards", metavar="RESULTS", type=Path, nargs="+", help="results file of a range of frames")
    parser.add_argument("-o", "--out", metavar="FILE", type=Path, required=True, help="the joined results file")
    add_options(parser, OPTIONS)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Join the files, and print what the whole run comes to."""
    from mdtopo.pipeline import merge
    from mdtopo.store import read_results

    options = settled(OPTIONS, given_options(arguments, OPTIONS))
    if arguments.out.resolve() in {path.resolve() for path in arguments.shards}:
        raise InputError(f"--out {arguments.out} is one of the shards too; choose another name.")
    summary = merge(
        *arguments.shards,
        out=arguments.out,
        alerts=options["alerts"],
        overwrite=options["overwrite"],
        argv=arguments.argv,
    )
    if not options["quiet"]:
        config = MonitorConfig.from_mapping(read_results(arguments.out, columns=()).config)
        shown = "" if options["alerts"] in (None, "-") else str(options["alerts"])
        text = summary_text(summary, config, alerts_at=shown, results_at=str(arguments.out))
        print_summary(text, to_log=options["alerts"] == "-")
    fails = options["fail_on"] != NEVER and counts_as_failure(summary.alerts, options["fail_on"])
    return Exit.ALERTS if fails else Exit.DONE
