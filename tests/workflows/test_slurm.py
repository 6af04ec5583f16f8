"""The workflow on a real SLURM of one node: pytest -m slow -s tests/workflows/test_slurm.py."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from one_node_slurm import OneNodeSlurm, one_node_slurm
from workflow_tree import Tree, copied_tree

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
