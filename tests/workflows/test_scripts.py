"""The shell scripts of the recipes: their syntax, and what the array template asks SLURM for."""

import subprocess
from pathlib import Path

import pytest
from workflow_tree import WORKFLOWS

TEMPLATE = WORKFLOWS / "slurm" / "array.sbatch"
SCRIPTS = [TEMPLATE, *sorted(WORKFLOWS.rglob("*.sh"))]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_script_is_bash(script: Path) -> None:
    subprocess.run(["bash", "-n", str(script)], check=True)


def test_the_template_asks_for_what_resuming_needs() -> None:
    lines = TEMPLATE.read_text().splitlines()
    for wanted in ("--signal=B:USR1@300", "--requeue", "--open-mode=append"):
        assert f"#SBATCH {wanted}" in lines
