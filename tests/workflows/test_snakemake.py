"""The workflow on its small case, as a user runs it; from end to end: pytest -m slow tests/workflows."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from workflow_tree import REPOSITORY, Tree, copied_tree

from mdtopo import read_results

SNAKEMAKE = Path(sys.executable).with_name("snakemake")

pytestmark = pytest.mark.skipif(
    not (SNAKEMAKE.exists() or shutil.which("snakemake")), reason="snakemake is not installed (extra 'workflows')"
)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Tree:
    return copied_tree(tmp_path_factory.mktemp("workflow"))


@pytest.fixture(scope="module")
def done(tree: Tree) -> subprocess.CompletedProcess[str]:
    return tree.run("snakemake", "--profile", "profiles/local", "--cores", "2", "--directory", ".test")


def test_the_rules_pass_the_linter(tree: Tree) -> None:
    lint = tree.run("snakemake", "--lint", "--directory", ".test")
    assert lint.returncode == 0, lint.stdout + lint.stderr


def test_the_small_case_is_planned_with_its_checks(tree: Tree) -> None:
    planned = tree.run("snakemake", "--profile", "profiles/local", "--directory", ".test", "--dry-run")
    assert planned.returncode == 0, planned.stdout + planned.stderr
    assert "checkpoint shards" in planned.stdout + planned.stderr


@pytest.mark.parametrize("setting", ["threads=0", "shard-steps=none", "unknown=1"])
def test_a_configuration_that_the_schema_forbids_is_refused(tree: Tree, setting: str) -> None:
    refused = tree.run(
        "snakemake", "--profile", "profiles/local", "--directory", ".test", "--dry-run", "--config", setting
    )
    assert refused.returncode != 0
    assert setting.partition("=")[0] in refused.stdout + refused.stderr


@pytest.mark.slow
def test_the_small_case_ends_in_one_page(tree: Tree, done: subprocess.CompletedProcess[str]) -> None:
    assert done.returncode == 0, done.stdout + done.stderr
    page = (tree.results / "report" / "overview.html").read_text()
    for sample in ("bpti", "duplex", "pulled"):
        assert sample in page
        assert (tree.results / "report" / f"overview-{sample}.html").exists()
        assert list((tree.results / "report").glob(f"overview-{sample}_*_mqc.json"))


@pytest.mark.slow
@pytest.mark.parametrize(("sample", "shards"), [("bpti", 4), ("duplex", 3), ("pulled", 4)])
def test_each_sample_is_what_a_single_run_gives(
    tree: Tree, done: subprocess.CompletedProcess[str], tmp_path: Path, sample: str, shards: int
) -> None:
    """In `pulled` a bond is breaking where the last shard begins: it is measured again, with the bonds known."""
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(list((tree.results / sample / "shards").glob("[0-9]*.h5"))) == shards
    again = [path.name for path in (tree.results / sample / "shards").glob("again-*.h5")]
    assert again == (["again-44-60.h5"] if sample == "pulled" else [])
    demo, bpti = REPOSITORY / "mdtopo" / "demo", REPOSITORY / "workflows" / ".test" / "data" / "bpti"
    files = [bpti / "ca.gro", bpti / "ca.xtc"] if sample == "bpti" else [demo / "duplex.data", demo / "pull.dcd"]
    frames = ":36" if sample == "duplex" else "::"
    single = tree.run(
        "mdtopo", "monitor", *map(str, files), "--frames", frames, "-o", str(tmp_path / "single.h5"), "--quiet"
    )
    assert single.returncode == 0, single.stderr
    merged, alone = read_results(tree.results / sample / f"{sample}.h5"), read_results(tmp_path / "single.h5")
    assert merged.complete
    assert merged.steps.keys() == alone.steps.keys()
    for name in alone.steps:
        np.testing.assert_array_equal(merged.steps[name], alone.steps[name], err_msg=name)
    assert [alert.to_mapping() for alert in merged.alerts] == [alert.to_mapping() for alert in alone.alerts]
    assert merged.broken == alone.broken


def test_missing_files_are_named_before_anything_starts(tree: Tree, tmp_path: Path) -> None:
    table = tmp_path / "samples.tsv"
    table.write_text("sample\ttopology\ttrajectory\na\tnone.gro\tnone.xtc\na\tdata/bpti/ca.gro\t\n")
    refused = tree.run(
        "snakemake", "--profile", "profiles/local", "--directory", ".test", "--dry-run", "--config", f"samples={table}"
    )
    assert refused.returncode != 0
    said = refused.stdout + refused.stderr
    for fault in ("none.gro does not exist", "none.xtc does not exist", "the sample a twice"):
        assert fault in said


@pytest.mark.slow
def test_a_sample_that_cannot_be_read_stops_only_itself(tree: Tree, tmp_path: Path) -> None:
    folder = tmp_path / "case"
    (folder / "config").mkdir(parents=True)
    bpti = tree.folder / ".test" / "data" / "bpti"
    shutil.copy(bpti / "ca.gro", folder)
    shutil.copy(bpti / "ca.xtc", folder)
    (folder / "cut.xtc").write_bytes((bpti / "ca.xtc").read_bytes()[:9_000])
    (folder / "config" / "config.yaml").write_text("samples: config/samples.tsv\nresumes: 2\n")
    (folder / "config" / "samples.tsv").write_text(
        "sample\ttopology\ttrajectory\ngood\tca.gro\tca.xtc\nbad\tca.gro\tcut.xtc\n"
    )
    ended = tree.run("snakemake", "--profile", "profiles/local", "--cores", "2", "--directory", str(folder))
    said = ended.stdout + ended.stderr
    assert ended.returncode != 0
    assert (folder / "results" / "good" / "good.h5").exists(), said
    (line,) = (line for line in said.splitlines() if line.startswith("  bad: "))
    assert "cut.xtc" in line
    logs = list((folder / "results" / "bad").rglob("*.log"))
    assert logs
    assert not any("Traceback" in log.read_text() for log in logs)
