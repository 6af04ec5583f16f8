"""What README.md and commands.md show of real runs is what these print."""

import contextlib
import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import mdtopo

README = Path(__file__).parents[3] / "README.md"
COMMANDS = Path(mdtopo.__file__).parent / "docs" / "commands.md"


def blocks(opening: str, page: Path = README) -> list[str]:
    """Return the contents of a page's fenced blocks that open like this."""
    return re.findall(rf"^```{opening}\n(.*?)^```$", page.read_text(), flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def beside_the_input(shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ca.gro", "ca_wrapped.xtc"):
        shutil.copy(shared_data / "gmx" / name, tmp_path)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("beside_the_input")
def test_the_real_run_prints_what_the_readme_shows(cli: Callable) -> None:
    (shown,) = (block for block in blocks("") if block.startswith("$ mdtopo monitor"))
    command, printed = shown.split("\n", 1)
    assert cli(*command.split()[2:]).out == printed
    messages = [json.loads(line)["message"] for line in Path("alerts.jsonl").read_text().splitlines()]
    quoted = " ".join(re.sub(r"^> ?", "", README.read_text(), flags=re.MULTILINE).split())
    assert [message for message in messages[:2] if message not in quoted] == []


@pytest.mark.usefixtures("beside_the_input")
def test_the_example_with_a_configuration_runs() -> None:
    (example,) = (block for block in blocks("python") if "config=config" in block)
    printed, names = io.StringIO(), {"mdtopo": mdtopo}
    with contextlib.redirect_stdout(printed):
        exec(example, names)
    run = names["run"]
    assert isinstance(run, mdtopo.RunSummary)
    assert run.n_steps == 50
    assert run.counts.near_limit > 0
    assert run.closest in printed.getvalue()


def test_the_commands_after_a_run_print_what_their_page_shows(
    cli: Callable, shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first 500 steps are enough: what is shown is about the step where the rings come apart."""
    monkeypatch.chdir(tmp_path)
    inputs = shared_data / "rings" / "hopf.data", shared_data / "rings" / "pair_hopf_fine.dcd"
    cli("monitor", *inputs, "--frames", ":501", "-o", "pair_hopf.h5", "-q")
    shown = [block for block in blocks("", COMMANDS) if block.startswith("$ mdtopo")]
    assert [block.split()[2] for block in shown] == ["alerts", "explain"]
    for block in shown:
        command, *lines = block.splitlines()
        outcome = cli(*command.split("|")[0].split()[2:])
        printed = [line.split() for line in outcome.out.splitlines()]  # columns are as wide as the whole run's rows
        assert [line for line in lines if line and line.split() not in printed] == []
