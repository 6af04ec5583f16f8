import gc
import logging
import sys
import warnings

import pytest

from mdtopo.readers.mdanalysis.calls import mdanalysis_call, one_line


def test_a_warning_becomes_a_log_line_and_is_said_once(caplog):
    with caplog.at_level(logging.DEBUG, "mdtopo"), mdanalysis_call("run.dcd"):
        warnings.warn("Something is odd", UserWarning, stacklevel=1)
        warnings.warn("Something is odd", UserWarning, stacklevel=1)
    assert [(r.levelname, r.message) for r in caplog.records] == [
        ("WARNING", "MDAnalysis says of run.dcd: Something is odd")
    ]


def test_a_harmless_warning_is_logged_for_debugging_only(caplog):
    with caplog.at_level(logging.DEBUG, "mdtopo"), mdanalysis_call("run.dcd"):
        warnings.warn("DCDReader currently makes independent timesteps by copying", stacklevel=1)
    assert [record.levelname for record in caplog.records] == ["DEBUG"]


def test_the_filters_are_as_before():
    before = list(warnings.filters)
    with mdanalysis_call("run.dcd"):
        pass
    assert warnings.filters == before
    with pytest.raises(UserWarning, match="outside"):
        warnings.warn("outside", stacklevel=1)


class HalfMade:
    def __init__(self):
        self.itself = self  # a cycle, as MDAnalysis has them
        raise ValueError("no frames")

    def __del__(self):
        raise AttributeError("no attribute _file")


def test_a_reader_that_fails_twice_leaves_no_traceback(monkeypatch):
    announced = []
    monkeypatch.setattr(sys, "unraisablehook", announced.append)
    with pytest.raises(ValueError, match="no frames"), mdanalysis_call("run.dcd"):
        HalfMade()
    gc.collect()
    assert announced == []
    assert sys.unraisablehook == announced.append


def test_without_the_guard_it_would(monkeypatch):
    announced = []
    monkeypatch.setattr(sys, "unraisablehook", announced.append)
    with pytest.raises(ValueError, match="no frames"):
        HalfMade()
    gc.collect()
    assert len(announced) == 1


def test_a_message_is_one_line_and_never_empty():
    assert one_line(ValueError("two\n  lines")) == "two lines"
    assert one_line(OSError()) == "OSError"
    assert len(one_line("x" * 1000)) == 300
