"""What README.md shows of a real run is what a run prints."""

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


def blocks(opening: str) -> list[str]:
    """Return the contents of README's fenced blocks that open like this."""
    return re.findall(rf"^```{opening}\n(.*?)^```$", README.read_text(), flags=re.MULTILINE | re.DOTALL)


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
