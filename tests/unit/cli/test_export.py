from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from mdtopo.cli.exits import Exit


@pytest.fixture
def results(cli: Callable, npz: Callable, tmp_path: Path) -> Path:
    """A strand that trembles, with one damaged frame, 9: the steps 8 and 9 are not certified."""
    x = np.arange(8)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    x = x + np.random.default_rng(7).normal(0.0, 0.01, (12, 8, 3))
    x[9, 0, 0] = np.nan
    out = tmp_path / "run.h5"
    assert cli("monitor", npz(positions=x), "-o", out, "-q").code == Exit.DONE
    return out


def export(cli: Callable, results: Path, name: str, *words: object) -> object:
    form = name.rpartition(".")[2]
    return cli("export", results, "-o", results.with_name(name), "--format", form, *words)


def test_frames_become_time_steps(cli: Callable, results: Path) -> None:
    outcome = export(cli, results, "a.vtkhdf", "--what", "polyline", "--frames", ":8:2")
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    stored = np.load(results.with_name("tiny.npz"))["positions"]
    with h5py.File(results) as run, h5py.File(results.with_name("a.vtkhdf")) as file:
        np.testing.assert_array_equal(file["VTKHDF/Points"][()], stored[:8:2].reshape(-1, 3))
        clearance = file["VTKHDF/PointData/clearance"][()].reshape(4, 8)
        assert clearance.min(axis=1).tolist() == run["steps/clearance"][:8:2].tolist()
        assert (clearance.max(axis=1) > clearance.min(axis=1)).all()
        closest = file["VTKHDF/PointData/closest"][()].reshape(4, 8).astype(bool)
        assert (clearance[closest].reshape(4, 4) == clearance.min(axis=1)[:, np.newaxis]).all()


def test_a_frame_whose_step_was_not_measured_has_no_clearance(cli: Callable, results: Path) -> None:
    outcome = export(
        cli, results, "a.vtkhdf", "--what", "polyline", "--frames", "6:9"
    )  # step 8 ends in a damaged frame
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    outcome = export(
        cli, results, "b.vtkhdf", "--what", "polyline", "--frames", "10:"
    )  # no step begins at the last frame
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    for name, measured in (("a.vtkhdf", [True, True, False]), ("b.vtkhdf", [True, False])):
        with h5py.File(results.with_name(name)) as file:
            values = file["VTKHDF/PointData/clearance"][()].reshape(-1, 8)
            assert np.isfinite(values).all(axis=1).tolist() == measured
            assert np.isnan(values).all(axis=1).tolist() == [not known for known in measured]


def test_an_event_is_the_frames_of_its_alerts(cli: Callable, results: Path) -> None:
    assert export(cli, results, "a.xyz", "--what", "event", "--step", 3).code == Exit.DONE
    text = results.with_name("a.xyz").read_text().splitlines()
    assert [line.split(",")[0] for line in text[1::10]] == ["frame 3", "frame 4"]
    outcome = export(cli, results, "b.xyz", "--what", "event", "--step", 8)
    assert outcome.code == Exit.BAD_INPUT
    assert "Frame 9 cannot be exported: 1 vertex has a coordinate that is not finite" in outcome.err
    assert not list(results.parent.glob("*b.xyz*"))  # no half a file


def test_moments_of_a_certified_step(cli: Callable, results: Path) -> None:
    words = ["--what", "event", "--step", 3, "--between", 2]
    assert export(cli, results, "a.pdb", *words).out.endswith("a.pdb: 4 times\n")
    text = results.with_name("a.pdb").read_text()
    assert "certified motion." in text
    assert "NOT PROVED" not in text
    assert export(cli, results, "a.pdb", *words).code == Exit.BAD_INPUT  # it exists
    assert export(cli, results, "a.pdb", *words, "--overwrite").code == Exit.DONE


def test_moments_of_a_step_that_is_not_certified_are_refused_or_marked(
    cli: Callable, npz: Callable, tmp_path: Path
) -> None:
    bars = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 2.0], [0, 1, 2.0]])
    frames = np.stack([bars, bars * [1, 1, -1]])
    source = npz(positions=frames, offsets=np.array([0, 2, 4]), closed=np.zeros(2, bool), time=np.arange(2.0))
    run = tmp_path / "run.h5"
    assert cli("monitor", source, "-o", run, "-q", "--motion", "lab").code == Exit.DONE
    words = ["--what", "event", "--step", 0, "--between", 1]
    for name in ("a.pdb", "a.xyz", "a.vtkhdf"):
        outcome = export(cli, run, name, *words)
        assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
        assert "Step 0 is CROSSING" in outcome.err
        assert not (tmp_path / name).exists()
        assert export(cli, run, name, *words, "--allow-unproved").code == Exit.DONE
    assert "NOT PROVED" in (tmp_path / "a.pdb").read_text()
    assert (tmp_path / "a.xyz").read_text().count("NOT PROVED") == 3
    with h5py.File(tmp_path / "a.vtkhdf") as file:
        assert not file["VTKHDF/PointData/proved"][()].any()
        assert (file["VTKHDF/PointData/clearance"][()] == 0.0).all()  # both edges cross
        assert "NOT PROVED" in file.attrs["mdtopo"]


@pytest.mark.parametrize(
    "words",
    [
        ["--what", "event"],
        ["--what", "polyline", "--step", "1"],
        ["--format", "pdb"],
        ["--what", "polyline", "--between", "1"],
        ["--what", "event", "--step", "1", "--frames", ":3"],
        ["--what", "curve", "--step", "1"],
        ["--what", "curve", "--tolerance", "0"],
        ["--what", "curve", "--tolerance", "nan"],
        ["--what", "curve", "--curve", "round"],
        ["--what", "polyline", "--tolerance", "0.1"],
        ["--what", "polyline", "--curve", "bspline"],
        ["--what", "polyline", "--frames", "::-1"],
    ],
    ids=" ".join,
)
def test_wrong_words_exit_with_2(cli: Callable, results: Path, words: list[str]) -> None:
    assert export(cli, results, "a.xyz", *words).code == Exit.USAGE


def test_the_extension_says_the_format_and_strands_are_the_default(cli: Callable, results: Path) -> None:
    assert export(cli, results, "a.xyz", "--what", "polyline", "--frames", ":8").code == Exit.DONE
    short = results.with_name("short.xyz")
    assert cli("export", results, "-o", short, "--frames", ":8").code == Exit.DONE
    assert short.read_bytes() == results.with_name("a.xyz").read_bytes()
    event = results.with_name("event.xyz")
    assert cli("export", results, "-o", event, "--step", 3).code == Exit.DONE
    assert event.read_bytes() != short.read_bytes()
    outcome = cli("export", results, "-o", results.with_name("a.dat"))
    assert outcome.code == Exit.USAGE
    assert "names no format" in outcome.err


def test_wrong_input_exits_with_4_and_one_sentence(cli: Callable, results: Path) -> None:
    for words in (["--what", "event", "--step", 11], ["--what", "polyline", "--frames", "90:"]):
        outcome = export(cli, results, "a.xyz", *words)
        assert (outcome.code, len(outcome.err.splitlines())) == (Exit.BAD_INPUT, 1)
    gone = results.parent / "gone" / "a.vtkhdf"
    outcome = cli("export", results, "-o", gone, "--what", "polyline", "--format", "vtkhdf")
    assert (outcome.code, "there is no directory" in outcome.err) == (Exit.BAD_INPUT, True)
    outcome = cli("export", results, "-o", results, "--what", "polyline", "--format", "xyz", "--overwrite")
    assert (outcome.code, "is read here" in outcome.err) == (Exit.BAD_INPUT, True)


def test_the_curve_is_written_with_what_is_proved_of_it(cli: Callable, results: Path) -> None:
    outcome = export(cli, results, "a.vtkhdf", "--what", "curve", "--frames", ":8", "--tolerance", "0.001")
    assert (outcome.code, outcome.err) == (Exit.DONE, "")
    assert outcome.out.endswith("8 times, the polyline is proved to be isotopic to the curve at 8 of them\n")
    with h5py.File(results) as run, h5py.File(results.with_name("a.vtkhdf")) as file:
        assert "interpolating curve of the strands, at most 0.001 Å" in file.attrs["mdtopo"]
        points = file["VTKHDF/Steps/PointOffsets"][()]
        assert len(set(np.diff(points))) > 1  # other points in each frame
        data = file["VTKHDF/PointData"]
        assert data["isotopic"][()].all()
        assert data["chord_error"][()].max() <= 0.001
        ends = [*points[1:], len(data["polyline_clearance"])]
        clearance = [data["polyline_clearance"][a:b] for a, b in zip(points, ends, strict=True)]
        assert [part.min() for part in clearance] == run["steps/clearance"][:8].tolist()
        assert all(part.max() > part.min() for part in clearance)


def test_where_the_polyline_is_not_known_to_be_isotopic_is_said(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    bars = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0.1, 0], [0.2, -1, 2.0], [0.2, 0, 2.0], [0.2, 1, 2.1]])
    near = bars.copy()
    near[3:, 2] = 0.01, 0.02, 0.01
    near[1, 2] = 0.04
    source = npz(positions=np.stack([bars, near]), offsets=np.array([0, 3, 6]), closed=np.zeros(2, bool), time=None)
    run = tmp_path / "run.h5"
    assert cli("monitor", source, "-o", run, "-q").code == Exit.DONE
    outcome = export(cli, run, "a.xyz", "--what", "curve", "--tolerance", "0.1")
    assert outcome.code == Exit.DONE
    assert outcome.out.endswith("2 times, the polyline is proved to be isotopic to the curve at 1 of them\n")
    assert "not known whether the polyline is isotopic to the curve at frame 1 (" in outcome.err
    assert (tmp_path / "a.xyz").read_text().count("NOT KNOWN to be isotopic") == 1


def test_pdb_holds_the_curve_of_one_frame_only(cli: Callable, results: Path) -> None:
    outcome = export(cli, results, "a.pdb", "--what", "curve", "--frames", ":8")
    assert (outcome.code, outcome.out) == (Exit.BAD_INPUT, "")
    assert "cannot hold the curve of 8 frames" in outcome.err
    assert not list(results.parent.glob("*a.pdb*"))
    assert export(cli, results, "a.pdb", "--what", "curve", "--frames", "2:3").code == Exit.DONE
    assert "is isotopic to the curve" in " ".join((results.parent / "a.pdb").read_text().split())
    outcome = export(cli, results, "b.xyz", "--what", "curve", "--frames", "9:10")
    assert "Frame 9 cannot be exported" in outcome.err
