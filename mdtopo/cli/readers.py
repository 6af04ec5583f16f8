"""``mdtopo readers``: what can be read, and with which options."""

import argparse
import sys
import textwrap
from collections.abc import Iterator

from mdtopo.cli.exits import Exit
from mdtopo.cli.summary import aligned


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "readers",
        help="list the readers that are installed, and their options",
        description="List the readers that are installed, in the order in which they are asked, with the options that "
        "--reader-option NAME=VALUE takes; and plugins that cannot be used, with the reason.",
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> Exit:
    """Print the list."""
    sys.stdout.write("\n".join(_lines()) + "\n")
    return Exit.DONE


def _lines() -> Iterator[str]:
    from mdtopo.readers import installed_readers

    listing = installed_readers()
    for name, reader in listing.readers.items():
        yield f"{name}: {reader.summary}"
        yield from aligned(list(reader.option_help.items()), indent="    ")
        yield ""
    for broken in listing.broken:
        yield from textwrap.wrap(f"not usable: {broken}", 100, subsequent_indent="    ")
