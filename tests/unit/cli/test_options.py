import argparse
import tomllib
from collections.abc import Iterator
from dataclasses import fields

import pytest

from mdtopo.cli import build_parser
from mdtopo.cli.configfile import config_text
from mdtopo.cli.options import MONITOR_OPTIONS, Kind, frame_slice, settled
from mdtopo.records import MonitorConfig

NOT_IN_FILE = {"help", "config"}  # these two are for the command line alone


def commands() -> dict[str, argparse.ArgumentParser]:
    (choices,) = (a.choices for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    return dict(choices)


def actions() -> Iterator[tuple[str, argparse.Action]]:
    for name, parser in commands().items():
        yield from ((name, action) for action in parser._actions)


@pytest.mark.parametrize(("command", "action"), list(actions()), ids=lambda x: getattr(x, "dest", x))
def test_every_argument_of_every_command_is_documented(command: str, action: argparse.Action) -> None:
    assert action.help
    assert len(action.help) > 10


def test_every_option_of_monitor_is_in_the_configuration_file() -> None:
    text = config_text()
    for action in commands()["monitor"]._actions:
        name = next((word[2:] for word in action.option_strings if word.startswith("--")), None)
        if name is not None and name not in NOT_IN_FILE:
            assert f"\n{name} = " in text or f"\n# {name} = " in text, name


def test_every_option_stands_in_the_configuration_file_behind_its_help() -> None:
    text = " ".join(config_text().replace("\n# ", " ").split())
    for option in MONITOR_OPTIONS:
        assert option.help in text


def test_every_knob_is_an_option_of_monitor() -> None:
    names = {option.key for option in MONITOR_OPTIONS}
    assert {knob.name for knob in fields(MonitorConfig)} <= names


def test_defaults_of_the_options_are_those_of_the_job() -> None:
    values = settled(MONITOR_OPTIONS)
    assert MonitorConfig(**{knob.name: values[knob.name] for knob in fields(MonitorConfig)}) == MonitorConfig()
    assert frame_slice(values["frames"]) == slice(None)


def test_examples_of_options_without_a_default_can_be_uncommented() -> None:
    uncommented = "\n".join(line.removeprefix("# ") for line in config_text().splitlines() if " = " in line)
    values = tomllib.loads(uncommented)
    for option in MONITOR_OPTIONS:
        assert option.accepts(values[option.name]), option.name


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("::", slice(None)),
        (":", slice(None)),
        ("5:", slice(5, None)),
        (":-1", slice(None, -1)),
        ("1:20:3", slice(1, 20, 3)),
        ("::10", slice(None, None, 10)),
    ],
)
def test_frames_are_python_slices(text: str, expected: slice) -> None:
    assert frame_slice(text) == expected


@pytest.mark.parametrize("text", ["", "7", "1:2:3:4", "a:", "1.5:", "::0", "::-2"])
def test_other_texts_are_no_frames(text: str) -> None:
    with pytest.raises(ValueError, match=r"slice|step"):
        frame_slice(text)


def test_the_last_layer_wins_and_tables_are_joined() -> None:
    stored = {"motion": "lab", "near-limit": 0.5, "reader-option": {"dt": 1.0, "cut": 5}}
    given = {"near-limit": 0.7, "reader-option": {"dt": "2"}}
    values = settled(MONITOR_OPTIONS, stored, given)
    assert (values["motion"], values["near_limit"]) == ("lab", 0.7)
    assert values["reader_option"] == {"dt": "2", "cut": 5}


def test_a_truth_value_is_no_number() -> None:
    for option in MONITOR_OPTIONS:
        assert option.accepts(True) == (option.kind is Kind.FLAG)
