"""Many runs on one page, and what MultiQC takes of them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from mdtopo import MonitorConfig, Strands, monitor, read_results
from mdtopo.cli import main
from mdtopo.report import RunData, multiqc_files
from mdtopo.report.multiqc import MOST_POINTS


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """Two runs of two bars each: in ``quiet`` nothing meets, in ``through`` one passes through the other."""
    found = []
    for name, speed in (("quiet", 0.0), ("through", -0.1)):
        bars = np.array([[-1.0, 0, 0.35], [0.9, 0.1, 0.35], [0, -1.0, 0], [0.1, 0.8, 0]])
        x = np.stack(
            [bars + np.array([[0, 0, k * speed]] * 2 + [[0, 0, 0]] * 2) for k in range(1200 if not speed else 8)]
        )
        monitor(
            x, strands=Strands.from_lengths([2, 2]), out=tmp_path / f"{name}.h5", config=MonitorConfig(motion="lab")
        )
        found.append(tmp_path / f"{name}.h5")
    return found


def test_worst_first_with_links(runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "all.html"
    assert main(["report", *map(str, runs), "-o", str(out), "--multiqc"]) == 0
    links = re.findall(r'<a href="([^"]+)"', out.read_text())
    assert links == ["all-through.html", "all-quiet.html"]
    assert all((tmp_path / link).is_file() for link in links)
    quiet = RunData.of(runs[0], read_results(runs[0])).summary.curve
    assert quiet is not None
    assert f"{quiet.certified} proved, {quiet.unresolved} unresolved, {quiet.crossed} crossed" in out.read_text()
    assert len(list(tmp_path.glob("*_mqc.json"))) == 6
    assert "2 runs; the overview is in" in capsys.readouterr().out


def test_a_run_that_cannot_be_read_has_a_row(runs: list[Path], tmp_path: Path) -> None:
    (broken := tmp_path / "<b>broken.h5").write_text("no HDF5")
    out = tmp_path / "all.html"
    assert main(["report", str(runs[0]), str(broken), "-o", str(out)]) == 4
    text = out.read_text()
    assert "is not an HDF5 file" in text
    assert "<b>broken" not in text
    assert text.index("unreadable") < text.index("all-quiet.html")


def test_no_point_is_thinned_away(runs: list[Path]) -> None:
    found = read_results(runs[0])
    run = RunData.of(runs[0], found)
    run.columns["clearance"][777] = 0.01
    files = {name: json.loads(text) for name, text in multiqc_files(run, "quiet").items()}
    least, greatest = files["clearance"]["data"].values()
    assert len(least) <= MOST_POINTS
    assert len(greatest) <= MOST_POINTS
    assert min(value for _, value in least) == 0.01
    times = [at for at, _ in least]
    assert times == sorted(times)
    row = files["verdict"]["data"]["quiet"]
    assert sum(row[name] for name in ("ball", "pairs", "near_limit", "unresolved", "crossed")) == row["steps"] == 1199
