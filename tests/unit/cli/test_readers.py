from collections.abc import Callable
from importlib.metadata import EntryPoint

import pytest

from mdtopo.cli.exits import Exit
from mdtopo.readers import installed_readers


def test_every_reader_is_listed_with_its_options(cli: Callable) -> None:
    outcome = cli("readers")
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    for name, reader in installed_readers().readers.items():
        assert f"{name}: {reader.summary}\n" in outcome.out
        for option, text in reader.option_help.items():
            assert option in outcome.out
            assert text in outcome.out


def test_a_broken_plugin_is_listed_with_the_reason(cli: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = EntryPoint("floppy", "no_such_module:Reader", "mdtopo.readers.v1")
    monkeypatch.setattr("mdtopo.readers.registry.entry_points", lambda group: [broken])
    outcome = cli("readers")
    assert outcome.code == Exit.DONE
    assert "not usable: floppy" in outcome.out
    assert "no_such_module" in outcome.out
