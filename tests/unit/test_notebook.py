"""Notebook habits: every text escaped, every number plotted, pandas optional."""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import mdtopo
from mdtopo.errors import InputError, MissingDependencyError
from mdtopo.records import MonitorConfig, Strands
from mdtopo.store import Results, read_results

HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(autouse=True)
def _headless(monkeypatch: pytest.MonkeyPatch) -> None:
    matplotlib.use("Agg")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[mdtopo.RunSummary, Results]:
    bars = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 2.0], [0, 1, 2.0]])
    frames = np.stack([bars, bars * [1, 1, 0.3], bars * [1, 1, -1], bars * [1, 1, -1]])
    strands, path = Strands.from_lengths([2, 2], names=[HOSTILE, "b"]), tmp_path_factory.mktemp("note") / "run.h5"
    summary = mdtopo.monitor(frames, strands=strands, out=path, config=MonitorConfig(motion="lab"))
    return summary, read_results(path)


def test_names_of_files_show_as_text(run: tuple[mdtopo.RunSummary, Results]) -> None:
    summary, results = run
    assert "<script>" not in results._repr_html_()
    assert "&lt;script&gt;" in results._repr_html_()
    assert "<b>" not in replace(summary, stopped="<b>gone</b>")._repr_html_()
    for name, count in (("crossed", 1), ("undersampled crossings", 1), ("steps", 3)):
        assert f"<th>{name}</th><td>{count}</td>" in summary._repr_html_()


def test_a_prompt_shows_strands_and_results_in_a_few_words(run: tuple[mdtopo.RunSummary, Results]) -> None:
    results = run[1]
    assert repr(results.strands) == f"<Strands: 2 with 4 vertices: {HOSTILE!r} (open, 2), 'b' (open, 2)>"
    n = len(results.alerts)
    assert repr(results) == f"<Results: UNPROVEN, complete, 3 steps, 2 strands, {n} alerts>"
    assert repr(results.crossings) == "<Crossings: 1, steps 1 to 1>"
    assert repr(results.crossings.rows(slice(0))) == "<Crossings: 0>"
    table = results.crossings._repr_html_()
    assert "<td>undersampled</td>" in table
    assert HOSTILE not in table
    many = Strands.from_lengths([3] * 9, closed=True)
    assert repr(many).endswith("'strand 4' (ring, 3), …>")
    assert "<th>steps</th><td>3</td>" in results._repr_html_()
    assert {alert.severity.name for alert in results.alerts} == {"WARNING"}
    assert f"<th>alerts</th><td>{n} ({n} warning)</td>" in results._repr_html_()
    assert "<td>in progress</td>" in replace(results, complete=False, in_progress=True)._repr_html_()


def test_a_step_shows_itself_as_a_table() -> None:
    x = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 2.0], [0, 1, 2.0]])
    report = mdtopo.polyline_step(x, x * [1, 1, 0.5], Strands.from_lengths([2, 2]))
    table = report._repr_html_()
    assert "<th>verdict</th><td>CERTIFIED</td>" in table
    assert f"<th>clearance</th><td>{report.clearance}</td>" in table
    assert "<th>crossings</th><td>&lt;Crossings: 0&gt;</td>" in table


def test_the_plot_holds_every_step_the_limit_and_the_alerts(run: tuple[mdtopo.RunSummary, Results]) -> None:
    from matplotlib import pyplot

    results = run[1]
    ax = results.plot()
    lines = {line.get_label(): line for axes in ax.figure.axes for line in axes.lines}
    np.testing.assert_array_equal(lines["clearance"].get_ydata(), results.steps["clearance"])
    np.testing.assert_array_equal(lines["pair ratio"].get_ydata(), results.steps["pair_ratio"])
    assert list(lines["near-limit threshold"].get_ydata()) == [0.8, 0.8]
    peaks = [alert.step_peak for alert in results.alerts if alert.severity.name == "WARNING"]
    assert sorted(lines["warning alerts"].get_xdata()) == sorted(peaks)
    upper, lower = ax.figure.axes
    assert lines["pair ratio"].axes is lines["near-limit threshold"].axes is lower
    assert lines["clearance"].axes is upper is ax
    ax.figure.canvas.draw()
    assert lower.get_position().y1 < upper.get_position().y0  # neither hides the other
    assert lower.get_yscale() == ("log" if results.steps["pair_ratio"].max() > 5 else "linear")
    own = pyplot.figure().add_subplot()
    assert results.plot(own) is own
    pyplot.close("all")


def test_the_heat_map_holds_every_value_of_the_profile(tmp_path: Path) -> None:
    from matplotlib import pyplot

    rng = np.random.default_rng(1)
    frames = np.cumsum(np.ones((9, 3)), axis=0) + np.cumsum(rng.normal(0, 0.03, (40, 9, 3)), axis=0)
    frames[20, 2, 1] = np.nan
    config = MonitorConfig(motion="lab", profile_steps=2)
    mdtopo.monitor(frames, strands=Strands.from_lengths([9]), out=tmp_path / "run.h5", config=config)
    results = read_results(tmp_path / "run.h5")
    profile = results.profile
    assert profile is not None
    ax = results.plot_profile()
    mesh, crossed = ax.collections
    expected = np.full((9, 20), np.nan, dtype=np.float32)
    expected[:, profile.window] = profile.clearance.T
    np.testing.assert_array_equal(mesh.get_array().filled(np.nan), expected)
    assert crossed.get_array().mask.all()
    assert ax.get_xlim() == (0.0, 39.0)
    own = pyplot.figure().add_subplot()
    assert results.plot_profile(own) is own
    pyplot.close("all")
    with pytest.raises(InputError, match="hold no profile"):
        replace(results, profile=None).plot_profile()
    empty = mdtopo.monitor(frames[:1], strands=Strands.from_lengths([9]), out=tmp_path / "empty.h5")
    assert empty.results is not None
    assert read_results(empty.results).plot_profile().get_ylabel() == "vertex"
    pyplot.close("all")
    pytest.importorskip("pandas", reason="pandas is not installed: data frames are optional")
    table = results.profile_dataframe()
    assert table.index.tolist() == profile.step.tolist()
    assert table.columns.tolist() == [results.strands.labels.text(v) for v in range(9)]
    np.testing.assert_array_equal(table.to_numpy(), profile.clearance)


def test_without_pandas_one_sentence_says_what_to_install(
    run: tuple[mdtopo.RunSummary, Results], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingDependencyError, match="needs pandas"):
        run[1].to_dataframe()


def test_a_data_frame_has_a_row_for_each_step(run: tuple[mdtopo.RunSummary, Results]) -> None:
    pytest.importorskip("pandas", reason="pandas is not installed: data frames are optional")
    frame = run[1].to_dataframe()
    assert list(frame.index) == [0, 1, 2]
    assert list(frame.columns[:4]) == ["frame_t0", "frame_t1", "time_t0", "time_t1"]
    assert frame["verdict"].tolist() == ["CERTIFIED", "CROSSING", "CERTIFIED"]
    assert frame["nu_pair_1_0"].tolist() == run[1].steps["nu_pair"][:, 1, 0].tolist()


def test_the_results_of_an_analysis_have_the_same_habits() -> None:
    import MDAnalysis
    from matplotlib import pyplot

    universe = MDAnalysis.Universe.empty(5, trajectory=True)
    line = np.arange(5.0)[:, np.newaxis] * np.array([1.5, 0.0, 0.0])
    universe.load_new(line + np.random.default_rng(2).normal(scale=0.01, size=(4, 5, 3)))
    results = mdtopo.IsotopyAnalysis(universe.atoms).run().results
    (line,) = (line for line in results.plot().lines if line.get_label() == "clearance")
    np.testing.assert_array_equal(line.get_ydata(), results.clearance)
    assert results._repr_html_() == results.summary._repr_html_()
    pyplot.close("all")
