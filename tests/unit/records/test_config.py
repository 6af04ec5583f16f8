"""The knobs of a run: what they must not be, alone and together."""

import pytest

from mdtopo.errors import OptionError
from mdtopo.records import MonitorConfig


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        ({"near_limit": 1.001}, "near_limit is 1.001: a pair ratio of 1 is the limit itself"),
        ({"near_limit": 0.0}, "near_limit is 0: every ratio"),
        ({"criterion": "nu", "near_limit": 0.0}, "near_limit is 0: every ratio"),
        ({"stretch_limit": 1.5001}, "fracture_limit is 1.5 and stretch_limit 1.5001"),
        ({"stretch_limit": 3.0, "fracture_limit": 1.1}, "fracture_limit is 1.1 and stretch_limit 3"),
    ],
)
def test_knobs_that_contradict_each_other_are_refused(knobs: dict, words: str) -> None:
    MonitorConfig.check_each(knobs)  # each by itself may be
    with pytest.raises(OptionError, match=words):
        MonitorConfig(**knobs)


@pytest.mark.parametrize("value", ["0.8", [0.8], 1j])
def test_a_knob_that_is_no_number_is_refused(value: object) -> None:
    with pytest.raises(OptionError, match=r"near_limit is .*; it must be a number"):
        MonitorConfig(near_limit=value)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "knobs",
    [
        {"near_limit": 1.0},
        {"near_limit": 1e-9},
        {"criterion": "nu", "near_limit": 3.0},
        {"criterion": "clearance", "near_limit": 3.0},
        {"criterion": "clearance", "near_limit": 0.0},
        {"stretch_limit": 1.5},
    ],
)
def test_what_lies_at_or_within_the_limits_is_taken(knobs: dict) -> None:
    assert MonitorConfig(**knobs).to_mapping().items() >= knobs.items()
