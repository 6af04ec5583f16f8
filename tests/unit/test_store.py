import fcntl
import json
import os
import resource
import subprocess
import sys
import tracemalloc
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdtopo.errors import AuditError, InputError, MissingFileError, OutputError
from mdtopo.records import (
    Alert,
    AlertKind,
    BrokenEdge,
    Crossings,
    Gap,
    Grade,
    MonitorConfig,
    Profile,
    ReferenceLengths,
    Severity,
    Shape,
    StepTable,
    Strands,
    Stretches,
    Verdict,
    VertexLabels,
)
from mdtopo.store import (
    SCHEMA,
    Provenance,
    ResultsWriter,
    atomic,
    collect_provenance,
    columns,
    fingerprint,
    guard,
    read_results,
    read_so_far,
    stored_tables,
    writer,
)
from mdtopo.store.schema import ALERTS, CHUNK_ROWS, CROSSINGS, OLDEST_SCHEMA, column_dtype

ROOT = Path(__file__).parents[2]
CONFIG = MonitorConfig(motion="lab", near_limit=0.7)
PROVENANCE = Provenance({"python": "3.11"}, ("mdtopo", "monitor"), (), "node7", 4, "2025-01-01T00:00:00+00:00")
STRANDS = Strands(
    offsets=np.array([0, 2, 5]),
    closed=np.array([False, True]),
    names=("α", ""),
    labels=VertexLabels(
        chain=np.array(["A", "A", "B", "B", "ß"]),
        resid=np.array([1, 2, -3, 4, 5]),
        icode=np.array(["", "A", "", "", ""]),
        resname=np.array(["GLY"] * 5),
        atom=np.array(["CA", "CA", "C4'", "C4'", "C4'"]),
        atom_index=np.array([4, 9, 14, 19, 24]),
    ),
    gaps=(Gap((1, 2), "residue 3 is missing"),),
)
ALERT = Alert(
    id="near-limit-7",
    kind=AlertKind.NEAR_LIMIT,
    severity=Severity.WARNING,
    step_start=7,
    step_peak=8,
    step_end=9,
    frame_start=7,
    frame_end=10,
    time_start=0.7,
    time_end=float("nan"),
    strands=("α", 'with "quotes", and a comma'),
    residues=(),
    value=0.85,
    limit=0.8,
    message="Step 8 uses 85 % of its limit.",
)


def step_table(n_steps, *, first_step=0, broken=(), crossings=None, seed=0):
    """Random values in every column, with a NaN and a -1 in each that can have one."""
    random = np.random.default_rng(seed)
    values_of = {}
    for column in StepTable.columns():
        shape = (n_steps, *column.shape)
        if column.enum is not None:
            values = random.choice([int(member) for member in column.enum], size=shape).astype(np.int8)
        elif column_dtype(column) == np.int64:
            values = random.integers(-1, 2**40, size=shape)
        else:
            values = np.where(random.random(shape) < 0.1, np.nan, random.normal(size=shape))
        values_of[column.name] = values
    listed = crossings if crossings is not None else Crossings.none()
    return StepTable(
        first_step, Stretches.none(), tuple(broken), ("",) * n_steps, listed, Crossings.none(), **values_of
    )


def crossings_of(*steps, seed=0):
    """One crossing in each of the steps, with random values."""
    random, n = np.random.default_rng(seed), len(steps)
    return Crossings(
        strands=STRANDS,
        step=np.array(steps, dtype=np.int64),
        frame_t0=10 * np.array(steps, dtype=np.int64),
        frame_t1=10 * np.array(steps, dtype=np.int64) + 10,
        t=random.random(n),
        edges=np.tile([[0, 1], [2, 3]], (n, 1, 1)),
        parameters=random.random((n, 2)),
        point=random.normal(size=(n, 3)),
        sign=random.choice([-1, 1], n),
        image=random.integers(-3, 4, (n, 3)),
        grade=random.choice([int(grade) for grade in Grade], n).astype(np.int8),
        object=np.zeros(n, dtype=np.int8),
        motion=random.random(n),
        resolution=random.random(n),
    )


def assert_crossings_are(found, *tables):
    for name in Crossings.column_names():
        expected = np.concatenate([getattr(table, name) for table in tables])
        assert getattr(found, name).dtype == expected.dtype, name
        assert np.array_equal(getattr(found, name), expected), name


def create(path, **how):
    return ResultsWriter.create(path, STRANDS, CONFIG, PROVENANCE, **how)


def write(path, *tables, alerts=(), reference=None, summary=None, complete=True):
    with create(path) as results:
        for table in tables:
            results.append(table)
        for alert in alerts:
            results.append_alert(alert)
        if reference is not None:
            results.add_reference(reference)
        results.finish(summary or {}, complete=complete)
    return path


def assert_steps_are(found, *tables):
    for column in StepTable.columns():
        expected = np.concatenate([getattr(table, column.name) for table in tables])
        assert found.steps[column.name].dtype == expected.dtype, column.name
        assert np.array_equal(found.steps[column.name], expected, equal_nan=column.enum is None), column.name


def names_in(directory):
    return sorted(entry.name for entry in directory.iterdir())


# what is written is what is read


def test_every_column_comes_back(tmp_path):
    table = step_table(100, first_step=12)
    found = read_results(write(tmp_path / "run.h5", table))
    assert found.first_step == 12
    assert set(found.steps) == {column.name for column in StepTable.columns()}
    assert_steps_are(found, table)


def profile_of(windows, *, seed=0):
    """One row for each window, of windows of 4 steps."""
    random, n = np.random.default_rng(seed), len(windows)
    values = random.random((n, STRANDS.n_vertices)).astype(np.float32)
    values[0, 0] = np.nan
    window = np.array(windows, dtype=np.int64)
    return Profile(4, window, 4 * window + random.integers(0, 4, n), random.random(n), values)


def assert_profile_is(found, expected):
    assert found.window_frames == expected.window_frames
    for name in ("window", "step", "least", "clearance"):
        one, other = getattr(found, name), getattr(expected, name)
        assert (one.dtype, one.tobytes()) == (other.dtype, other.tobytes()), name


def test_a_profile_comes_back_and_its_columns_say_what_they_are(tmp_path):
    profile = profile_of([0, 1, 3])
    path = write(tmp_path / "run.h5", replace(step_table(16), profile=profile))
    assert_profile_is(read_results(path).profile, profile)
    assert read_results(path, columns=["nu"]).profile is None
    (table,) = stored_tables(path)
    assert_profile_is(table.profile, profile)
    pieces = [piece.profile for piece in stored_tables(path, rows=3)]
    assert sum(map(len, pieces)) == 3 > max(map(len, pieces))
    assert_profile_is(Profile.joined(pieces), profile)
    with h5py.File(path) as file:
        assert file["profile/clearance"].dtype == np.float32
        for dataset in file["profile"].values():
            assert dataset.attrs["description"]
            assert (dataset.compression, dataset.shuffle) == ("gzip", True)


def test_a_profile_too_large_has_longer_windows_however_it_came(tmp_path, monkeypatch):
    monkeypatch.setattr("mdtopo.store.profile.MOST_VALUES", 5 * 7)  # 5 vertices, 7 windows
    monkeypatch.setattr("mdtopo.store.profile.CHUNK_VALUES", 10)
    whole, found = profile_of(range(23)), []
    for number, size in enumerate((1, 5, 23)):
        tables = [
            replace(step_table(4 * (stop - start), first_step=4 * start), profile=whole.between(4 * start, 4 * stop))
            for start in range(0, 23, size)
            for stop in [min(start + size, 23)]
        ]
        found.append(read_results(write(tmp_path / f"{number}.h5", *tables)).profile)
    assert (found[0].window_frames, len(found[0])) == (16, 6)
    for profile in found:
        assert_profile_is(profile, whole.within(5 * 7))


def test_a_file_without_a_profile_is_read(tmp_path):
    path = write(tmp_path / "run.h5", step_table(3))
    assert len(read_results(path).profile) == 0
    with h5py.File(path, "r+") as file:
        del file["profile"]
    assert read_results(path).profile is None
    assert len(next(stored_tables(path)).profile) == 0


def test_a_column_says_what_it_is(tmp_path):
    with h5py.File(write(tmp_path / "run.h5", step_table(3))) as file:
        assert set(file) == {"steps", "crossings", "alerts", "stretches", "problems", "profile", "strands"}
        for column in StepTable.columns():
            dataset = file["steps"][column.name]
            assert dataset.attrs["unit"] == column.unit
            assert dataset.attrs["description"] == column.description
            assert dataset.chunks == (CHUNK_ROWS, *dataset.shape[1:])
            assert (dataset.compression, dataset.shuffle) == ("gzip", True)
        for dataset in (*file["crossings"].values(), *file["alerts"].values(), *file["strands"].values()):
            assert dataset.attrs["description"]


def test_codes_are_hdf5_enums(tmp_path):
    with h5py.File(write(tmp_path / "run.h5", step_table(3))) as file:
        names = {column.name: column.enum for column in StepTable.columns() if column.enum}
        assert {"verdict", "rung", "reason", "nu_class"} <= set(names)
        for name, enum in names.items():
            dataset = file["steps"][name]
            assert h5py.check_enum_dtype(dataset.dtype) == {member.name: member.value for member in enum}
            assert dataset.dtype == np.int8
        assert h5py.check_enum_dtype(file["steps/verdict"].dtype)["CERTIFIED"] == Verdict.CERTIFIED


def test_crossings_come_back(tmp_path):
    tables = [crossings_of(0, 2, 2), crossings_of(seed=1), crossings_of(4, 7, seed=2)]
    steps = [step_table(3, crossings=tables[0]), step_table(1, first_step=3), step_table(5, first_step=4)]
    steps[2] = replace(steps[2], crossings=tables[2])
    path = write(tmp_path / "run.h5", *steps)
    found = read_results(path).crossings
    assert_crossings_are(found, *tables)
    assert [crossing.step for crossing in found.of_step(2)] == [2, 2]
    assert found[0].strands == ("α", "")
    assert found[0].residues == ("A:GLY1-GLY2A", "B:GLY-3-GLY4")
    with h5py.File(path) as file:
        group = file["crossings"]
        assert list(CROSSINGS) == list(Crossings.column_names())
        assert set(group) == set(CROSSINGS)
        for name, enum in (("grade", Grade), ("object", Shape)):
            assert h5py.check_enum_dtype(group[name].dtype) == {member.name: member.value for member in enum}
        units = {name for name, dataset in group.items() if dataset.attrs["unit"] == "Å"}
        assert units == {"point", "motion", "resolution"}


def test_crossings_beyond_a_chunk_are_written_as_they_come(tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "CHUNK_ROWS", 4)
    tables = [crossings_of(k, k, k, seed=k) for k in range(5)]
    with create(tmp_path / "run.h5") as results:
        for k, crossings in enumerate(tables):
            results.append(step_table(1, first_step=k, crossings=crossings))
        (partial,) = tmp_path.iterdir()
        assert partial.stat().st_size > 0
        results.finish({})
    assert_crossings_are(read_results(tmp_path / "run.h5").crossings, *tables)


def test_a_run_without_crossings_and_a_file_without_their_group(tmp_path):
    path = write(tmp_path / "run.h5", step_table(2))
    assert len(read_results(path).crossings) == 0
    with h5py.File(path, "a") as file:
        del file["crossings"]
        del file.attrs["request"]
    found = read_results(path)
    assert len(found.crossings) == 0
    assert found.request == {}


def test_alerts_come_back_with_the_fields_of_the_json_lines(tmp_path):
    bare = replace(
        ALERT,
        id="x",
        kind=AlertKind.BAD_DATA,
        severity=Severity.CRITICAL,
        value=None,
        limit=None,
        time_start=1.0,
        time_end=2.0,
    )
    path = write(tmp_path / "run.h5", alerts=[ALERT, bare])
    first, second = read_results(path).alerts
    assert second == bare
    assert np.isnan(first.time_end)
    assert replace(first, time_end=0.0) == replace(ALERT, time_end=0.0)
    with h5py.File(path) as file:
        assert file["alerts"].attrs["schema"] == "mdtopo.alert/1"
        assert {"schema", *file["alerts"]} == set(ALERT.to_mapping())
        assert file["alerts/severity"].asstr()[0] == ALERT.to_mapping()["severity"]
        assert json.loads(file["alerts/strands"].asstr()[0]) == list(ALERT.strands)
    assert set(ALERTS) == {entry.name for entry in fields(Alert)}


def test_text_that_hdf5_does_not_take_is_written_out(tmp_path):
    alert = replace(ALERT, message="run\udcff.xtc ends\0", time_end=1.0)
    (found,) = read_results(write(tmp_path / "run.h5", alerts=[alert])).alerts
    assert found.message == "run\\udcff.xtc ends\\0"


def test_strands_come_back(tmp_path):
    found = read_results(write(tmp_path / "run.h5")).strands
    assert found.offsets.tolist() == [0, 2, 5]
    assert found.closed.dtype == np.bool_
    assert found.closed.tolist() == [False, True]
    assert (found.names, found.gaps) == (STRANDS.names, STRANDS.gaps)
    for entry in fields(VertexLabels):
        assert getattr(found.labels, entry.name).tolist() == getattr(STRANDS.labels, entry.name).tolist()
    with h5py.File(tmp_path / "run.h5") as file:
        assert file["strands/vertex_label"].asstr()[:].tolist() == [
            "A:GLY1",
            "A:GLY2A",
            "B:GLY-3",
            "B:GLY4",
            "ß:GLY5",
        ]


def test_strands_without_labels_and_gaps_come_back(tmp_path):
    with ResultsWriter.create(tmp_path / "run.h5", Strands.from_lengths([3]), CONFIG, PROVENANCE) as results:
        results.finish({})
    found = read_results(tmp_path / "run.h5").strands
    assert (found.gaps, found.labels.chain.tolist(), found.labels.text(2)) == ((), ["", "", ""], "2")


def test_reference_lengths_and_broken_edges_come_back(tmp_path):
    reference = ReferenceLengths(np.array([3.8, 3.7, 3.9, 4.0]), median=3.8, spread=0.1, n_frames=10)
    broken = [BrokenEdge(3, 4, (2, 3), 1.7, 1.5), BrokenEdge(9, 10, (4, 2), 2.5, 1.5)]
    tables = [step_table(5, broken=broken[:1]), step_table(5, first_step=5, broken=broken[1:])]
    found = read_results(write(tmp_path / "run.h5", *tables, reference=reference))
    assert found.broken == tuple(broken)
    assert found.reference.lengths.tolist() == reference.lengths.tolist()
    assert (found.reference.median, found.reference.spread, found.reference.n_frames) == (3.8, 0.1, 10)
    with h5py.File(tmp_path / "run.h5") as file:
        assert file["strands/edge"][:].tolist() == STRANDS.edges.tolist()
        assert file["strands/reference_length"].attrs["unit"] == "Å"


def test_a_file_without_steps_is_whole(tmp_path):
    found = read_results(write(tmp_path / "run.h5"))
    assert (found.complete, found.alerts, found.broken, found.reference) == (True, (), (), None)
    assert {len(values) for values in found.steps.values()} == {0}
    assert found.steps["nu_pair"].shape == (0, 2, 2)


def test_attributes_come_back(tmp_path):
    many = replace(PROVENANCE, argv=("part.xtc",) * 20_000)  # beyond the 64 KiB that HDF5 keeps in an object header
    request = {"select": "name CA", "frames": [0, None, 2], "reader": None, "reader_options": {"dt": Path("x")}}
    with ResultsWriter.create(tmp_path / "run.h5", STRANDS, CONFIG, many, request=request) as results:
        results.finish({"crossed": 2, "results": Path("run.h5")})
    found = read_results(tmp_path / "run.h5")
    assert found.schema == SCHEMA == 1
    assert MonitorConfig.from_mapping(found.config) == CONFIG
    assert found.summary == {"crossed": 2, "results": "run.h5"}
    assert found.request == {**request, "reader_options": {"dt": "x"}}
    assert (found.provenance["host"], len(found.provenance["argv"])) == ("node7", 20_000)
    assert found.provenance["started"] < found.provenance["ended"]


def test_chosen_columns_alone_are_read(tmp_path):
    path = write(tmp_path / "run.h5", step_table(3))
    assert set(read_results(path, columns=["verdict", "clearance"]).steps) == {"verdict", "clearance"}
    with pytest.raises(InputError, match=r"no step column 'clearnce'; it has .*clearance"):
        read_results(path, columns=["clearnce"])


@pytest.mark.parametrize(
    ("wanted", "read"),
    [(range(7, 9), range(7, 9)), (range(6), range(5, 6)), (range(11, 99), range(11, 12)), (range(99), range(5, 12)),
     (range(3), range(5, 5)), (range(20, 21), range(12, 12)), (range(8, 8), range(8, 8))],
)  # fmt: skip
def test_chosen_steps_alone_are_read(tmp_path, wanted, read):
    table = step_table(7, first_step=5)
    found = read_results(write(tmp_path / "run.h5", table), steps=wanted)
    assert (found.first_step, found.n_steps, found.stored) == (read.start, len(read), range(5, 12))
    for column in StepTable.columns():
        expected = getattr(table, column.name)[read.start - 5 : read.stop - 5]
        assert np.array_equal(found.steps[column.name], expected, equal_nan=column.enum is None), column.name


def test_chosen_steps_are_read_from_finished_parts(tmp_path):
    folder = tmp_path / "run.h5.parts"
    folder.mkdir()
    tables = [step_table(4), step_table(3, first_step=4), step_table(2, first_step=7)]
    for table in tables:
        write(folder / f"part-{table.first_step:010d}.h5", table)
    whole = read_so_far(tmp_path / "run.h5")
    assert (whole.first_step, whole.n_steps, whole.stored, whole.in_progress) == (0, 9, range(9), True)
    for wanted in (range(5, 6), range(3, 8), range(8, 20)):
        found = read_so_far(tmp_path / "run.h5", columns=["clearance"], steps=wanted)
        rows = slice(wanted.start, min(wanted.stop, 9))
        assert (found.first_step, found.stored, set(found.steps)) == (wanted.start, range(9), {"clearance"})
        np.testing.assert_array_equal(found.steps["clearance"], whole.steps["clearance"][rows])
    assert read_so_far(tmp_path / "run.h5", steps=range(50, 51)).n_steps == 0


@settings(max_examples=25)  # each one is a file
@given(st.lists(st.integers(0, 30), max_size=8))
def test_blocks_of_any_size_give_the_same_rows(tmp_path_factory, sizes):
    directory = tmp_path_factory.mktemp("blocks")
    starts = np.cumsum([0, *sizes])
    tables = [step_table(n, first_step=int(s), seed=k) for k, (n, s) in enumerate(zip(sizes, starts, strict=False))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(columns, "CHUNK_ROWS", 16)
        found = read_results(write(directory / "run.h5", *tables))
    assert_steps_are(found, step_table(0), *tables)


def test_rows_beyond_a_chunk_are_kept(tmp_path):
    tables = [step_table(3000, first_step=3000 * k, seed=k) for k in range(3)]
    alerts = [replace(ALERT, id=str(k), time_end=1.0) for k in range(CHUNK_ROWS + 5)]
    found = read_results(write(tmp_path / "run.h5", *tables, alerts=alerts))
    assert_steps_are(found, *tables)
    assert found.alerts == tuple(alerts)


def test_equal_runs_write_equal_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(Provenance, "ended_now", lambda self: self)
    one, other = (write(tmp_path / name, step_table(50), alerts=[ALERT]) for name in ("one.h5", "other.h5"))
    assert one.read_bytes() == other.read_bytes()
    with h5py.File(one) as file:
        times = []
        file.visititems(lambda name, _: times.append(h5py.h5g.get_objinfo(file.id, name.encode()).mtime))
        assert set(times) == {0}


def test_memory_does_not_grow_with_the_steps(tmp_path):
    def peak(n_blocks):
        table = step_table(512)
        tracemalloc.start()
        with create(tmp_path / f"{n_blocks}.h5") as results:
            for k in range(n_blocks):
                results.append(replace(table, first_step=512 * k))
            results.finish({})
        _, high = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return high

    assert peak(64) < 1.05 * peak(16)


# the file's name, and what may go wrong


def test_nobody_meets_half_a_file(tmp_path):
    results = create(tmp_path / "run.h5")
    results.append(step_table(3))
    (partial,) = names_in(tmp_path)
    assert partial.startswith(f".run.h5.{os.getpid()}.")
    assert partial.endswith(".partial")
    results.finish({})
    assert names_in(tmp_path) == ["run.h5"]


def test_complete_is_written_last(tmp_path, monkeypatch):
    seen = []
    flush = ResultsWriter._flush
    monkeypatch.setattr(
        ResultsWriter, "_flush", lambda self: (flush(self), seen.append(bool(self._file.attrs["complete"])))
    )
    write(tmp_path / "run.h5", step_table(3))
    assert seen
    assert not any(seen)
    assert read_results(tmp_path / "run.h5").complete


def test_a_run_that_stops_early_keeps_its_rows(tmp_path):
    table = step_table(5)
    found = read_results(write(tmp_path / "run.h5", table, complete=False))
    assert not found.complete
    assert_steps_are(found, table)


def test_a_run_that_fails_keeps_its_rows(tmp_path):
    table = step_table(5)

    def run():
        with create(tmp_path / "run.h5") as results:
            results.append(table)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    found = read_results(tmp_path / "run.h5")
    assert not found.complete
    assert_steps_are(found, table)
    assert names_in(tmp_path) == ["run.h5"]


def test_a_run_that_fails_before_its_first_step_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError), create(tmp_path / "run.h5"):
        raise RuntimeError
    assert names_in(tmp_path) == []


def test_abort_removes_the_temporary_file(tmp_path):
    results = create(tmp_path / "run.h5")
    results.append(step_table(5))
    results.abort()
    results.abort()
    assert names_in(tmp_path) == []
    with pytest.raises(ValueError, match="not being written any more"):
        results.append(step_table(5))


def test_abort_after_finish_keeps_the_file(tmp_path):
    results = create(tmp_path / "run.h5")
    results.finish({})
    results.abort()
    assert names_in(tmp_path) == ["run.h5"]


def test_steps_must_follow_each_other(tmp_path):
    with create(tmp_path / "run.h5") as results:
        results.append(step_table(5, first_step=10))
        with pytest.raises(AuditError, match="Step 16 was to be stored where step 15 belongs"):
            results.append(step_table(5, first_step=16))
        with pytest.raises(AuditError, match="Step 14 "):
            results.append(step_table(5, first_step=14))
        results.append(step_table(5, first_step=15))
        results.finish({})


def test_a_column_of_a_wrong_shape_is_refused(tmp_path):
    with create(tmp_path / "run.h5") as results, pytest.raises(AuditError, match=r"nu_pair has shape \(5,\)"):
        results.append(replace(step_table(5), nu_pair=np.zeros(5, dtype=np.int64)))


def test_an_existing_file_is_kept(tmp_path):
    (tmp_path / "run.h5").write_text("precious")
    with pytest.raises(OutputError, match=r"run\.h5 exists already; give --overwrite .* or another name"):
        create(tmp_path / "run.h5")
    assert names_in(tmp_path) == ["run.h5"]
    assert (tmp_path / "run.h5").read_text() == "precious"


def test_overwriting_replaces_the_file_at_the_end(tmp_path):
    (tmp_path / "run.h5").write_text("old")
    with create(tmp_path / "run.h5", overwrite=True) as results:
        assert (tmp_path / "run.h5").read_text() == "old"
        results.finish({})
    assert read_results(tmp_path / "run.h5").complete


def test_a_file_that_appears_meanwhile_is_kept(tmp_path):
    with create(tmp_path / "run.h5") as results:
        (tmp_path / "run.h5").write_text("precious")
        with pytest.raises(OutputError, match="appeared while this run was going on") as caught:
            results.finish({})
    assert (tmp_path / "run.h5").read_text() == "precious"
    (partial,) = tmp_path.glob(".run.h5.*.partial")
    assert str(partial) in str(caught.value)
    assert read_results(partial).complete


def test_the_target_is_looked_at_first(tmp_path, monkeypatch):
    with pytest.raises(OutputError, match="is a directory"):
        create(tmp_path)
    with pytest.raises(OutputError, match=r"the directory .*nowhere does not exist"):
        create(tmp_path / "nowhere" / "run.h5")
    with pytest.raises(OutputError, match="too long"):
        create(tmp_path / ("x" * 250))
    # a test may run as root, who may write everywhere
    monkeypatch.setattr(atomic.os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match="does not allow it"):
        create(tmp_path / "run.h5")


def test_a_file_gets_the_permissions_of_any_other(tmp_path):
    write(tmp_path / "run.h5")
    (tmp_path / "other").touch()
    assert (tmp_path / "run.h5").stat().st_mode == (tmp_path / "other").stat().st_mode


@pytest.mark.parametrize("n_steps", [1, 3 * CHUNK_ROWS])
@pytest.mark.parametrize("room", [0, 300_000])
def test_a_full_disk(tmp_path, monkeypatch, room, n_steps):
    def write_or_fail(descriptor, data, offset):
        if offset + len(data) > room:
            raise OSError(28, "No space left on device")
        return os_pwrite(descriptor, data, offset)

    os_pwrite = os.pwrite
    monkeypatch.setattr(guard.os, "pwrite", write_or_fail)
    if (room, n_steps) == (300_000, 1):
        write(tmp_path / "run.h5", step_table(n_steps))  # the near miss: there is room for a small file
        return
    with pytest.raises(OutputError, match=r"run\.h5 cannot be written \(No space left on device\)"):
        write(tmp_path / "run.h5", step_table(n_steps))
    assert names_in(tmp_path) == []


def test_a_disk_that_fails_at_the_last_moment(tmp_path, monkeypatch):
    def fail(descriptor):
        raise OSError(122, "Disk quota exceeded")

    monkeypatch.setattr(writer.os, "fsync", fail)
    with pytest.raises(OutputError, match="Disk quota exceeded"):
        write(tmp_path / "run.h5", step_table(3))
    assert names_in(tmp_path) == []


def test_a_real_limit_ends_in_an_error_and_not_in_a_crash(tmp_path):
    code = (
        "import sys; sys.path[:0] = [sys.argv[1]]\n"
        "from test_store import *\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))\n"
        "try:\n"
        "    write(Path(sys.argv[2]), step_table(3 * CHUNK_ROWS))\n"
        "except OutputError as error:\n"
        "    print(error)\n"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent), str(tmp_path / "run.h5")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{tmp_path / 'run.h5'} cannot be written (File too large).\n"
    assert names_in(tmp_path) == []
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != 200_000


def test_the_guard_reads_back_what_it_could_not_write(tmp_path, monkeypatch):
    descriptor = os.open(tmp_path / "file", os.O_RDWR | os.O_CREAT)
    file = guard.GuardedFile(descriptor)
    file.write(b"abcdef")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(guard.os, "pwrite", fail)
    file.seek(4)
    file.write(b"XYZ")
    file.seek(2)
    assert file.read(7) == b"cdXYZ\0\0"
    assert file.error.errno == 28
    assert file.seek(0, os.SEEK_END) == 9 - 2
    os.close(descriptor)
    assert (tmp_path / "file").read_bytes() == b"abcdef"


# files that are no results


def test_a_missing_file(tmp_path):
    with pytest.raises(MissingFileError, match="does not exist"):
        read_results(tmp_path / "run.h5")


@pytest.mark.parametrize("content", [b"", b"\x89HDF", b"text"])
def test_a_file_that_is_not_hdf5(tmp_path, content):
    (tmp_path / "run.h5").write_bytes(content)
    with pytest.raises(InputError, match="is not an HDF5 file"):
        read_results(tmp_path / "run.h5")
    with pytest.raises(InputError, match="cannot be read"):
        read_results(tmp_path)


@pytest.mark.parametrize("part", [0.01, 0.5, 0.99])
def test_a_truncated_file(tmp_path, part):
    path = write(tmp_path / "run.h5", step_table(100))
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    with pytest.raises(InputError, match="is truncated or damaged"):
        read_results(path)


def test_an_hdf5_file_of_someone_else(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1.0]
    with pytest.raises(InputError, match="not a results file of mdtopo"):
        read_results(tmp_path / "other.h5")


def test_a_newer_schema_is_refused_with_both_numbers(tmp_path):
    path = write(tmp_path / "run.h5", step_table(1))
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = SCHEMA + 1
    with pytest.raises(InputError, match=r"has schema 2, and this mdtopo reads up to 1; use a newer mdtopo"):
        read_results(path)


def test_an_older_schema_is_refused_with_both_numbers(tmp_path):
    path = write(tmp_path / "run.h5", step_table(1))
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = OLDEST_SCHEMA - 1
    with pytest.raises(InputError, match=r"has schema 0, and this mdtopo reads from 1 on; run 'mdtopo monitor' again"):
        read_results(path)


@pytest.mark.parametrize("lost", ["steps", "alerts/kind", "strands/offsets"])
def test_a_file_that_lacks_something(tmp_path, lost):
    path = write(tmp_path / "run.h5", step_table(1))
    with h5py.File(path, "r+") as file:
        del file[lost]
    with pytest.raises(InputError, match="is truncated or damaged"):
        read_results(path)


def test_a_file_may_be_read_while_it_is_locked(tmp_path):
    path = write(tmp_path / "run.h5", step_table(1))
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(OSError, match="unable to lock file"):
            h5py.File(path, "r", locking=True)
        assert read_results(path).complete


# provenance


def test_a_run_says_where_it_comes_from(tmp_path):
    (tmp_path / "a.pdb").write_text("ATOM")
    found = collect_provenance([tmp_path / "a.pdb"], argv=["mdtopo"], threads=3)
    assert found.versions["numpy"] == np.__version__
    assert found.versions["python"] == ".".join(map(str, sys.version_info[:3]))
    assert (found.threads, found.argv, found.ended) == (3, ("mdtopo",), None)
    assert [file.path for file in found.inputs] == [str(tmp_path / "a.pdb")]
    assert found.ended_now().ended >= found.started
    json.dumps(found.to_mapping())


def test_the_hash_is_that_of_size_head_and_tail(tmp_path):
    # sha256 of "4" + "ATOM" + "ATOM": a small file is its own head and tail
    (tmp_path / "a").write_text("ATOM")
    expected = subprocess.run(["sha256sum"], input=b"4ATOMATOM", capture_output=True, check=True).stdout[:64]
    assert fingerprint(tmp_path / "a").sha256_of_size_and_first_and_last_mebibyte == expected.decode()


@pytest.mark.parametrize(
    ("place", "is_seen"),
    [(0, True), (2**20 - 1, True), (2**20, False), (2**21 - 1, False), (2**21, True), (-1, True)],
)
def test_a_change_of_head_or_tail_changes_the_hash(tmp_path, place, is_seen):
    content = bytearray(3 * 2**20)
    (tmp_path / "a").write_bytes(content)
    before = fingerprint(tmp_path / "a")
    content[place] = 1
    (tmp_path / "a").write_bytes(content)
    after = fingerprint(tmp_path / "a")
    hashes = {file.sha256_of_size_and_first_and_last_mebibyte for file in (before, after)}
    assert (len(hashes) == 2) is is_seen
    assert (before.size, before.path) == (3 * 2**20, after.path)


def test_an_input_that_vanished(tmp_path):
    with pytest.raises(InputError, match=r"gone cannot be read \(No such file"):
        fingerprint(tmp_path / "gone")


def test_nothing_heavy_is_imported_for_the_versions():
    code = (
        "import sys; from mdtopo.store import collect_provenance\n"
        "collect_provenance([], argv=[], threads=1); print('MDAnalysis' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_a_path_may_be_text(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"run\.h5"):
        read_results(str(tmp_path / "run.h5"))
