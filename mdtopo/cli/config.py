"""``mdtopo config``: every option of the job, as a configuration file."""

import argparse
import sys

from mdtopo.cli.configfile import config_text
from mdtopo.cli.exits import Exit


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "config",
        help="print a configuration file with every option and its default",
        description="Print a configuration file (TOML) with every option of 'mdtopo monitor', what it does and its "
        "default: mdtopo config > mdtopo.toml; mdtopo monitor ... --config mdtopo.toml",
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Print the file."""
    sys.stdout.write(config_text())
    return Exit.DONE
