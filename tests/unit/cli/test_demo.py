import shlex
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import pytest

import mdtopo
from mdtopo.cli.exits import Exit


def test_the_demo_runs_twice_and_leaves_results_and_alerts(cli: Callable, tmp_path: Path) -> None:
    folder = tmp_path / "a folder"
    for _ in range(2):
        outcome = cli("demo", "-d", folder)
        assert outcome.code == Exit.DONE
    assert sorted(path.name for path in folder.iterdir() if not path.name.startswith(".")) == [
        "alerts.jsonl", "duplex.data", "pull.dcd", "run.h5", "run.html",
    ]  # fmt: skip
    results = mdtopo.read_results(folder / "run.h5")
    assert results.complete
    assert results.summary["verdict"] == "FAIL"
    (fracture,) = results.broken
    assert fracture.edge == (57, 58)  # by the log of the engine, between frames 38 and 39
    kinds = {alert.kind.value: alert for alert in results.alerts}
    assert kinds.keys() == {"stretch", "fracture"}
    assert 34 <= kinds["stretch"].frame_start <= 39
    assert 39 <= fracture.frame <= 45
    assert all(alert.message in " ".join(outcome.out.split()) for alert in results.alerts)


def test_the_command_that_is_printed_does_the_same(cli: Callable, tmp_path: Path) -> None:
    lines = cli("demo", "-d", tmp_path).out.splitlines()
    (command,) = [line for line in lines if line.startswith("  mdtopo monitor")]
    verdict = lines.index(next(line for line in lines if line.startswith("FAIL: ")))
    outcome = cli(*shlex.split(command)[1:])
    assert outcome.code == Exit.DONE
    assert outcome.out.splitlines() == lines[verdict : verdict + len(outcome.out.splitlines())]


@pytest.mark.parametrize("name", ["README.md", "duplex.data", "pull.dcd"])
def test_the_example_is_small_and_comes_with_its_origin(name: str) -> None:
    assert len((files("mdtopo") / "demo" / name).read_bytes()) < 100_000


def test_a_place_that_cannot_be_written_is_named(cli: Callable, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a directory")
    outcome = cli("demo", "-d", blocked)
    assert outcome.code == Exit.BAD_INPUT
    assert str(blocked) in outcome.err
    assert "--directory" in outcome.err
