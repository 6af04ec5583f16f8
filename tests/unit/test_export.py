"""Exports: positions, time steps, marks, and moments between frames along the certified motion."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from mdtopo.errors import OutputError
from mdtopo.export import Snapshot, in_between, whole_positions, write_pdb, write_vtkhdf, write_xyz
from mdtopo.records import Frame, Strands, Traces
from mdtopo.referee import open_step

STRANDS = Strands.from_lengths([3, 4], closed=[False, True])


def turned(x: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def frame(index: int, x: np.ndarray, cell: np.ndarray | None = None) -> Frame:
    return Frame(index, float(index), np.ascontiguousarray(x), cell)


def snapshots(n: int, scale: float = 1.0) -> list[Snapshot]:
    random = np.random.default_rng(3)
    return [
        Snapshot(f"frame {k}", 0.5 * k, scale * random.normal(size=(7, 3)), 0.25 * k, np.arange(7) == k, 1, k != 1)
        for k in range(n)
    ]


def test_a_pure_turn_is_a_turn_at_every_moment() -> None:
    x0 = np.random.default_rng(1).normal(size=(7, 3)) * 3.0
    x1 = turned(x0, 2.5) + np.array([5.0, -2.0, 1.0])
    moments = in_between(frame(0, x0), frame(1, x1), STRANDS, (), 4, rigid=True)
    assert len(moments) == 6
    np.testing.assert_allclose(moments[0], x0, atol=1e-12)
    np.testing.assert_allclose(moments[-1], x1, atol=1e-12)
    centred = x0 - x0.mean(axis=0)
    for k, found in enumerate(moments):
        expected = turned(centred, 0.5 * k) + x0.mean(axis=0) + k / 5 * (x1.mean(axis=0) - x0.mean(axis=0))
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("edge", [None, 9.0])
def test_distances_at_every_moment_are_those_of_the_path_that_the_referee_judges(
    rigid: bool, edge: float | None
) -> None:
    random = np.random.default_rng(5)
    x0 = np.cumsum(random.normal(scale=0.6, size=(7, 3)), axis=0)
    x1 = turned(x0, 0.3) + random.normal(scale=0.1, size=(7, 3)) + np.array([8.0, 0.0, 0.0])
    cell = None if edge is None else edge * np.eye(3)
    wrapped = [x if edge is None else x % edge for x in (x0, x1)]
    frames = [frame(k, x, cell) for k, x in enumerate(wrapped)]
    case = open_step(*frames, STRANDS, (), rigid=rigid, periodic=edge is not None)
    assert not isinstance(case, str)
    start, end = case.path.ends
    for k, found in enumerate(in_between(*frames, STRANDS, (), 3, rigid=rigid)):
        judged = (1 - k / 4) * start + k / 4 * end
        for x in (found, judged):
            x -= x.mean(axis=0)
        ours, theirs = (np.linalg.norm(x[:, None] - x[None], axis=2) for x in (found, judged))
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_strands_are_whole_in_their_cell() -> None:
    x = np.arange(7)[:, None] * np.array([1.0, 0.1, 0.0]) + 2.0
    found = whole_positions(frame(0, x % 4.0, 4.0 * np.eye(3)), Strands.from_lengths([7]))
    np.testing.assert_allclose(np.diff(found, axis=0), np.diff(x, axis=0), atol=1e-12)


def test_vtkhdf_holds_every_number(tmp_path: Path) -> None:
    path, given = tmp_path / "a.vtkhdf", snapshots(3)
    assert write_vtkhdf(path, STRANDS, Traces.of(STRANDS), given, ["a remark"]) == 3
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData"
        assert root.attrs["Version"].tolist() == [2, 2]
        assert root["Steps"].attrs["NSteps"] == 3
        assert root["Steps/Values"][()].tolist() == [0.0, 0.5, 1.0]
        assert root["Lines/Connectivity"][()].tolist() == [0, 1, 2, 3, 4, 5, 6, 3]
        assert root["Lines/Offsets"][()].tolist() == [0, 3, 8]
        np.testing.assert_array_equal(root["Points"][()], np.concatenate([s.positions for s in given]))
        assert root["PointData/proved"][()].tolist() == [1] * 7 + [0] * 7 + [1] * 7
        assert root["PointData/clearance"][()].tolist() == [0.0] * 7 + [0.25] * 7 + [0.5] * 7
        assert file.attrs["mdtopo"] == "a remark"


def test_vtk_reads_it_back(tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk", reason="vtk is not installed, so no other program reads the file back")
    from vtk.util.numpy_support import vtk_to_numpy

    path, given = tmp_path / "a.vtkhdf", snapshots(3)
    write_vtkhdf(path, STRANDS, Traces.of(STRANDS), given, [])
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 3
    for k, snapshot in enumerate(given):
        reader.SetStep(k)
        reader.Update()
        data = reader.GetOutput()
        assert (data.GetNumberOfLines(), reader.GetTimeValue()) == (2, snapshot.time)
        np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), snapshot.positions)
        assert set(vtk_to_numpy(data.GetPointData().GetArray("clearance"))) == {snapshot.clearance}
        assert set(vtk_to_numpy(data.GetPointData().GetArray("proved"))) == {int(snapshot.is_proved)}


def test_pdb_is_read_back_with_models_and_bonds(tmp_path: Path) -> None:
    import MDAnalysis

    path, given = tmp_path / "a.pdb", snapshots(3)
    assert write_pdb(path, STRANDS, STRANDS.edges, given, ["NOT PROVED: " + 60 * "long "]) == 3
    with MDAnalysis.Universe(str(path)).trajectory as trajectory:
        read = [step.positions.copy() for step in trajectory]
    for found, snapshot in zip(read, given, strict=True):
        np.testing.assert_allclose(found, snapshot.positions, atol=6e-4)
    lines = path.read_text().splitlines()
    assert max(map(len, lines)) <= 80
    assert sum(line.startswith("CONECT") for line in lines) == len(STRANDS.edges)
    assert [line for line in lines if line.startswith("MODEL")] == [f"MODEL     {k:4d}" for k in (1, 2, 3)]


def test_what_does_not_fit_the_columns_of_pdb_is_refused(tmp_path: Path) -> None:
    for x, fits in ((9999.99, True), (10_000.0, False), (-999.9, True), (-1000.0, False)):
        positions = np.zeros((7, 3))
        positions[3, 1] = x
        one = [replace(snapshots(1)[0], positions=positions)]
        if fits:
            write_pdb(tmp_path / "a.pdb", STRANDS, STRANDS.edges, one, [])
        else:
            with pytest.raises(OutputError, match="does not fit the columns of PDB"):
                write_pdb(tmp_path / "a.pdb", STRANDS, STRANDS.edges, one, [])


def test_xyz_keeps_every_digit_and_marks_what_is_not_proved(tmp_path: Path) -> None:
    path, given = tmp_path / "a.xyz", snapshots(2, scale=1e6)
    assert write_xyz(path, STRANDS, given) == 2
    lines = path.read_text().splitlines()
    assert ["NOT PROVED" in line for line in lines[1::9]] == [False, True]
    values = np.array([[float(word) for word in line.split()[1:]] for line in lines[2:9]])
    np.testing.assert_array_equal(values, given[0].positions)
