"""Every option of the job, once: the command line, the configuration file and the help all come from this table."""

import argparse
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from types import UnionType
from typing import Any

from mdtopo.records.config import MonitorConfig
from mdtopo.records.shards import SHARD_STEPS

NEVER = "never"
"""Value of --fail-on with which no alert changes the exit code."""


class Kind(Enum):
    """What values an option takes, in words for messages."""

    TEXT = "text in quotes"
    FLAG = "true or false"
    NUMBER = "a number"
    INTEGER = "a whole number"
    COUNT = "a whole number above 0"
    CHOICE = "one of the words"
    FRAMES = "a slice start:stop:step in quotes, such as '100:200' or '::10'"
    PAIRS = "a table of names and values"


@dataclass(frozen=True, slots=True)
class Option:
    """One option.

    Attributes
    ----------
    name : str
        As on the command line without its dashes, and as in the configuration file.
    kind : Kind
        What values it takes.
    default : object
        None where leaving it out is a value of its own.
    help : str
        One line.
    group : str
        Heading in the help.
    short : str
        One-letter form, or none.
    metavar : str
        What its value is called in the help.
    choices : tuple of str
        The words of a CHOICE.
    example : str
        A value in TOML to show where there is no default.
    """

    name: str
    kind: Kind
    default: Any
    help: str
    group: str
    short: str = ""
    metavar: str = "VALUE"
    choices: tuple[str, ...] = ()
    example: str = '""'

    @property
    def key(self) -> str:
        """The option as a Python name."""
        return self.name.replace("-", "_")

    def accepts(self, value: object) -> bool:
        """Return whether a value of a configuration file is of the right kind."""
        if isinstance(value, bool):
            return self.kind is Kind.FLAG
        match self.kind:
            case Kind.NUMBER:
                return isinstance(value, int | float)
            case Kind.INTEGER:
                return isinstance(value, int)
            case Kind.COUNT:
                return isinstance(value, int) and value > 0
            case Kind.CHOICE:
                return value in self.choices
            case Kind.PAIRS:
                return isinstance(value, dict) and all(isinstance(v, str | int | float) for v in value.values())
            case Kind.TEXT | Kind.FRAMES:
                return isinstance(value, str)
        return False

    @property
    def expected(self) -> str:
        """What values the option takes, in words."""
        return f"{self.kind.value} {', '.join(self.choices)}" if self.choices else self.kind.value


INPUT_OPTIONS = (
    Option(
        "select",
        Kind.TEXT,
        None,
        "which atoms are the backbone, in the reader's selection language (default: CA of proteins, C4' of nucleic "
        "acids, else every atom)",
        "input",
        short="s",
        metavar="SELECTION",
        example='"protein and name CA"',
    ),
    Option(
        "frames",
        Kind.FRAMES,
        "::",
        "which frames are analysed, counted from 0, as start:stop:step; a step joins consecutive analysed frames",
        "input",
        metavar="START:STOP:STEP",
    ),
    Option(
        "reader",
        Kind.TEXT,
        None,
        "which reader opens the input ('mdtopo readers' lists them; default: the first one that takes the file)",
        "input",
        metavar="NAME",
        example='"mdanalysis"',
    ),
    Option(
        "reader-option",
        Kind.PAIRS,
        {},
        "an option of the reader; can be repeated ('mdtopo readers' lists them)",
        "input",
        metavar="NAME=VALUE",
    ),
)

BROKEN_FROM = Option(
    "broken-from",
    Kind.TEXT,
    None,
    "results file of the shard before, which ends with the first frame of --frames: bonds that were broken there, or "
    "too long, are so from the start",
    "input",
    metavar="SHARD",
    example='"shard-1.h5"',
)

VERBOSE = Option("verbose", Kind.FLAG, False, "print more notes, and a traceback with every error", "output", short="v")

THREADS = Option(
    "threads",
    Kind.COUNT,
    None,
    "threads that measure steps; results do not depend on it (default: SLURM_CPUS_PER_TASK where that is set, else "
    "the cores that this process may use)",
    "output",
    metavar="N",
    example="4",
)

OUTPUT_OPTIONS = (
    Option(
        "out",
        Kind.TEXT,
        None,
        "results file (HDF5); without it nothing is stored",
        "output",
        short="o",
        metavar="FILE",
        example='"run.h5"',
    ),
    Option(
        "alerts",
        Kind.TEXT,
        None,
        "alert stream (JSON Lines): a file, a pipe, or - for standard output (the summary then goes to standard error)",
        "output",
        metavar="FILE",
        example='"alerts.jsonl"',
    ),
    Option(
        "report",
        Kind.TEXT,
        None,
        "report of the run: one page (HTML) that opens in any browser and works offline; needs --out",
        "output",
        metavar="FILE",
        example='"run.html"',
    ),
    Option("overwrite", Kind.FLAG, False, "replace output files that exist", "output"),
    Option(
        "fail-on",
        Kind.CHOICE,
        NEVER,
        "exit with code 3 when there are alerts of this severity or a higher one",
        "output",
        choices=(NEVER, "info", "warning", "critical"),
    ),
    THREADS,
    Option(
        "max-hours",
        Kind.NUMBER,
        None,
        "put the run down after so many hours, with exit code 75; the same command goes on with it",
        "output",
        metavar="X",
        example="23.5",
    ),
    Option(
        "part-minutes",
        Kind.NUMBER,
        10.0,
        "make safe what was measured at least this often; results do not depend on it",
        "output",
        metavar="X",
    ),
    Option(
        "part-steps",
        Kind.COUNT,
        100_000,
        "and after so many steps; results do not depend on it",
        "output",
        metavar="N",
    ),
    Option("quiet", Kind.FLAG, False, "print no progress, no notes and no summary", "output", short="q"),
    VERBOSE,
)

CLUSTER_OPTIONS = (
    Option(
        "dask",
        Kind.TEXT,
        None,
        "measure shards as tasks of the Dask cluster whose scheduler has this address; needs --out, and files that all "
        "workers find under the same names; --threads is then that of a task, by default 1",
        "cluster",
        metavar="ADDRESS",
        example='"tcp://host:8786"',
    ),
    Option(
        "shard-steps",
        Kind.COUNT,
        SHARD_STEPS,
        "greatest number of steps in such a shard; results do not depend on it",
        "cluster",
        metavar="N",
    ),
)


def _knob_option(name: str, hint: Any, default: Any, help_text: str) -> Option:
    if typing.get_origin(hint) is typing.Literal:
        return Option(name, Kind.CHOICE, default, help_text, "measurement", choices=typing.get_args(hint))
    if hint is bool:
        return Option(name, Kind.FLAG, default, help_text, "measurement")
    types = typing.get_args(hint) if isinstance(hint, UnionType) else (hint,)
    kind, metavar = (Kind.INTEGER, "N") if int in types else (Kind.NUMBER, "X")
    return Option(name, kind, default, help_text, "measurement", metavar=metavar, example="0.0")


def knob_options() -> tuple[Option, ...]:
    """Return one option for each knob of `MonitorConfig`."""
    hints = typing.get_type_hints(MonitorConfig)
    return tuple(
        _knob_option(knob.name.replace("_", "-"), hints[knob.name], knob.default, knob.metadata["help"])
        for knob in fields(MonitorConfig)
    )


MONITOR_OPTIONS = (*INPUT_OPTIONS, BROKEN_FROM, *OUTPUT_OPTIONS, *CLUSTER_OPTIONS, *knob_options())


def whole_number(text: str) -> int:
    """Return the number, 0 or more, that an option holds.

    Raises
    ------
    ArgumentTypeError
        If it is none; argparse says so and ends with the exit code for wrong usage.
    """
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 0 or more")
    return int(text)


def add_options(parser: argparse.ArgumentParser, options: Iterable[Option]) -> None:
    """Add options to a parser; one that is not given leaves no trace, so that the configuration file can be asked."""
    groups: dict[str, argparse._ArgumentGroup] = {}
    for option in options:
        group = groups.get(option.group)
        if group is None:
            group = groups[option.group] = parser.add_argument_group(option.group)
        flags = [f"-{option.short}"] if option.short else []
        group.add_argument(*flags, f"--{option.name}", **_argument(option))


def _argument(option: Option) -> dict[str, Any]:
    shown = {"help": _help(option), "default": argparse.SUPPRESS, "dest": option.key}
    match option.kind:
        case Kind.FLAG:
            return {**shown, "action": argparse.BooleanOptionalAction}
        case Kind.CHOICE:
            return {**shown, "choices": option.choices}
        case Kind.PAIRS:
            return {**shown, "metavar": option.metavar, "action": "append", "type": name_and_value}
    types: dict[Kind, Any] = {Kind.NUMBER: float, Kind.INTEGER: int, Kind.COUNT: count, Kind.FRAMES: _frames_text}
    return {**shown, "metavar": option.metavar, "type": types.get(option.kind, str)}


def _help(option: Option) -> str:
    has_default = option.default is not None and option.kind not in (Kind.FLAG, Kind.PAIRS)
    default = f" (default: {option.default:})" if has_default else ""
    return f"{option.help}{default}".replace("%", "%%")


def name_and_value(text: str) -> tuple[str, str]:
    """Return the two sides of NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE")
    return name, value


def frame_slice(text: str) -> slice:
    """Return the slice that ``start:stop:step`` names.

    Raises
    ------
    ValueError
        If the text is no slice, or its step is not above 0.
    """
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise ValueError(f"{text!r} is not a slice start:stop:step, such as 100:200 or ::10")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
    except ValueError:
        raise ValueError(f"{text!r} is not a slice start:stop:step, such as 100:200 or ::10") from None
    wanted = slice(*numbers)
    if wanted.step is not None and wanted.step < 1:
        raise ValueError(f"the step of {text!r} must be 1 or more: time runs forward")
    return wanted


def count(text: str) -> int:
    """Return the whole number above 0 that a word of the command line is."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def _frames_text(text: str) -> str:
    try:
        frame_slice(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def given_options(arguments: argparse.Namespace, options: Iterable[Option]) -> dict[str, Any]:
    """Return those options that stand on the command line, by name."""
    given = {o.name: getattr(arguments, o.key) for o in options if hasattr(arguments, o.key)}
    return {name: dict(value) if name == "reader-option" else value for name, value in given.items()}


def settled(options: Iterable[Option], *layers: Mapping[str, Any]) -> dict[str, Any]:
    """Return a value for every option, by Python name: the last layer that has it wins; tables are joined."""
    values: dict[str, Any] = {option.name: option.default for option in options}
    for layer in layers:
        for name, value in layer.items():
            values[name] = {**values[name], **value} if isinstance(value, dict) else value
    return {name.replace("-", "_"): value for name, value in values.items()}
