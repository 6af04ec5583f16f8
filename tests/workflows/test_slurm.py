"""The workflow on a real SLURM of one node: pytest -m slow -s tests/workflows/test_slurm.py."""

import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from one_node_slurm import OneNodeSlurm, one_node_slurm
from workflow_tree import Tree, copied_tree

from mdtopo import read_results
from mdtopo.records import StepTable

pytestmark = pytest.mark.slow


@pytest.fixture
def slurm(tmp_path: Path) -> Iterator[OneNodeSlurm]:
    folder = tmp_path / "slurm"
    folder.mkdir()
    with one_node_slurm(folder) as running:
        yield running


@pytest.fixture
def tree(tmp_path: Path, slurm: OneNodeSlurm) -> Tree:
    tree = copied_tree(tmp_path)
    wrappers = slurm.path.partition(os.pathsep)[0]
    return Tree(tree.folder, {**tree.environment, "PATH": f"{wrappers}{os.pathsep}{tree.environment['PATH']}"})


def test_the_workflow_runs_under_the_slurm_profile(tree: Tree) -> None:
    pytest.importorskip("snakemake_executor_plugin_slurm")
    done = tree.run(
        "snakemake", "--profile", "profiles/slurm", "--directory", ".test", "--slurm-init-seconds-before-status-checks",
        "2", "--latency-wait", "5"
    )  # fmt: skip
    sys.stdout.write(done.stdout + done.stderr)
    assert done.returncode == 0
    page = (tree.results / "report" / "overview.html").read_text()
    assert all(sample in page for sample in ("bpti", "duplex", "pulled"))


def ended(slurm: OneNodeSlurm, seconds: float) -> list[str]:
    """Wait until no job is queued or runs, and return the ids of those that SLURM put back into the queue.

    SLURM lets a job that was put back wait for two minutes; here it need not.
    """
    requeued, end = [], time.monotonic() + seconds
    while queued := slurm.ask("squeue", "--noheader", "--array", "--format=%F_%K %r"):
        assert time.monotonic() < end, queued
        for job in re.findall(r"^(\d+_\d+) BeginTime$", queued, re.MULTILINE):
            slurm.ask("scontrol", "update", f"JobId={job}", "StartTime=now")
            requeued.append(job)
        time.sleep(0.5)
    return requeued


def test_the_array_measures_all_shards_and_each_task_goes_on_after_a_checkpoint(
    tree: Tree, slurm: OneNodeSlurm
) -> None:
    """Every task puts itself down after each block (`--max-hours 0`), and comes back through the queue."""
    inputs = [str(tree.folder / ".test" / "data" / "bpti" / name) for name in ("ca.gro", "ca.xtc")]
    shards = tree.run("mdtopo", "shards", *inputs, "--steps", "30")
    (tree.folder / "shards.txt").write_text(shards.stdout)
    n_shards = len(shards.stdout.split())
    assert n_shards > 1
    task = {"TOPOLOGY": inputs[0], "TRAJECTORY": inputs[1], "SHARDS": "shards.txt"}
    options = "--max-hours 0 --block-steps 20 --threads 1"
    sent = tree.run("sbatch", f"--array=1-{n_shards}", "slurm/array.sbatch", OPTIONS=options, **task)
    assert sent.returncode == 0, sent.stdout + sent.stderr
    requeued = ended(slurm, 300)
    logs = {path.name: path.read_text() for path in sorted(tree.folder.glob("mdtopo-*.log"))}
    sys.stdout.write("".join(f"--- {name}\n{text}" for name, text in logs.items()))
    assert len(logs) == n_shards == len(set(requeued))
    for text in logs.values():
        assert "checkpointed; back into the queue" in text
        assert "going on behind step 19" in text
    merged = tree.run("mdtopo", "merge", *(str(p) for p in sorted(tree.folder.glob("shard-*.h5"))), "-o", "run.h5")
    sys.stdout.write(merged.stdout + merged.stderr)
    assert merged.returncode == 0
    single = tree.run("mdtopo", "monitor", *inputs, "--block-steps", "20", "-o", "single.h5", "-q")
    assert single.returncode == 0, single.stderr
    joined, one = (read_results(tree.folder / name) for name in ("run.h5", "single.h5"))
    for column in StepTable.columns():
        assert np.array_equal(joined.steps[column.name], one.steps[column.name], equal_nan=True)
