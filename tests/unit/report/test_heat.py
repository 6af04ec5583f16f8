"""The heat map of a run: every cell is the least of what it holds, with its step and vertex, and nothing is lost."""

import base64
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mdtopo import Strands, monitor, read_results
from mdtopo.records import MonitorConfig, Profile
from mdtopo.report import RunData, render_page
from mdtopo.report.heat import closest_places, heat_data, heat_map

LENGTHS = [7, 9]


def chains(n_frames: int = 60) -> np.ndarray:
    """Two chains that jiggle; the second goes through the first."""
    rng = np.random.default_rng(4)
    x = np.zeros((16, 3))
    x[:7, 0] = np.arange(7) - 3.0
    x[7:, 1], x[7:, 2] = np.arange(9) - 3.6, 1.0
    frames = x + np.cumsum(rng.normal(0, 0.02, (n_frames, 16, 3)), axis=0)
    frames[:, 7:, 2] -= 2.0 * (np.arange(n_frames) / n_frames)[:, np.newaxis]
    return frames


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., RunData]:
    def run(*, times: bool = True, n_frames: int = 60, **knobs: object) -> RunData:
        source, out = tmp_path / "run.npz", tmp_path / "run.h5"
        more = {"time": 2.5 * np.arange(n_frames)} if times else {}
        np.savez(source, positions=chains(n_frames), offsets=np.cumsum([0, *LENGTHS]), closed=[False, False], **more)
        monitor(source, out=out, config=MonitorConfig(motion="lab", **{"profile_steps": 4, **knobs}))  # type: ignore[arg-type]
        return RunData.of(out, read_results(out))

    return run


def test_every_cell_is_a_row_of_the_results_file_where_all_fit(make: Callable[..., RunData]) -> None:
    run = make()
    profile, heat = run.results.profile, heat_map(run)
    assert profile is not None
    assert heat is not None
    assert (len(profile), heat.windows, heat.vertices, heat.window_steps) == (15, 1, 1, 4)
    np.testing.assert_array_equal(heat.clearance, profile.clearance.T)
    assert (heat.step == profile.step).all()
    assert (heat.vertex == np.arange(16)[:, np.newaxis]).all()
    np.testing.assert_array_equal(heat.edges, [*(10.0 * np.arange(15)), 147.5])
    assert (heat.clearance == 0.0).any()


@pytest.mark.parametrize(("columns", "rows"), [(7, 200), (300, 5), (4, 3), (1, 1)])
def test_a_cell_of_many_windows_and_vertices_is_the_least_of_them(
    make: Callable[..., RunData], monkeypatch: pytest.MonkeyPatch, columns: int, rows: int
) -> None:
    run = make()
    monkeypatch.setattr("mdtopo.report.heat.MOST_COLUMNS", columns)
    monkeypatch.setattr("mdtopo.report.heat.MOST_ROWS", rows)
    profile, heat = run.results.profile, heat_map(run)
    assert profile is not None
    assert heat is not None
    assert heat.clearance.shape[0] <= rows
    assert heat.clearance.shape[1] <= columns
    for r, start in enumerate(heat.starts.tolist()):
        for c in range(heat.clearance.shape[1]):
            windows = slice(c * heat.windows, (c + 1) * heat.windows)
            held = profile.clearance[windows, start : start + heat.vertices]
            assert heat.clearance[r, c] == held.min()
            row = np.flatnonzero(profile.step == heat.step[r, c])[0]
            assert row in range(len(profile))[windows]
            assert profile.clearance[row, heat.vertex[r, c]] == held.min()
    least, step, vertex = heat.strip()
    for r, start in enumerate(heat.starts.tolist()):
        assert least[r] == profile.clearance[:, start : start + heat.vertices].min()
        assert profile.clearance[np.flatnonzero(profile.step == step[r])[0], vertex[r]] == least[r]


def test_what_was_not_measured_is_empty(make: Callable[..., RunData]) -> None:
    run = make()
    profile = run.results.profile
    assert profile is not None
    keep = [k for k in range(15) if k not in (0, 6)]
    values = profile.clearance[keep].copy()
    values[:, 3] = np.nan
    fewer = Profile(4, profile.window[keep], profile.step[keep], profile.least[keep], values)
    heat = heat_map(replace(run, results=replace(run.results, profile=fewer)))
    assert heat is not None
    assert heat.clearance.shape == (16, 15)
    empty = np.isnan(heat.clearance)
    assert empty[:, [0, 6]].all()
    assert empty[3].all()
    assert empty.sum() == 2 * 16 + 13
    assert ((heat.step < 0) == empty).all()
    assert ((heat.vertex < 0) == empty).all()
    least, step, vertex = heat.strip()
    assert np.isnan(least[3])
    assert step[3] == vertex[3] == -1


def test_the_page_holds_the_map_and_names_the_closest_vertices(make: Callable[..., RunData]) -> None:
    run = make()
    text = render_page(run, {})
    found = re.search(r'<script type="application/json" id="mdtopo-data">(.*?)</script>', text, re.S)
    assert found is not None
    shown = json.loads(found[1])["heat"]
    assert shown == json.loads(json.dumps(heat_data(run, heat_map(run), 1.0)))
    profile = run.results.profile
    assert profile is not None
    cells = np.frombuffer(base64.b64decode(shown["clearance"]), "<f4").reshape(16, 15)
    np.testing.assert_array_equal(cells, profile.clearance.T)
    assert shown["labels"] == [run.results.strands.labels.text(v) for v in range(16)]
    places = closest_places(run)
    assert len(places) == 8
    section = text.split('<section id="heat">')[1].split("</section>")[0]
    assert "data:image/webp;base64," in section
    assert "in the closest step of every 4." in section
    crossed = run.results.crossings[0]
    assert places[0]["clearance"] == 0.0
    assert places[0]["step"] == crossed.step
    assert {run.results.strands.labels.text(v) for v in crossed.edges.ravel().tolist()} <= set(places[0]["labels"])
    for place in places:
        row = np.flatnonzero(profile.step == place["step"])[0]
        assert np.float32(place["clearance"]) in profile.clearance[row]
        assert f'<data value="{place["clearance"]!r}">' in section
        assert ", ".join(place["labels"]) in section


def test_without_times_the_columns_are_steps(make: Callable[..., RunData]) -> None:
    run = make(times=False)
    heat = heat_map(run)
    assert heat is not None
    np.testing.assert_array_equal(heat.edges, [*(4.0 * np.arange(15)), 59.0])


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        ({"profile_steps": 0}, "the run was asked to keep none"),
        ({"n_frames": 1}, "there is no step that could be measured, or an older mdtopo wrote them"),
    ],
)
def test_a_run_without_a_profile_says_so(make: Callable[..., RunData], knobs: dict[str, int], words: str) -> None:
    text = render_page(make(**knobs), {})
    assert words in text
    assert 'id="heat-plot"' not in text
    assert '"heat": null' in text


def test_one_crossing_in_a_million_steps_of_a_thousand_vertices_is_in_the_map(make: Callable[..., RunData]) -> None:
    run, n, n_vertices = make(), 1_000_000, 1000
    columns = {name: np.repeat(column[:1], n, axis=0) for name, column in run.columns.items()}
    columns["time_t0"], columns["time_t1"] = np.arange(n, dtype=float), np.arange(1.0, n + 1)
    columns["frame_t0"], columns["frame_t1"] = np.arange(n), np.arange(1, n + 1)
    windows = np.arange(n // 128)
    values = np.random.default_rng(1).uniform(0.5, 1.0, (len(windows), n_vertices)).astype(np.float32)
    values[4321, 777] = 0.0
    profile = Profile(128, windows, 128 * windows + 5, values.min(axis=1).astype(float), values)
    strands = Strands.from_lengths([400, 600])
    results = replace(run.results, steps=columns, strands=strands, profile=profile, alerts=())
    run = RunData.of(run.path, replace(results, crossings=run.results.crossings.rows(slice(0))))
    heat = heat_map(run)
    assert heat is not None
    (where,) = np.argwhere(heat.clearance == 0.0)
    assert heat.step[tuple(where)] == 4321 * 128 + 5
    assert heat.vertex[tuple(where)] == 777
    assert heat.edges[where[1]] <= 4321 * 128 < heat.edges[where[1] + 1]
    assert len(render_page(run, {}).encode()) < 7_000_000  # of 8; views of events take the rest
