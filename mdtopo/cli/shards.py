"""``mdtopo shards``: cut a trajectory into ranges of frames, one a job."""

import argparse
import sys
from pathlib import Path

from mdtopo.cli.exits import EXIT_HELP, Exit
from mdtopo.cli.monitor import add_config, add_inputs, logging_to_stderr, settled_options
from mdtopo.cli.options import INPUT_OPTIONS, VERBOSE, add_options, count, frame_slice
from mdtopo.errors import InputError
from mdtopo.records.shards import SHARD_STEPS, frames_text, shard_frames

DESCRIPTION = """\
Cut a trajectory into shards, and print for each what 'mdtopo monitor --frames' takes, one a line. Neighbouring shards
share one frame, so that every step is in exactly one of them; 'mdtopo merge' makes their results one again.
"""

EXAMPLE = """\
example:
  mdtopo shards top.pdb traj.xtc --steps 50000
  mdtopo monitor top.pdb traj.xtc --frames 0:50001 -o shard-1.h5
  mdtopo monitor top.pdb traj.xtc --frames 50000:100001 -o shard-2.h5
  mdtopo merge shard-1.h5 shard-2.h5 -o run.h5

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "shards",
        help="cut a trajectory into ranges of frames, one a job",
        usage="mdtopo shards [options] TOPOLOGY [TRAJECTORY ...]",
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_inputs(parser)
    add_config(parser)
    parser.add_argument(
        "--steps",
        metavar="N",
        type=count,
        default=SHARD_STEPS,
        help="greatest number of steps in a shard (default: %(default)s)",
    )
    add_options(parser, (*INPUT_OPTIONS, VERBOSE))
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Print the shards."""
    from mdtopo.pipeline import open_input
    from mdtopo.pipeline.tables import check_end, check_frames

    options = settled_options(arguments)
    inputs = [Path(arguments.topology), *(Path(part) for part in arguments.trajectory)]
    with (
        logging_to_stderr({**options, "quiet": not options["verbose"]}),
        open_input(
            *inputs, select=options["select"], reader=options["reader"], reader_options=options["reader_option"]
        ) as reader,
    ):
        n_frames, chosen = reader.n_frames, frame_slice(options["frames"])
        check_frames(reader, chosen)
        check_end(reader, chosen)
    if n_frames is None:
        title = " + ".join(map(str, inputs))
        raise InputError(f"{title} is a stream: nobody knows its number of frames, and it cannot be cut into shards.")
    for frames in shard_frames(n_frames, chosen, arguments.steps):
        sys.stdout.write(f"{frames_text(frames)}\n")
    return Exit.DONE
