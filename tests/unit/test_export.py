"""Exports: positions, time steps, marks, and moments between frames along the certified motion."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from mdtopo.errors import InputError, OutputError
from mdtopo.export import (
    CurveSnapshot,
    Snapshot,
    curve_snapshot,
    in_between,
    vertex_bounds,
    whole_positions,
    write_curve_pdb,
    write_curve_vtkhdf,
    write_curve_xyz,
    write_pdb,
    write_vtkhdf,
    write_xyz,
)
from mdtopo.pipeline import step_tables
from mdtopo.readers import ReaderRequest, Source, open_reader
from mdtopo.records import Frame, MonitorConfig, Strands, Traces
from mdtopo.records.profile import rounded_down
from mdtopo.referee import open_step

STRANDS = Strands.from_lengths([3, 4], closed=[False, True])


def turned(x: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def frame(index: int, x: np.ndarray, cell: np.ndarray | None = None) -> Frame:
    return Frame(index, float(index), np.ascontiguousarray(x), cell)


def curve(tolerance: float, broken: tuple[int, ...] = (), time: float = 0.5) -> CurveSnapshot:
    """A bent strand and a square ring beside it, 3 Å away."""
    x = np.array([[0, 0, 3.0], [1, 0, 3], [1, 1, 3.5], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    traces = Traces.of(STRANDS, broken)
    about = {"title": "frame 4", "time": time, "polyline_clearance": 1.5 + np.arange(7)}
    return curve_snapshot(x, STRANDS, traces, "interpolating", tolerance, **about)


def snapshots(n: int, scale: float = 1.0) -> list[Snapshot]:
    random = np.random.default_rng(3)
    return [
        Snapshot(
            f"frame {k}",
            0.5 * k,
            scale * random.normal(size=(7, 3)),
            0.25 * k + np.arange(7),
            np.arange(7) == k,
            1,
            k != 1,
        )
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
        assert root["PointData/clearance"][()].tolist() == [0.25 * k + v for k in range(3) for v in range(7)]
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
        np.testing.assert_array_equal(vtk_to_numpy(data.GetPointData().GetArray("clearance")), snapshot.clearance)
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


def test_the_polyline_of_a_curve_passes_the_vertices_of_its_strands_closely() -> None:
    found = curve(0.01)
    assert found.is_isotopic
    assert found.chord_error <= 0.01
    assert found.closed.tolist() == [False, True]
    first, ring = np.split(found.positions, found.offsets[1:-1])
    assert first[0].tolist() == [0.0, 0.0, 3.0]
    assert first[-1].tolist() == [1.0, 1.0, 3.5]
    assert ring[0].tolist() == [0.0, 0.0, 0.0]
    assert ring[-1].tolist() != [0.0, 0.0, 0.0]  # the ring's repeated point is left out
    # by hand: the periodic spline through the corners of the unit square bulges by 3/16 at the middle of an edge
    bulge = np.linalg.norm(ring - [0.5, -0.1875, 0.0], axis=1)
    assert bulge.min() < 0.15
    assert ring[:, 1].min() == pytest.approx(-0.1875, abs=0.02)
    assert found.strand.tolist() == [0] * len(first) + [1] * len(ring)
    assert len(curve(0.001).positions) > 2 * len(found.positions)


def test_a_polyline_that_leaves_the_tube_is_not_called_isotopic() -> None:
    x = np.array([[0, 0, 0.0], [1, 0, 0], [2, 0, 0.004], [0.5, -1, 0], [0.5, 0, 0.01], [0.5, 1, 0], [0.5, 1, 1]])
    strands = Strands.from_lengths([3, 4])
    about = {"title": "frame 0", "time": 0.0, "polyline_clearance": np.full(7, np.nan)}
    far = curve_snapshot(x, strands, Traces.of(strands), "interpolating", 0.1, **about)
    near = curve_snapshot(x, strands, Traces.of(strands), "interpolating", 1e-4, **about)
    assert (far.is_isotopic, near.is_isotopic) == (False, True)
    assert "whose tube has the radius" in far.reason


def test_a_point_of_a_curve_has_the_lower_value_of_the_two_vertices_about_it() -> None:
    found = curve(0.01)  # the vertices have 1.5, 2.5 … 7.5
    first = found.parameter[: found.offsets[1]]
    expected = np.where(first < 0.5, 1.5, 2.5)
    expected[-1] = 3.5
    assert (first[0], first[-1]) == (0.0, 1.0)  # there it is the vertex's own
    assert found.polyline_clearance[: found.offsets[1]].tolist() == expected.tolist()
    ring = found.parameter[found.offsets[1] :]
    inside = np.flatnonzero((ring > 0.75) & (ring < 1.0))  # from the last vertex to the first
    assert len(inside)
    assert set(found.polyline_clearance[found.offsets[1] + inside].tolist()) == {4.5}
    broken = curve(0.01, broken=(0, 3))
    assert broken.polyline_clearance[0] == 2.5  # the vertex without an edge has no point


def test_the_bounds_of_vertices_are_those_of_a_run() -> None:
    random = np.random.default_rng(5)
    x0 = np.cumsum(random.normal(scale=0.6, size=(7, 3)), axis=0)
    for edge, rigid in ((None, True), (None, False), (9.0, True)):
        cell = None if edge is None else edge * np.eye(3)
        x1 = turned(x0, 0.1) + random.normal(scale=0.05, size=(7, 3))
        frames = [frame(k, x if edge is None else x % edge, cell) for k, x in enumerate((x0, x1))]
        config = MonitorConfig(motion="rigid" if rigid else "lab", profile_steps=1)
        options = {} if cell is None else {"cell": cell}
        request = ReaderRequest(strands=STRANDS, options=options)
        with open_reader(Source(object=np.stack([f.positions for f in frames])), request) as reader:
            table = next(step_tables(reader, config=config))
        found = vertex_bounds(*frames, STRANDS, (), float(table.clearance[0]), rigid=rigid)
        assert table.profile.clearance[0].tolist() == rounded_down(found).tolist()
        assert found.min() == table.clearance[0]


def test_broken_edges_end_the_curve_and_lone_vertices_have_none() -> None:
    found = curve(0.01, broken=(0, 3))  # 0-1 of the strand, 4-5 of the ring
    assert found.closed.tolist() == [False, False]
    first, opened = np.split(found.positions, found.offsets[1:-1])
    assert (first[0].tolist(), first[-1].tolist()) == ([1.0, 0.0, 3.0], [1.0, 1.0, 3.5])
    assert (opened[0].tolist(), opened[-1].tolist()) == ([1.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    assert found.strand.tolist() == [0] * len(first) + [1] * len(opened)
    with pytest.raises(InputError, match="every edge is broken"):
        curve(0.01, broken=tuple(range(6)))


def test_a_frame_without_a_curve_is_named() -> None:
    x = np.zeros((7, 3))
    about = {"title": "frame 4", "time": 0.0, "polyline_clearance": np.full(7, np.nan)}
    with pytest.raises(InputError, match=r"curve of frame 4 cannot be exported\. Vertices 0 and 1 follow"):
        curve_snapshot(x, STRANDS, Traces.of(STRANDS), "interpolating", 0.1, **about)
    with pytest.raises(InputError, match="points of a ring in frame 4; choose a smaller one"):
        curve(100.0)


def test_vtk_reads_curves_whose_points_and_lines_differ_in_number(tmp_path: Path) -> None:
    path, given = tmp_path / "a.vtkhdf", [curve(0.1), curve(0.001, time=1.0), curve(0.02, (0, 3), time=1.5)]
    assert write_curve_vtkhdf(path, given, ["a remark"]) == 3
    with h5py.File(path) as file:
        assert file["VTKHDF/NumberOfPoints"][()].tolist() == [len(s.positions) for s in given]
        assert file["VTKHDF/Steps/PartOffsets"][()].tolist() == [0, 1, 2]
    vtk = pytest.importorskip("vtk", reason="vtk is not installed, so no other program reads the file back")
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    for k in (2, 0, 1):
        reader.SetStep(k)
        reader.Update()
        data, snapshot = reader.GetOutput(), given[k]
        assert (data.GetNumberOfLines(), reader.GetTimeValue()) == (2, snapshot.time)
        np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), snapshot.positions)
        lines = np.split(
            vtk_to_numpy(data.GetLines().GetConnectivityArray()), vtk_to_numpy(data.GetLines().GetOffsetsArray())[1:-1]
        )
        for line, ring, start, stop in zip(
            lines, snapshot.closed, snapshot.offsets[:-1], snapshot.offsets[1:], strict=True
        ):
            assert line.tolist() == [*range(start, stop), *([start] if ring else [])]
        for name in ("strand", "parameter", "isotopic", "chord_error", "polyline_clearance"):
            wanted = snapshot.is_isotopic if name == "isotopic" else getattr(snapshot, name)
            found = vtk_to_numpy(data.GetPointData().GetArray(name))
            np.testing.assert_array_equal(found, np.broadcast_to(wanted, len(snapshot.positions)))


def test_text_says_whether_the_polyline_is_isotopic_to_its_curve(tmp_path: Path) -> None:
    sure = curve(0.01)
    doubtful = replace(sure, is_isotopic=False, reason="a reason")
    assert write_curve_xyz(tmp_path / "a.xyz", [sure, doubtful, curve(0.1)]) == 3
    lines, start, heads = (tmp_path / "a.xyz").read_text().splitlines(), 0, []
    while start < len(lines):
        heads.append(lines[start + 1])
        start += int(lines[start]) + 2
    assert ["NOT KNOWN" in head for head in heads] == [False, True, False]
    assert f"{sure.offsets[1]} open, {np.diff(sure.offsets)[1]} closed" in heads[0]
    for one, told in ((sure, False), (doubtful, True)):
        assert write_curve_pdb(tmp_path / "a.pdb", one, ["a remark"]) == 1
        text = (tmp_path / "a.pdb").read_text()
        assert ("NOT KNOWN" in text) is told
        assert "?" not in text
        assert text.count("CONECT") == len(one.positions) - 1
