from collections.abc import Callable
from pathlib import Path

import pytest

from mdtopo.cli.configfile import config_text, read_config
from mdtopo.cli.exits import Exit
from mdtopo.cli.options import MONITOR_OPTIONS, settled
from mdtopo.errors import MdtopoError, MissingFileError, OptionError


@pytest.fixture
def toml(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "mdtopo.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_the_printed_file_changes_nothing(cli: Callable, toml: Callable, npz: Callable) -> None:
    printed = cli("config")
    assert (printed.code, printed.err) == (Exit.DONE, "")
    assert printed.out == config_text()
    path = toml(printed.out)
    assert settled(MONITOR_OPTIONS, read_config(path)) == settled(MONITOR_OPTIONS)
    tiny = npz()
    assert cli("monitor", tiny, "--config", path).out == cli("monitor", tiny).out


def test_an_empty_file_changes_nothing(toml: Callable) -> None:
    assert read_config(toml("")) == {}


def test_the_command_line_wins_over_the_file(cli: Callable, toml: Callable, npz: Callable, tmp_path: Path) -> None:
    path = toml(f"out = '{tmp_path / 'file.h5'}'\nquiet = true\nfail-on = 'info'\nnear_limit = 1e-9\n")
    outcome = cli("monitor", npz(), "--config", path)
    assert (outcome.code, outcome.out) == (Exit.ALERTS, "")
    outcome = cli("monitor", npz(), "--config", path, "--out", tmp_path / "line.h5", "--no-quiet", "--fail-on", "never")
    assert outcome.code == Exit.DONE
    assert outcome.out.startswith("WARN")
    assert (tmp_path / "line.h5").is_file()


def test_reader_options_are_a_table(toml: Callable) -> None:
    assert read_config(toml("[reader-option]\ndt = 2.0\nformat = 'XTC'"))["reader-option"] == {
        "dt": 2.0,
        "format": "XTC",
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("near-limitt = 1", ["'near-limitt'", "Did you mean 'near-limit'?", "block-steps"]),
        ("colour = 'red'", ["'colour'", "The keys are: select, frames"]),
        ("near-limit = '0.8'", ["'near-limit'", '"0.8"', "a number"]),
        ("block-steps = 6.5", ["'block-steps'", "6.5", "a whole number"]),
        ("threads = 0", ["'threads'", "a whole number above 0"]),
        ("overwrite = 1", ["'overwrite'", "true or false"]),
        ("quiet = 'yes'", ["'quiet'", "true or false"]),
        ("motion = 'sideways'", ["'motion'", "rigid, lab"]),
        ("select = ['a']", ["'select'", "text in quotes"]),
        ("reader-option = 'dt=1'", ["'reader-option'", "a table"]),
        ("frames = '7'", ["'frames'", "start:stop:step"]),
        ("near-limit = -1", ["near_limit is -1", "at least 0"]),
        ("near-limit = 1\nnear_limit = 1", ["'near-limit' twice"]),
        ("near-limit = ", ["not valid TOML"]),
    ],
)
def test_what_a_file_may_not_hold(cli: Callable, toml: Callable, npz: Callable, text: str, words: list[str]) -> None:
    path = toml(text)
    with pytest.raises(MdtopoError):
        read_config(path)
    outcome = cli("monitor", npz(), "--config", path)
    assert outcome.code == Exit.BAD_INPUT
    assert len(outcome.err.splitlines()) == 1
    for word in ["configuration file", str(path), *words]:
        assert word in outcome.err


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"none\.toml does not exist"):
        read_config(tmp_path / "none.toml")


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "raw.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MdtopoError, match="not valid TOML"):
        read_config(path)


def test_unknown_keys_are_option_errors(toml: Callable) -> None:
    with pytest.raises(OptionError):
        read_config(toml("colour = 'red'"))
