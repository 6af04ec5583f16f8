"""The configuration file: TOML, with the options of ``mdtopo monitor`` as its keys."""

import difflib
import json
import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mdtopo.cli.options import MONITOR_OPTIONS, Kind, Option, frame_slice
from mdtopo.errors import InputError, MissingFileError, OptionError
from mdtopo.records.config import MonitorConfig

HEADING = """\
# Options of 'mdtopo monitor', with their defaults. Use: mdtopo monitor ... --config FILE
# What stands on the command line wins over this file. A line that begins with # has no effect.
"""


def config_text() -> str:
    """Return a configuration file with every option of ``mdtopo monitor``, its help and its default."""
    return HEADING + "".join(_lines())


def _lines() -> Iterator[str]:
    group = ""
    for option in MONITOR_OPTIONS:
        if option.group != group:
            group = option.group
            yield f"\n# ---- {group} ----\n"
        values = f" (one of: {', '.join(option.choices)})" if option.choices else ""
        yield "\n" + textwrap.fill(option.help + values, 110, initial_indent="# ", subsequent_indent="# ") + "\n"
        yield f"# {option.name} = {option.example}\n" if option.default is None else _assignment(option)


def _assignment(option: Option) -> str:
    # JSON and TOML write text, numbers, true and false alike; the one table is empty by default
    return f"{option.name} = {json.dumps(option.default, ensure_ascii=False)}\n"


def read_config(path: Path) -> dict[str, Any]:
    """Return the options that a configuration file sets, by name.

    Raises
    ------
    MissingFileError
        If there is no such file.
    InputError
        If it cannot be read, or is not TOML.
    OptionError
        If a key is unknown, or a value is of the wrong kind or out of range.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise MissingFileError(f"The configuration file {path} does not exist.") from error
    except OSError as error:
        raise InputError(f"The configuration file {path} cannot be read ({error.strerror}).") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"The configuration file {path} is not valid TOML: {error}.") from error
    options = {option.name: option for option in MONITOR_OPTIONS}
    named: dict[str, Any] = {}
    for key, value in values.items():
        name = key.replace("_", "-")
        if name in named:
            raise OptionError(f"The configuration file {path} sets {name!r} twice.")
        if name not in options:
            raise OptionError(_unknown_key(path, key))
        named[name] = value
        _check(path, options[name], value)
    _check_ranges(path, named)
    return named


def _unknown_key(path: Path, key: str) -> str:
    known = [option.name for option in MONITOR_OPTIONS]
    close = difflib.get_close_matches(key, known, 1)
    meant = f" Did you mean {close[0]!r}?" if close else ""
    return f"The configuration file {path} has the unknown key {key!r}.{meant} The keys are: {', '.join(known)}."


def _check(path: Path, option: Option, value: object) -> None:
    if not option.accepts(value):
        raise OptionError(
            f"In the configuration file {path}, {option.name!r} is {json.dumps(value, default=str)}; expected is "
            f"{option.expected}."
        )
    if option.kind is Kind.FRAMES:
        try:
            frame_slice(str(value))
        except ValueError as error:
            raise OptionError(f"In the configuration file {path}, {option.name!r} is wrong: {error}.") from error


def _check_ranges(path: Path, named: dict[str, Any]) -> None:
    try:
        MonitorConfig.check_each(knobs_of(named))  # the command line may still change what they come to together
    except OptionError as error:
        raise OptionError(f"In the configuration file {path}, {error}") from error


def knobs_of(values: dict[str, Any]) -> dict[str, Any]:
    """Return those values that are knobs of `MonitorConfig`, by field name."""
    renamed = {name.replace("-", "_"): value for name, value in values.items()}
    return {name: value for name, value in renamed.items() if name in MonitorConfig.__dataclass_fields__}
