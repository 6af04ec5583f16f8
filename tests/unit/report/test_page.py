"""The page of a run: what it says is what the results file holds, and nothing in a file can break out of it."""

import base64
import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import browser
import numpy as np
import pytest

from mdtopo import Strands, monitor, read_results
from mdtopo.cli import main
from mdtopo.errors import InputError, OutputError
from mdtopo.pipeline import PartLength, StopRequest
from mdtopo.records import AlertKind, MonitorConfig, StepState, Verdict
from mdtopo.report import RunData, ranked_events, render_page
from mdtopo.report.cards import strand_cards
from mdtopo.report.envelope import MOST_BINS
from mdtopo.report.scene import Piece
from mdtopo.report.views import views_of
from mdtopo.reporting import event_scenes, write_report
from mdtopo.store import read_running

HOSTILE = "</script><script>document.title='owned'</script><img src=x onerror=alert(1)>"
EIGHT_MB = 8_000_000

needs_browser = pytest.mark.skipif(bool(browser.missing()), reason=browser.missing() or "a browser is there")


def bars(n_frames: int = 8) -> np.ndarray:
    """Two open strands of three vertices; the second goes through the first between the frames 3 and 4."""
    first = np.array([[-1.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [0.9, 0.1, 0.0]])
    second = np.array([[0.0, -1.4, 0.0], [0.1, 0.6, 0.0], [0.2, 1.6, 0.0]])
    heights = 0.35 - 0.1 * np.arange(n_frames)
    return np.stack([np.concatenate([first, second + np.array([0.0, 0.0, z])]) for z in heights])


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., Path]:
    def run(positions: np.ndarray | None = None, name: str = "run", labels: str = "strand", **knobs: object) -> Path:
        x = bars() if positions is None else positions
        source, out = tmp_path / f"{name}.npz", tmp_path / f"{name}.h5"
        names = np.array([f"{labels} 1", f"{labels} 2"])
        np.savez(source, positions=x, offsets=[0, 3, 6], closed=[False, False], time=np.arange(len(x)), names=names)
        monitor(source, out=out, config=MonitorConfig(motion="lab", **knobs))
        return out

    return run


class Figures(HTMLParser):
    """Collects the numbers of ``data`` elements, the counts, and every element."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.values: list[float] = []
        self.counts: dict[str, int] = {}
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._count = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        if tag == "data":
            self.values.append(float(found["value"] or "nan"))
        self._count = found.get("data-count") or ("steps" if found.get("id") == "n-steps" else "")

    def handle_data(self, data: str) -> None:
        if self._count:
            self.counts[self._count] = int(data)
            self._count = ""


def page_data(text: str) -> dict:
    found = re.search(r'<script type="application/json" id="mdtopo-data">(.*?)</script>', text, re.S)
    assert found is not None
    return json.loads(found[1])


def unpacked(text: str, dtype: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype)


def test_every_figure_is_the_results_files(make: Callable[..., Path]) -> None:
    results = make()
    write_report(results, results.with_suffix(".html"))
    text = results.with_suffix(".html").read_text()
    found, page, data = read_results(results), Figures(text), page_data(text)
    counts = found.summary["counts"]
    shown = [page.counts[name] for name in ("proved by ball", "proved by pairs", "near the limit", "unresolved")]
    assert [*shown, page.counts["crossed"]] == list(counts.values())
    assert sum(counts.values()) == page.counts["steps"] == len(found.steps["verdict"]) == 7
    assert counts["crossed"] == 1
    for name in ("clearance", "pair_ratio", "nu_ratio"):
        column, series = found.steps[name], data["series"][name]
        np.testing.assert_array_equal(unpacked(series["least"], "<f8"), column)
        np.testing.assert_array_equal(unpacked(series["greatest"], "<f8"), column)
    known = np.concatenate([column.ravel().astype(float) for column in found.steps.values()])
    assert found.profile is not None
    known = np.concatenate([known, found.profile.clearance.ravel(), [found.config["coordinate_error"] or 0.0]])
    for value in page.values:
        assert np.isclose(known, value, rtol=1e-15, atol=0.0).any(), value
    assert {alert.message for alert in found.alerts} == {marker["text"] for marker in data["alerts"]}
    assert RunData.of(results, found).summary.to_mapping() == found.summary


def test_the_view_opens_at_the_crossing(make: Callable[..., Path]) -> None:
    results = make()
    write_report(results, results.with_suffix(".html"))
    crossing = read_results(results).crossings[0]
    scene = page_data(results.with_suffix(".html").read_text())["scenes"]["crossing-3-1-3"]
    assert scene["t"] == crossing.t == pytest.approx(0.5)
    (p0, p1), (q0, q1) = np.array(scene["marked"])
    p, q = ((1 - crossing.t) * x0 + crossing.t * x1 for x0, x1 in ((p0, p1), (q0, q1)))
    s, r = crossing.parameters
    np.testing.assert_allclose((1 - s) * p[0] + s * p[1], (1 - r) * q[0] + r * q[1], atol=1e-12)


def test_hostile_labels_show_as_text(make: Callable[..., Path]) -> None:
    results = make(labels=HOSTILE)
    write_report(results, results.with_suffix(".html"))
    text = results.with_suffix(".html").read_text()
    tags = Figures(text).tags
    assert not [found for tag, found in tags if tag == "img" and "onerror" in found]
    assert [tag for tag, _ in tags].count("script") == 3
    assert HOSTILE not in text
    assert HOSTILE in unescape(text.split("<main>")[1].split("</main>")[0])
    assert HOSTILE in page_data(text)["alerts"][0]["text"]


def million(run: RunData, row: int) -> RunData:
    """The same run, its first step repeated to a million steps, one of them near the limit."""
    n = 1_000_000
    columns = {name: np.repeat(column[:1], n, axis=0) for name, column in run.columns.items()}
    columns["time_t0"], columns["time_t1"] = np.arange(n, dtype=float), np.arange(1.0, n + 1)
    columns["frame_t0"], columns["frame_t1"] = np.arange(n), np.arange(1, n + 1)
    columns["pair_ratio"][row] = 0.85
    results = replace(run.results, steps=columns, crossings=run.results.crossings.rows(slice(0)), alerts=())
    return RunData.of(run.path, results)


def test_one_near_limit_step_in_a_million(make: Callable[..., Path]) -> None:
    results = make()
    run = million(RunData.of(results, read_results(results)), row := 654_321)
    text = render_page(run, {})
    data = page_data(text)
    greatest = unpacked(data["series"]["pair_ratio"]["greatest"], "<f8")
    assert greatest.max() == 0.85
    assert unpacked(data["series"]["pair_ratio"]["greatest_step"], "<i4")[greatest.argmax()] == row
    assert (unpacked(data["states"], "<i1") == StepState.NEAR_LIMIT).sum() == 1
    assert len(greatest) <= MOST_BINS
    assert Figures(text).counts["near the limit"] == 1
    assert len(text.encode()) < EIGHT_MB


def test_a_crowded_run_stays_below_eight_megabytes(make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A million steps, ten thousand alerts of every kind, and sixteen views of 600 vertices with long labels."""
    # pictures of a melt have up to 67 000 bytes here, and take seconds to draw
    monkeypatch.setattr("mdtopo.report.views.event_picture", lambda _: "data:image/webp;base64," + 100_000 * "A")
    results = make()
    whole = RunData.of(results, read_results(results))
    scene = next(iter(event_scenes(whole)[0].values()))
    run, rng = million(whole, 5), np.random.default_rng(7)
    run.columns["clearance"][:] = rng.random(run.n_steps)
    kinds = tuple(AlertKind)
    alert = whole.results.alerts[0]
    alerts = tuple(
        replace(alert, id=f"a-{k}", kind=kinds[k % len(kinds)], step_peak=100 * k, message=f"{alert.message} {k}" * 2)
        for k in range(10_000)
    )
    run = RunData.of(results, replace(run.results, alerts=alerts))
    crowded = {}
    for event in ranked_events(run)[:16]:
        x = scene.radius * rng.uniform(-1.0, 1.0, (2, 600, 3))
        pieces = [
            Piece(f"strand {k}", ("ALPHA:GLY1234:C3'",) * 20, x[0, k : k + 20], x[1, k : k + 20])
            for k in range(0, 600, 20)
        ]
        crowded[event.alert.id] = replace(scene, pieces=tuple(pieces))
    text = render_page(run, crowded)
    data = page_data(text)
    assert len(text.encode()) < EIGHT_MB
    assert 8 <= len(data["scenes"]) <= 16
    assert text.count('class="view"') == len(data["scenes"])
    assert sum(marker["n"] for marker in data["alerts"]) == sum(kind is not AlertKind.GAP for kind in kinds) * 1250


def test_views_that_are_left_out_are_said_and_to_be_had(
    make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    results = make(near_limit=0.1)
    page = results.with_suffix(".html")
    run = RunData.of(results, read_results(results))
    events = [event for event in ranked_events(run) if event.has_view]
    every = [event.alert.id for event in events]
    assert len(every) > 1
    write_report(results, page)
    assert list(page_data(page.read_text())["scenes"]) == every
    assert "are left out" not in page.read_text()
    first = views_of(events[:1], event_scenes(run)[0], 1e9)[every[0]]
    monkeypatch.setattr("mdtopo.report.page.MOST_BYTES", first.n_bytes)
    write_report(results, page, overwrite=True)
    assert list(page_data(page.read_text())["scenes"]) == every[:1]
    assert f"{len(every) - 1} are left out" in page.read_text()
    assert f"mdtopo report run.h5 --views {len(every)} --overwrite" in page.read_text()
    assert main(["report", str(results), "--views", str(len(every)), "--overwrite"]) == 0
    assert list(page_data(page.read_text())["scenes"]) == every
    assert main(["report", str(results), "--views", "1", "--overwrite"]) == 0
    assert list(page_data(page.read_text())["scenes"]) == every[:1]


def test_no_trajectory_no_views(make: Callable[..., Path]) -> None:
    results = make()
    results.with_suffix(".npz").unlink()
    write_report(results, results.with_suffix(".html"))
    text = results.with_suffix(".html").read_text()
    assert "the trajectory could not be opened again" in unescape(text)
    assert page_data(text)["scenes"] == {}
    assert Figures(text).counts["steps"] == 7


def test_one_frame_and_no_step(make: Callable[..., Path]) -> None:
    results = make(bars(1))
    write_report(results, results.with_suffix(".html"))
    text = results.with_suffix(".html").read_text()
    assert "a step needs two frames" in text
    assert Figures(text).counts["steps"] == 0


def test_an_incomplete_run_says_so(make: Callable[..., Path]) -> None:
    results = make()
    found = replace(read_results(results), complete=False, summary={"stopped": "frame 9 cannot be read"})
    text = render_page(RunData.of(results, found), {})
    assert "Incomplete: the run did not come to its end (frame 9 cannot be read)" in text
    assert "the frames after frame 7 could not be read (" not in text.split("</dl>")[0]
    assert "The frames after frame 7 could not be read (frame 9 cannot be read)" in text
    assert "the frames after frame 7 could not be read: frame 9 cannot be read</td>" in text


def test_what_the_reader_said_of_the_input_is_kept_and_on_the_page(make: Callable[..., Path]) -> None:
    results = make(bars(4))
    found = read_results(results)
    assert found.provenance["notes"] == []
    said = {**found.provenance, "notes": ["The header of a.dcd declares 501 frames, but the file holds 100."]}
    text = render_page(RunData.of(results, replace(found, provenance=said)), {})
    assert "<td>The header of a.dcd declares 501 frames, but the file holds 100.</td>" in text


def answers_of(text: str) -> dict[str, str]:
    return dict(re.findall(r"<dt><a [^>]*>(.*?)</a></dt><dd>(.*?)</dd>", text))


def test_the_answers_of_an_incomplete_run_name_the_frames_that_nobody_saw(make: Callable[..., Path]) -> None:
    results = make(bars(4), criterion="nu", near_limit=1e3)  # ends before the crossing
    whole = replace(read_results(results), alerts=())
    assert (whole.steps["verdict"] == Verdict.CERTIFIED).all()
    said = answers_of(render_page(RunData.of(results, whole), {}))
    assert said["Did anything pass?"].startswith("No: proved in all 3 steps")
    assert said["Where should I look?"] == "Nowhere in particular: there is no warning."
    cut = replace(whole, complete=False, summary={"stopped": "frame 4 cannot be read"})
    said = answers_of(render_page(RunData.of(results, cut), {}))
    missing = "he frames after frame 3 could not be read"
    assert said["Did anything pass?"].startswith("Not in the part that was read: proved in its 3 steps")
    assert f"T{missing}" in said["Did anything pass?"]
    assert f"t{missing}" in said["Where should I look?"]
    assert said["What was not checked?"].startswith(f"T{missing}; ")


def test_an_alert_is_headed_by_all_its_frames(make: Callable[..., Path]) -> None:
    results = make(bars(4), near_limit=1e-3)
    text = render_page(RunData.of(results, found := read_results(results)), {})
    alert = next(alert for alert in found.alerts if alert.kind is AlertKind.NEAR_LIMIT)
    assert (alert.frame_start, alert.frame_end) == (0, 3)
    assert "frames 0–3, " in text
    step = alert.step_peak
    assert f"of its worst step {step}, frames {step}–{step + 1}." in text
    assert f"in frames 0–3 (worst in {step}–{step + 1})" in answers_of(text)["Where should I look?"]


def test_the_card_of_a_strand_counts_edges_with_one_edge_between_them(make: Callable[..., Path]) -> None:
    """A strand whose ends come closer to one another than anything else of it, and another strand beside it."""
    results = make(bars(3))
    run = RunData.of(results, read_results(results))
    columns = {name: column.copy() for name, column in run.columns.items()}
    for kind, values in (("local", [0.9, 0.8, 0.7]), ("self", [1.0, 0.75, 1.0])):
        columns[f"clearance_{kind}"][:] = values[: run.n_steps]
        columns[f"clearance_{kind}_pair"][:] = [[0, 1], [1, 2]]
    run = RunData.of(results, replace(run.results, steps=columns))
    card = next(card for card in strand_cards(run) if card.title == "strand 1")
    assert (card.clearance, card.step) == (0.75, 1)
    columns["clearance_local"][0] = 0.5
    card = next(card for card in strand_cards(run) if card.title == "strand 1")
    assert (card.clearance, card.step) == (0.5, 0)
    least = int(np.argmin(columns["clearance_inter"]))
    assert (card.apart, card.apart_step) == (columns["clearance_inter"][least], least)
    other = next(card for card in strand_cards(run) if card.title == "strand 2")
    assert (other.apart, other.apart_step, other.step) == (card.apart, card.apart_step, -1)


def test_a_run_that_has_not_ended_is_in_progress(
    make: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = make(bars(24)).with_suffix(".npz"), tmp_path / "half.h5"

    class Stop(StopRequest):
        left = 3

        @property
        def reason(self) -> str:
            self.left -= 1
            return "" if self.left > 0 else "enough"

    config = MonitorConfig(motion="lab", block_steps=4)
    parts = PartLength(steps=4)
    assert monitor(source, out=out, config=config, threads=1, parts=parts, stop=Stop()).checkpoint
    assert not out.exists()
    assert main(["report", str(out)]) == 0
    page = out.with_suffix(".html").read_text()
    n_steps = Figures(page).counts["steps"]
    assert n_steps == len(read_running(out).steps["verdict"]) < 23
    assert "<strong>in progress</strong>" in page
    assert page_data(page)["scenes"]
    assert f"{n_steps} steps in finished parts, the run has not ended" in capsys.readouterr().out
    assert monitor(source, out=out, config=config, threads=1).n_steps == 23
    assert main(["report", str(out), "--overwrite"]) == 0
    assert "in progress" not in out.with_suffix(".html").read_text().split("</header>")[0]


def test_a_missing_part_is_said(make: Callable[..., Path], tmp_path: Path) -> None:
    folder = tmp_path / "half.h5.parts"
    folder.mkdir()
    with pytest.raises(InputError, match="no finished part yet"):
        write_report(tmp_path / "half.h5", tmp_path / "half.html")
    part = make().read_bytes()  # holds the steps 0 to 6, so that these two cannot be one run
    for name in ("part-0000000000.h5", "part-0000000014.h5"):
        (folder / name).write_bytes(part)
    with pytest.raises(InputError, match="begins with step 0 where step 7 belongs; a part is missing"):
        write_report(tmp_path / "half.h5", tmp_path / "half.html")


def test_files_that_are_no_results(make: Callable[..., Path], tmp_path: Path) -> None:
    results = make()
    half = tmp_path / "half.h5"
    half.write_bytes(results.read_bytes()[:20_000])
    with pytest.raises(InputError, match="truncated or damaged"):
        write_report(half, tmp_path / "half.html")
    older = replace(read_results(results), steps={"verdict": np.empty(0)})
    with pytest.raises(InputError, match="an older mdtopo wrote it"):
        RunData.of(results, older)
    with pytest.raises(OutputError, match="exists already"):
        write_report(results, results)


def test_the_command(make: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    results = make()
    assert main(["report", str(results)]) == 0
    assert results.with_suffix(".html").is_file()
    assert "7 steps; the report is in" in capsys.readouterr().out
    assert main(["report", str(results)]) == 4
    assert "--overwrite" in capsys.readouterr().err
    assert main(["report", str(results), "--overwrite"]) == 0


def test_monitor_writes_the_report(make: Callable[..., Path], tmp_path: Path) -> None:
    source, page = make().with_suffix(".npz"), tmp_path / "again.html"
    words = ["monitor", str(source), "--motion", "lab", "--report", str(page)]
    assert main(words) == 4  # needs --out
    assert main([*words, "--out", str(tmp_path / "again.h5")]) == 0
    assert page_data(page.read_text())["scenes"]


@needs_browser
def test_in_a_browser(make: Callable[..., Path], tmp_path: Path) -> None:
    results = make(labels=HOSTILE)
    page_file = results.with_suffix(".html")
    write_report(results, page_file)
    with browser.browser(tmp_path / "profile") as page:
        page.open(page_file)
        time.sleep(0.5)
        assert page.errors() == []
        assert page.requests() == []
        assert "owned" not in page.run("return document.title")
        assert page.run("return document.querySelectorAll('#time-plot .scatterlayer .trace').length") >= 2
        assert page.run("return document.querySelectorAll('#heat-plot .heatmaplayer .hm').length") == 2
        assert page.run("return document.querySelector('#heat .stand-in').hidden")
        assert page.run("return document.querySelector('#heat-plot').data[0].z[4]") == [0.0]
        assert "distance 0.0000" in page.run("return document.querySelector('.controls output').textContent")
        page.run(
            "const s = document.querySelector('.controls input'); s.value = 1; s.oninput();"
            "Plotly.relayout('time-plot', {'xaxis.range': [1, 3]});"
        )
        assert "t = 1.0000" in page.run("return document.querySelector('.controls output').textContent")
        drawn = page.run(
            "const c = document.querySelector('.stage').data.find((s) => s.name.startsWith('smooth curve'));"
            "return [c.x, c.y, c.z, c.visible];"
        )
        curve = next(iter(page_data(page_file.read_text())["scenes"].values()))["curve"]
        expected = curve["unit"] * unpacked(curve["lines"][0]["x1"], "<i2").reshape(-1, 3)
        np.testing.assert_allclose(np.array(drawn[:3], dtype=float).T[: len(expected)], expected, rtol=1e-12)
        assert drawn[3] is True
        assert page.errors() == []


@needs_browser
def test_without_webgl_and_on_paper_pictures_stand_in(make: Callable[..., Path], tmp_path: Path) -> None:
    results = make(near_limit=0.1)
    write_report(results, results.with_suffix(".html"))
    flags = tuple(flag for flag in browser.FLAGS if "gl" not in flag and "swiftshader" not in flag)
    with browser.browser(tmp_path / "profile", flags=(*flags, "--disable-gpu", "--disable-3d-apis")) as page:
        page.open(results.with_suffix(".html"))
        assert page.run("return document.querySelector('.still').getBoundingClientRect().width") > 300
        assert page.run("return document.querySelector('.stage').hidden")
        shown = "return [...document.querySelectorAll('.event')].filter((e) => e.open).length"
        pictured = page.run("return document.querySelectorAll('.event .still').length")
        assert pictured > page.run(shown) == 1
        assert page.run(f"window.dispatchEvent(new Event('beforeprint')); {shown}") == pictured
        assert page.run(f"window.dispatchEvent(new Event('afterprint')); {shown}") == 1
        assert page.errors() == []


@needs_browser
def test_without_a_script_the_heat_map_is_a_picture(make: Callable[..., Path], tmp_path: Path) -> None:
    results = make()
    write_report(results, results.with_suffix(".html"))
    page_file = tmp_path / "no-script.html"
    whole = results.with_suffix(".html").read_text()
    page_file.write_text(
        re.sub(r"<script>.*</script>", "<script>document.documentElement.dataset.ready = 1</script>", whole, flags=re.S)
    )
    with browser.browser(tmp_path / "profile") as page:
        page.open(page_file)
        assert page.run("return document.querySelector('#heat .stand-in').getBoundingClientRect().width") > 300
        assert page.run("return document.querySelector('#heat-plot').hidden")


def test_strands_of_an_array_in_memory(tmp_path: Path) -> None:
    out = tmp_path / "memory.h5"
    monitor(bars(), strands=Strands.from_lengths([3, 3]), out=out, config=MonitorConfig(motion="lab"))
    write_report(out, tmp_path / "memory.html")
    assert "made from an object in memory" in unescape((tmp_path / "memory.html").read_text())
