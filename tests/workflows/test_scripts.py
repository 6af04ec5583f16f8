"""The shell scripts of the recipes: their syntax, and what the array template asks SLURM for."""

import os
import signal
import subprocess
import time
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


@pytest.mark.parametrize(
    ("told", "goes_back"), [(signal.SIGUSR1, True), (signal.SIGTERM, False)], ids=["time is up", "cancelled"]
)
def test_a_task_that_is_told_to_checkpoint_goes_back_into_the_queue_unless_it_is_cancelled(
    tmp_path: Path, told: signal.Signals, goes_back: bool
) -> None:
    """Both commands are stand-ins: the one checkpoints on signals as `mdtopo monitor` does, the other says its call."""
    stand_ins = {
        "mdtopo": "trap 'exit 75' USR1 TERM; touch started; while :; do sleep 0.05; done",
        "scontrol": 'echo "scontrol $*"',
    }
    for name, text in stand_ins.items():
        (tmp_path / name).write_text(f"#!/usr/bin/env bash\n{text}\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "shards.txt").write_text("0:5\n4:9\n")
    task = {
        "SLURM_ARRAY_TASK_ID": "2",
        "SLURM_ARRAY_JOB_ID": "7",
        "SHARDS": "shards.txt",
        "TOPOLOGY": "a",
        "TRAJECTORY": "b",
    }
    environment = {**os.environ, **task, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    with subprocess.Popen(
        ["bash", str(TEMPLATE)],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as running:
        try:
            end = time.monotonic() + 30
            while not (tmp_path / "started").exists():
                assert time.monotonic() < end
                time.sleep(0.02)
            running.send_signal(told)
            said, _ = running.communicate(timeout=30)
        except BaseException:
            os.killpg(running.pid, signal.SIGKILL)
            raise
    assert running.returncode == 75
    assert ("scontrol requeue 7_2\n" in said) is goes_back
