"""Whether the drawn curve of an alert's strands has their own type: said for the frames of alerts, and in reports."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import mdtopo
from mdtopo import Isotopy, MonitorConfig, Strands, read_results
from mdtopo.cli import main
from mdtopo.curvetypes import MOST_VERTICES, alert_types, types_in_words
from mdtopo.errors import InputError
from mdtopo.reporting import write_report


def trefoil(n: int) -> np.ndarray:
    x = 2 * np.pi * np.arange(n) / n
    return 3 * np.stack([np.sin(x) + 2 * np.sin(2 * x), np.cos(x) - 2 * np.cos(2 * x), -np.sin(3 * x)], axis=1)


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Path]:
    """Runs the job on a trefoil, in frame 2 shaken hard, and a bar that passes through it; a strand far off."""

    def job(n: int = 30, curve: str = "interpolating") -> Path:
        bar, other = np.array([[0.0, 4.0, -1.0], [0.0, 14.0, -1.0]]), np.array([[99.0, 0, 0], [99.0, 9.0, 0]])
        x = np.concatenate([trefoil(n), bar, other])
        frames = np.stack([x, x, x])
        frames[1:, n : n + 2, 2] += 5.0
        frames[2, :n] += np.random.default_rng(0).normal(scale=0.9, size=(n, 3))
        strands = Strands.from_lengths([n, 2, 2], closed=[True, False, False], names=["knot", "bar", "far"])
        np.savez(
            tmp_path / "in.npz", positions=frames, offsets=strands.offsets, closed=strands.closed, names=strands.names
        )
        config = MonitorConfig(motion="lab", curve=curve)  # type: ignore[arg-type]
        mdtopo.monitor(tmp_path / "in.npz", out=tmp_path / "run.h5", config=config)
        return tmp_path / "run.h5"

    return job


def test_both_frames_of_an_alert_s_worst_step_are_told(run: Callable[..., Path]) -> None:
    path = run()
    results = read_results(path)
    crossing = next(a for a in results.alerts if a.kind is mdtopo.AlertKind.CROSSING and a.step_peak == 0)
    assert set(crossing.strands) == {"knot", "bar"}
    start, end = alert_types(path, results, results.alerts)[crossing.id]
    assert start.isotopy is not Isotopy.NOT_KNOWN
    assert end.isotopy is not Isotopy.NOT_KNOWN
    words = types_in_words((start, end), (0, 1))
    assert words.startswith("At frame 0: the drawn curve has the strands' own type: ")
    assert "At frame 1: the drawn curve has" in words


def test_the_answer_is_that_of_same_type_for_the_strands_alone(run: Callable[..., Path]) -> None:
    path = run()
    results = read_results(path)
    alert = next(a for a in results.alerts if a.step_peak == 0 and len(a.strands) == 2)
    with np.load(path.with_name("in.npz")) as arrays:
        x = arrays["positions"]
    found = alert_types(path, results, [alert])[alert.id]
    two = Strands.from_lengths([30, 2], closed=[True, False])
    assert [str(one) for one in found] == [str(mdtopo.same_type(x[frame, :32], two)) for frame in (0, 1)]


def test_too_many_vertices_and_other_kinds_are_not_known(run: Callable[..., Path]) -> None:
    path = run(n=MOST_VERTICES)
    results = read_results(path)
    alert = next(a for a in results.alerts if len(a.strands) == 2)
    for one in alert_types(path, results, [alert])[alert.id]:
        assert one.isotopy is Isotopy.NOT_KNOWN
        assert f"have {MOST_VERTICES + 2} vertices" in one.reason


def test_a_run_without_a_curve_is_refused(run: Callable[..., Path]) -> None:
    path = run(curve="none")
    with pytest.raises(InputError, match="looked at no smooth curve; run it with --curve interpolating"):
        alert_types(path, read_results(path), [])


def test_the_command_adds_it_to_each_alert(run: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    path = run()
    assert main(["alerts", str(path), "--kind", "crossing", "--curve-type", "--format", "jsonl"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {line["curve_type_start"] for line in lines} <= {"tube", "homotopy", "not_known"}
    assert all(len(line["curve_type_reason"]) == 2 for line in lines)
    assert main(["alerts", str(path), "--kind", "crossing", "--curve-type", "--format", "csv"]) == 0
    heading, first, *_ = capsys.readouterr().out.splitlines()
    assert heading.endswith("object,curve_type_start,curve_type_end,curve_type_reason")
    assert lines
    assert first.count("tube") + first.count("homotopy")
    assert main(["alerts", str(path), "--kind", "crossing", "--curve-type", "--format", "table"]) == 0
    assert "curve's type" in capsys.readouterr().out
    assert main(["alerts", str(path), str(path)]) == 2
    assert "only read for --curve-type" in capsys.readouterr().err


def test_the_report_says_it_of_the_events_that_it_shows(run: Callable[..., Path], tmp_path: Path) -> None:
    write_report(run(), tmp_path / "run.html")
    assert "At frame 0: the drawn curve has the strands&#39; own type" in (tmp_path / "run.html").read_text()
