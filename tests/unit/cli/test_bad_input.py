"""Bad input through the command line: one clear sentence and code 4, or an alert where the run can go on."""

import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import mdtopo
from mdtopo import Verdict
from mdtopo.cli.exits import Exit

N_FRAMES = 12


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with top.pdb (30 CA in two chains, and a calcium), traj.xtc, traj.dcd and few.xtc (20 atoms)."""
    import MDAnalysis

    folder = tmp_path_factory.mktemp("files")
    residues = np.arange(31)
    u = MDAnalysis.Universe.empty(
        31, n_residues=31, atom_resindex=residues, residue_segindex=(residues >= 15).astype(int), n_segments=2,
        trajectory=True,
    )  # fmt: skip
    u.add_TopologyAttr("names", ["CA"] * 31)
    u.add_TopologyAttr("resnames", ["ALA"] * 30 + ["CA"])
    u.add_TopologyAttr("resids", residues + 1)
    u.add_TopologyAttr("chainIDs", ["A"] * 15 + ["B"] * 16)
    u.add_TopologyAttr("segids", ["A", "B"])
    rng = np.random.default_rng(3)
    angle, across = np.radians(100.0) * residues, 15.0 * (residues // 15)
    line = np.stack([2.3 * np.cos(angle) + across, 2.3 * np.sin(angle), 1.5 * (residues % 15)], axis=1)  # two α-helices
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what MDAnalysis thinks of the made-up attributes
        u.atoms.positions = line
        u.dimensions = [80.0, 80.0, 80.0, 90.0, 90.0, 90.0]
        u.atoms.write(str(folder / "top.pdb"))
        for name, group in (("traj.xtc", u.atoms), ("traj.dcd", u.atoms), ("few.xtc", u.atoms[:20])):
            with MDAnalysis.Writer(str(folder / name), n_atoms=len(group)) as writer:
                for k in range(N_FRAMES):
                    u.trajectory.ts.time = float(k)
                    u.atoms.positions = line + rng.normal(0.0, 0.05, line.shape)
                    writer.write(group)
    return folder


def refused(outcome: object, *words: object) -> None:
    """Check that there is one sentence, with the words, and nothing else."""
    assert outcome.code == Exit.BAD_INPUT, outcome
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    assert len(lines) == 1, outcome.err
    assert lines[0].startswith("mdtopo: ")
    assert lines[0].endswith(".")
    assert "Traceback" not in outcome.err
    for word in words:
        assert str(word) in lines[0], (word, lines[0])


def test_good_files_pass(cli: Callable, files: Path) -> None:
    outcome = cli("monitor", files / "top.pdb", files / "traj.xtc", "-s", "name CA and protein", "-q")
    assert (outcome.code, outcome.out, outcome.err) == (Exit.DONE, "", "")


def test_missing_topology(cli: Callable, tmp_path: Path) -> None:
    refused(cli("monitor", tmp_path / "none.pdb"), tmp_path / "none.pdb", "does not exist")


def test_missing_trajectory(cli: Callable, files: Path) -> None:
    refused(cli("monitor", files / "top.pdb", files / "none.xtc"), "none.xtc", "does not exist")


def test_a_directory_is_no_file(cli: Callable, files: Path) -> None:
    refused(cli("monitor", files), files, "is a directory")


@pytest.mark.parametrize("name", ["bad.xtc", "bad.dcd"])
def test_garbage_trajectory(cli: Callable, files: Path, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"This is no trajectory. " * 40)
    refused(cli("monitor", files / "top.pdb", path), path, "cannot be read as a trajectory")


def test_empty_trajectory(cli: Callable, files: Path, tmp_path: Path) -> None:
    path = tmp_path / "empty.xtc"
    path.touch()
    refused(cli("monitor", files / "top.pdb", path), path)


def test_garbage_topology(cli: Callable, files: Path, tmp_path: Path) -> None:
    path = tmp_path / "bad.psf"
    path.write_text("nothing of the kind\n" * 5)
    refused(cli("monitor", path, files / "traj.xtc"), path, "cannot be read as a topology")


def test_unknown_format(cli: Callable, tmp_path: Path) -> None:
    path = tmp_path / "notes.docx"
    path.write_text("text")
    refused(cli("monitor", path), path, "Installed are: arrays")


def test_atom_counts_that_differ(cli: Callable, files: Path) -> None:
    refused(cli("monitor", files / "top.pdb", files / "few.xtc"), "few.xtc", "20 atoms", "has 31")


@pytest.mark.parametrize("selection", ["name XX", "protein and resname TIP3"])
def test_empty_selection(cli: Callable, files: Path, selection: str) -> None:
    refused(cli("monitor", files / "top.pdb", "-s", selection), repr(selection), "matches none", "mdtopo doctor")


def test_malformed_selection(cli: Callable, files: Path) -> None:
    refused(cli("monitor", files / "top.pdb", "-s", "name CA and and"), "'name CA and and'", "malformed")


def test_one_vertex_strand(cli: Callable, npz: Callable) -> None:
    path = npz(offsets=np.array([0, 7, 8]), closed=np.array([False, False]))
    refused(cli("monitor", path), "'strand 1'", "1 vertex", "at least 2")


def test_one_atom_selection(cli: Callable, files: Path) -> None:
    refused(cli("monitor", files / "top.pdb", files / "traj.xtc", "-s", "resid 3"), "A:ALA3", "at least 2")


def test_unknown_reader(cli: Callable, npz: Callable) -> None:
    refused(cli("monitor", npz(), "--reader", "floppy"), "'floppy'", "arrays", "mdanalysis")


def test_unknown_reader_option(cli: Callable, files: Path) -> None:
    refused(cli("monitor", files / "top.pdb", "--reader-option", "speed=9"), "'speed'", "dt (")


def test_wrong_value_of_a_reader_option(cli: Callable, files: Path) -> None:
    refused(cli("monitor", files / "top.pdb", "--reader-option", "dt=fast"), "'dt'", "'fast'", "a number")


@pytest.mark.parametrize("name", ["out", "alerts"])
def test_output_that_exists_is_kept(cli: Callable, npz: Callable, tmp_path: Path, name: str) -> None:
    path = tmp_path / "kept"
    path.write_text("mine")
    refused(cli("monitor", npz(), f"--{name}", path), path, "exists already", "--overwrite")
    assert path.read_text() == "mine"
    assert cli("monitor", npz(), f"--{name}", path, "--overwrite").code == Exit.DONE
    assert path.read_bytes() != b"mine"


@pytest.mark.parametrize("name", ["out", "alerts"])
def test_output_in_a_directory_that_is_missing(cli: Callable, npz: Callable, tmp_path: Path, name: str) -> None:
    path = tmp_path / "none" / "file"
    refused(cli("monitor", npz(), f"--{name}", path), path, "cannot be written")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.parametrize("name", ["out", "alerts"])
def test_output_in_a_directory_that_is_read_only(cli: Callable, npz: Callable, tmp_path: Path, name: str) -> None:
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o500)
    refused(cli("monitor", npz(), f"--{name}", folder / "file"), folder, "cannot be written")


def test_output_that_is_a_directory(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    refused(cli("monitor", npz(), "--out", tmp_path, "--overwrite"), tmp_path, "is a directory")


@pytest.mark.parametrize("name", ["out", "alerts"])
def test_an_input_is_never_overwritten(cli: Callable, npz: Callable, name: str) -> None:
    path = npz()
    before = path.read_bytes()
    refused(cli("monitor", path, f"--{name}", path, "--overwrite"), f"--{name}", path, "an input file")
    assert path.read_bytes() == before


def test_results_and_alerts_need_two_files(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    path = tmp_path / "both"
    refused(cli("monitor", npz(), "--out", path, "--alerts", path), path, "the results file")


@pytest.mark.parametrize("name", ["traj.xtc", "traj.dcd"])
def test_truncated_trajectory_keeps_what_was_read(cli: Callable, files: Path, tmp_path: Path, name: str) -> None:
    path, out = tmp_path / name, tmp_path / "run.h5"
    whole = (files / name).read_bytes()
    path.write_bytes(whole[: len(whole) * 5 // 8])
    outcome = cli("monitor", files / "top.pdb", path, "-o", out)
    assert outcome.code == Exit.BAD_INPUT
    assert "Traceback" not in outcome.err
    assert f"{out} (incomplete)" in outcome.out
    last = outcome.err.splitlines()[-1]
    for word in ("the run stopped early", str(path), "frame", str(out)):
        assert word in last
    results = mdtopo.read_results(out)
    assert not results.complete
    n_steps = len(results.steps["verdict"])
    assert 4 <= n_steps <= 7
    assert f"The {n_steps} steps before" in last


def bad_data(outcome: object, out: Path) -> tuple[list[dict], np.ndarray, list[int]]:
    """Return the bad-data alerts and the verdicts of a run that went on to its end."""
    assert outcome.code == Exit.DONE, outcome
    assert "Traceback" not in outcome.err
    alerts = [json.loads(line) for line in outcome.out.splitlines()]
    results = mdtopo.read_results(out)
    assert results.complete
    verdicts = results.steps["verdict"]
    unresolved = np.flatnonzero(verdicts == Verdict.UNRESOLVED).tolist()
    return [alert for alert in alerts if alert["kind"] == "bad-data"], verdicts, unresolved


def spoilt(npz: Callable, n_frames: int = N_FRAMES) -> np.ndarray:
    with np.load(npz("plain.npz")) as stored:
        return stored["positions"][:n_frames].copy()


def test_coordinates_that_are_not_finite(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    x, out = spoilt(npz), tmp_path / "run.h5"
    x[5, 3] = np.nan
    outcome = cli("monitor", npz(positions=x), "--alerts", "-", "-o", out)
    alerts, verdicts, unresolved = bad_data(outcome, out)
    assert unresolved == [4, 5]
    assert (verdicts[[3, 6]] == Verdict.CERTIFIED).all()
    (alert,) = alerts
    assert (alert["step_start"], alert["step_end"]) == (4, 5)
    assert "frame 5: 1 vertex has a coordinate that is not finite" in alert["message"]
    assert "the first is vertex 3" in alert["message"]
    assert "UNPROVEN" in outcome.err


def cells(value: float) -> np.ndarray:
    return np.broadcast_to(value * np.eye(3), (N_FRAMES, 3, 3)).copy()


def test_a_box_of_zeros_means_not_periodic(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    outcome = cli("monitor", npz(cell=cells(0.0)), "--alerts", "-", "-o", out)
    alerts, _, unresolved = bad_data(outcome, out)
    assert (alerts, unresolved) == ([], [])
    assert "not periodic" in outcome.err


@pytest.mark.parametrize(("first", "later"), [(50.0, 0.0), (0.0, 50.0)])
def test_a_box_that_vanishes_or_appears(
    cli: Callable, npz: Callable, tmp_path: Path, first: float, later: float
) -> None:
    boxes, out = cells(first), tmp_path / "run.h5"
    boxes[7] = later * np.eye(3)
    outcome = cli("monitor", npz(cell=boxes), "--alerts", "-", "-o", out)
    alerts, _, unresolved = bad_data(outcome, out)
    assert unresolved == [6, 7]
    (alert,) = alerts
    assert "frame 7" in alert["message"]
    assert "periodic box, unlike" in alert["message"]


def test_time_that_does_not_move_forward(cli: Callable, npz: Callable, tmp_path: Path) -> None:
    times, out = np.arange(float(N_FRAMES)), tmp_path / "run.h5"
    times[8] = times[7]
    outcome = cli("monitor", npz(time=times), "--alerts", "-", "-o", out)
    alerts, _, unresolved = bad_data(outcome, out)
    assert unresolved == [7]
    (alert,) = alerts
    assert "frame 8: time 7 ps does not come after 7 ps of frame 7" in alert["message"]
