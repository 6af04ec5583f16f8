"""The command line: ``mdtopo COMMAND ...``. Standard output carries data, standard error says everything else.

Nothing that is slow to import is imported before a command needs it.
"""

import argparse
import sys
from collections.abc import Sequence

from mdtopo import __version__
from mdtopo.cli import (
    alerts,
    config,
    demo,
    doctor,
    explain,
    export,
    merge,
    monitor,
    readers,
    report,
    shards,
    verify,
    watch,
)
from mdtopo.cli.exits import EXIT_HELP, Exit, close_log, exit_code, ignore_late_signals

COMMANDS = (demo, doctor, monitor, report, watch, shards, merge, alerts, explain, export, verify, config, readers)

DESCRIPTION = """\
Prove that no strand passed through another between two frames of a molecular
trajectory, or say where that is not proved.
"""

START = """\
to begin:
  mdtopo demo                         run the job on a small example
  mdtopo doctor TOPOLOGY TRAJECTORY   see how your own files are understood
  mdtopo monitor --help               all options of the job

"""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="mdtopo",
        description=DESCRIPTION,
        epilog=START + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"mdtopo {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(commands)
    return parser


def _parsed(words: list[str]) -> argparse.Namespace:
    """Return the parsed words; a word that is left over is refused with the usage of its own command."""
    parser = build_parser()
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        getattr(arguments, "parser", parser).error(f"unrecognized arguments: {' '.join(unknown)}")
    return arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; no error leaves as a traceback unless one is asked for."""
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        arguments = _parsed(words)
    except SystemExit as end:  # argparse has said what is wrong, or printed the help
        return int(end.code or 0)
    arguments.argv = ["mdtopo", *words]
    try:
        code: Exit = arguments.run(arguments)
        if argv is None:
            ignore_late_signals()
        sys.stdout.flush()
    except SystemExit as end:
        return int(end.code or 0)
    except (Exception, KeyboardInterrupt) as error:
        return exit_code(error, show_traceback=getattr(arguments, "verbose", False))
    finally:
        close_log()
    return int(code)
