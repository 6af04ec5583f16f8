"""The smooth curve in the report: counted apart, with alerts and views of its own."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mdtopo import MonitorConfig, RunSummary, monitor, read_results
from mdtopo.records import AlertKind, CurveVerdict, Shape, Verdict
from mdtopo.report import RunData, event_place, multiqc_files, ranked_events
from mdtopo.report.cards import pair_cards, strand_cards
from mdtopo.report.scene import path_distance
from mdtopo.reporting import event_scenes, write_report

LEVEL = 0.6875
"""Where the natural spline through (-1, 0), (0, 1), (1, 0) is at x = -1/2; the edge there is at 1/2."""


def rod_and_hook(levels: list[float]) -> np.ndarray:
    """A hook in the plane, and a rod upright at x = -1/2, y = level: above its edge, it crosses its curve at LEVEL."""
    hook = np.array([[-1.0, 0, 0], [0, 1, 0], [1, 0, 0]])
    return np.stack([np.concatenate([hook, [[-0.5, y, -1.0], [-0.5, y, 1.0]]]) for y in levels])


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., tuple[RunSummary, Path]]:
    def run(levels: list[float], **knobs: Any) -> tuple[RunSummary, Path]:
        x, source, out = rod_and_hook(levels), tmp_path / "run.npz", tmp_path / "run.h5"
        names = np.array(["hook", "rod"])
        np.savez(source, positions=x, offsets=[0, 3, 5], closed=[False, False], time=np.arange(len(x)), names=names)
        return monitor(source, out=out, config=MonitorConfig(motion="lab", **knobs)), out

    return run


def page_of(out: Path) -> tuple[str, dict[str, Any]]:
    write_report(out, out.with_suffix(".html"))
    text = out.with_suffix(".html").read_text()
    found = re.search(r'<script type="application/json" id="mdtopo-data">(.*?)</script>', text, re.S)
    assert found is not None
    return text, json.loads(found[1])


def counted(text: str, name: str) -> int:
    found = re.search(rf'data-count="{name}">(\d+)<', text)
    assert found is not None
    return int(found[1])


LEVELS = [0.66, 0.67, 0.68, 0.70, 0.71]


def test_a_passage_of_the_curve_alone_is_counted_apart(make: Callable[..., tuple[RunSummary, Path]]) -> None:
    summary, out = make(LEVELS)
    assert summary.curve is not None
    text, data = page_of(out)
    found = read_results(out)
    assert (found.steps["verdict"] == Verdict.CERTIFIED).all()
    assert found.steps["curve_verdict"].tolist() == [CurveVerdict.CERTIFIED] * 2 + [2, CurveVerdict.CERTIFIED]
    assert (len(found.crossings), len(found.curve_crossings)) == (0, 1)
    shown = [counted(text, f"curve {name}") for name in ("proved", "unresolved", "crossed")]
    assert shown == [summary.curve.certified, summary.curve.unresolved, summary.curve.crossed] == [3, 0, 1]
    assert [counted(text, name) for name in ("unresolved", "crossed")] == [0, 0]
    assert summary.verdict.value in ("WARN",)
    assert "No: proved in all 4 steps" in text
    assert {marker["lane"] for marker in data["alerts"] if marker["step"] == 2} >= {"curve"}
    assert data["curve_name"] == "smooth curve (has a verdict of its own)"
    run = RunData.of(out, found)
    (pair,) = pair_cards(run)
    assert (pair.n_crossings, pair.n_curve_crossings) == (0, 1)
    assert [card.n_curve_crossings for card in strand_cards(run)] == [0, 0]
    rows = json.loads(multiqc_files(run, "run")["verdict"])["data"]["run"]
    assert (rows["crossed"], rows["curve_crossed"]) == (0, 1)


def test_its_view_opens_where_the_arcs_meet(make: Callable[..., tuple[RunSummary, Path]]) -> None:
    _, out = make(LEVELS)
    found = read_results(out)
    run = RunData.of(out, found)
    (event,) = (event for event in ranked_events(run) if event.about_curve)
    assert (event.alert.kind, event.alert.object, event.name) == (
        AlertKind.CROSSING,
        Shape.CURVE,
        "crossing of the curve",
    )
    (crossing,) = found.curve_crossings
    t, places = event_place(run, event)
    assert t == crossing.t == pytest.approx((LEVEL - 0.68) / 0.02)
    assert places == tuple(crossing.parameters.tolist())
    scene = event_scenes(run)[0][event.alert.id]
    assert scene.t == t
    arcs = [(1 - scene.t) * x0 + scene.t * x1 for x0, x1 in scene.marked]
    assert path_distance(*arcs) < 1e-9
    # the near miss: before and after, the arcs are apart by the way that the rod is from the curve there
    for instant, way in ((0.0, LEVEL - 0.68), (1.0, 0.70 - LEVEL)):
        now = [(1 - instant) * x0 + instant * x1 for x0, x1 in scene.marked]
        assert 0.5 * way < path_distance(*now) < way
    assert page_of(out)[1]["scenes"][event.alert.id]["arcs"] is True


def test_a_fold_has_a_view_of_its_one_arc(tmp_path: Path) -> None:
    # two vertices come together in a plane, and the arc between them makes a loop; its edges never meet
    x = np.stack([np.array([[-3.0, -3, 0], [0, 0, 0], [gap, 0, 0], [3, -3, 0]]) for gap in (2.0, 1.9, 0.1)])
    np.savez(tmp_path / "run.npz", positions=x, offsets=[0, 4], closed=[False], time=np.arange(3.0))
    out, config = tmp_path / "run.h5", MonitorConfig(motion="lab", curve="catmull-rom")
    summary = monitor(tmp_path / "run.npz", out=out, config=config)
    assert summary.curve is not None
    assert (summary.counts.unresolved, summary.curve.unresolved) == (0, 1)
    run = RunData.of(out, read_results(out))
    (event,) = (event for event in ranked_events(run) if event.about_curve)
    assert (event.name, event.edges) == ("unresolved of the curve", ((1, 2),))
    t, places = event_place(run, event)
    assert places is not None
    assert len(places) == 1
    scene = event_scenes(run)[0][event.alert.id]
    ((x0, x1),) = scene.marked
    assert scene.t == t
    # at first the arc goes on along x all the way; in the end it runs back within it
    assert (np.diff(x0[:, 0]) > 0.0).all()
    assert (np.diff(x1[:, 0]) < 0.0).any()
    assert abs(scene.eye[2]) > 0.9  # seen from above the plane
    text, data = page_of(out)
    assert "1 step of the smooth curve undecided" in text
    assert len(data["scenes"][event.alert.id]["marked"]) == 1


def test_a_run_without_the_curve_says_so(make: Callable[..., tuple[RunSummary, Path]]) -> None:
    summary, out = make(LEVELS, curve="none")
    assert summary.curve is None
    text, data = page_of(out)
    assert "The smooth curve of the strands was not looked at" in text
    assert data["curve_name"] == "smooth curve (drawn, not certified)"
    assert {marker["lane"] for marker in data["alerts"]} <= {kind.value for kind in AlertKind}


@pytest.mark.parametrize("kind", ["bspline", "catmull-rom", "bezier"])
def test_the_curve_of_the_run_is_the_one_that_is_drawn(make: Callable[..., tuple[RunSummary, Path]], kind: str) -> None:
    # the rod goes through the edge at 1/2, so that there is a view whatever the curve does
    _, out = make([0.52, 0.47], curve=kind)
    scene = event_scenes(RunData.of(out, read_results(out)))[0]["crossing-0-0-3"]
    hook = next(path for path in scene.curves if path.strand == "hook")
    from mdtopo import Strands, spline_curve

    x = rod_and_hook([0.52])[0, :3]
    curve = spline_curve(x, Strands.from_lengths([3]), kind)  # type: ignore[arg-type]
    dense = curve.points(np.linspace(0.0, 1.0, 2001)).reshape(-1, 3)
    shift = hook.x0[0] - x[0] if kind != "bspline" else hook.x0[0] - dense[0]
    gaps = np.linalg.norm((hook.x0 - shift)[:, None] - dense[None], axis=2).min(axis=1)
    assert gaps.max() < 1e-3
