"""The MDAnalysis adapter gives the bits of a serial run, on every backend and for every choice of frames."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import MDAnalysis
import numpy as np
import pytest
from MDAnalysis.coordinates.memory import MemoryReader

from mdtopo import IsotopyAnalysis, MonitorConfig, Scope, steps
from mdtopo.analysis import ClusterBackend
from mdtopo.errors import ClusterError
from mdtopo.pipeline import step_tables
from mdtopo.readers import Reader, ReaderRequest, Source, open_reader
from mdtopo.records import RunVerdict, StepTable

N_FRAMES = 23
CHOICES = {
    "all": {},
    "slice": {"start": 2, "stop": 20, "step": 3},
    "list": {"frames": [0, 1, 4, 5, 9, 10, 11, 22]},
    "mask": {"frames": np.arange(N_FRAMES) % 2 == 0},
    "one frame": {"start": 4, "stop": 5},
    "no frame": {"start": 4, "stop": 4},
}
BACKENDS = {
    "two processes": {"backend": "multiprocessing", "n_workers": 2},
    "five parts": {"backend": "multiprocessing", "n_workers": 2, "n_parts": 5},
    "a part for each frame": {"backend": "multiprocessing", "n_workers": 2, "n_parts": N_FRAMES},
}


def universe(*, breaks_at: int | None = None, bad_frame: int | None = None) -> MDAnalysis.Universe:
    """Two chains of ten beads that jiggle; one bond of the first grows from a frame on."""
    rng = np.random.default_rng(7)
    rest = np.zeros((20, 3))
    rest[:10, 0] = rest[10:, 0] = 3.8 * np.arange(10)
    rest[10:, 1] = 6.0
    frames = rest + rng.normal(scale=0.2, size=(N_FRAMES, 20, 3)).cumsum(axis=0) * 0.3
    if breaks_at is not None:
        stretch = np.clip(np.arange(N_FRAMES) - breaks_at + 1, 0, None)
        frames[:, 5:10, 0] += 4.0 * stretch[:, np.newaxis]
    if bad_frame is not None:
        frames[bad_frame, 3] = np.nan
    top = MDAnalysis.Universe.empty(20, n_residues=20, atom_resindex=np.arange(20), trajectory=True)
    top.add_TopologyAttr("bonds", [(i, i + 1) for i in range(19) if i != 9])
    top.load_new(frames.astype(np.float32), format=MemoryReader, dt=1.0)
    return top


def same(first: StepTable, second: StepTable) -> bool:
    columns = [column.name for column in StepTable.columns()]
    equal = [np.array_equal(getattr(first, c), getattr(second, c), equal_nan=True) for c in columns]
    one, other = first.crossings, second.crossings
    equal += [np.array_equal(getattr(one, c), getattr(other, c)) for c in one.column_names()]
    return all(equal) and first.broken == second.broken and first.problems == second.problems


@pytest.fixture(scope="module")
def intact() -> MDAnalysis.Universe:
    return universe()


@pytest.mark.parametrize("choice", CHOICES)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("breaks_at", [None, 0, 6, 13])
def test_every_backend_gives_the_bits_of_a_serial_run(choice: str, backend: str, breaks_at: int | None) -> None:
    atoms = universe(breaks_at=breaks_at, bad_frame=9).atoms
    serial = IsotopyAnalysis(atoms).run(**CHOICES[choice])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Set `n_parts` to")
        parallel = IsotopyAnalysis(atoms).run(**CHOICES[choice], **BACKENDS[backend])
    assert same(parallel.results.steps, serial.results.steps)
    assert parallel.results.alerts == serial.results.alerts
    assert parallel.results.summary.to_mapping() == serial.results.summary.to_mapping()


def test_dask_gives_the_bits_of_a_serial_run() -> None:
    pytest.importorskip("dask")
    atoms = universe(breaks_at=6).atoms
    serial, dask = IsotopyAnalysis(atoms).run(), IsotopyAnalysis(atoms).run(backend="dask", n_workers=2)
    assert same(dask.results.steps, serial.results.steps)


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Two tasks at once in one worker of this process, which share what is not copied."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra 'dask')")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address="127.0.0.1:0", silence_logs="CRITICAL"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.mark.parametrize("how", [{}, {"n_workers": 2, "n_parts": 7}])
@pytest.mark.parametrize("breaks_at", [None, 6])
def test_a_cluster_gives_the_bits_of_a_serial_run(
    client: Any, breaks_at: int | None, how: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    atoms = universe(breaks_at=breaks_at, bad_frame=9).atoms
    serial = IsotopyAnalysis(atoms).run()
    groups: list[int] = []
    apply = ClusterBackend.apply
    monkeypatch.setattr(
        ClusterBackend, "apply", lambda self, func, parts: groups.append(len(parts)) or apply(self, func, parts)
    )
    with client.as_current():
        on_cluster = IsotopyAnalysis(atoms).run(backend="dask", **how)
    assert groups == [how.get("n_parts", 2)]
    assert same(on_cluster.results.steps, serial.results.steps)
    assert on_cluster.results.alerts == serial.results.alerts


def test_a_group_whose_worker_dies_is_one_sentence(client: Any, intact: MDAnalysis.Universe) -> None:
    from distributed import KilledWorker

    class Client:
        def __getattr__(self, name: str) -> Any:
            return getattr(client, name)

        def gather(self, tasks: list[Any]) -> list[Any]:
            client.gather(tasks)
            raise KilledWorker("group", None, 4)

    backend = ClusterBackend(1, Client())
    with pytest.raises(ClusterError, match="A group of frames was not measured: its worker died"):
        backend.apply(len, [[1, 2]])


@pytest.mark.parametrize("breaks_at", [None, 6])
@pytest.mark.parametrize("block_steps", [1, 5, 64])
def test_the_numbers_are_those_of_the_pipeline(breaks_at: int | None, block_steps: int) -> None:
    atoms = universe(breaks_at=breaks_at).atoms
    config = MonitorConfig(block_steps=block_steps)
    reader: Reader = open_reader(Source(object=atoms), ReaderRequest())
    piped = StepTable.joined(list(step_tables(reader, config=config)))
    assert same(IsotopyAnalysis(atoms).run().results.steps, piped)


def test_a_broken_bond_reaches_the_groups_behind_it() -> None:
    results = (
        IsotopyAnalysis(universe(breaks_at=6).atoms).run(backend="multiprocessing", n_workers=2, n_parts=4).results
    )
    assert [edge.edge for edge in results.steps.broken] == [(4, 5)]
    assert results.summary.verdict is RunVerdict.FAIL
    after = results.steps.broken[0].step + 1
    assert (results.bond_stretch[after:] < 1.5).all()  # the broken edge is no longer measured


def test_every_door_knows_the_coordinate_error_of_the_file(tmp_path: Path) -> None:
    """Two bars 0.01 Å apart in an XTC, whose η is 0.0087 Å: nobody may claim more than the stored numbers."""
    bars = np.array([[-10, 0, 0], [10, 0, 0], [0, -10, 0.01], [0, 10, 0.01]], dtype=np.float32)
    top = MDAnalysis.Universe.empty(4, n_residues=4, atom_resindex=np.arange(4), trajectory=True)
    top.add_TopologyAttr("bonds", [(0, 1), (2, 3)])
    top.load_new(np.stack([bars] * 3), format=MemoryReader)
    with MDAnalysis.Writer(str(tmp_path / "bars.xtc"), n_atoms=4) as writer:
        for _ in top.trajectory:
            writer.write(top.atoms)
    top.load_new(str(tmp_path / "bars.xtc"))
    claimed = [step.scope for step in steps(top)]
    assert claimed == IsotopyAnalysis(top.atoms).run().results.scope.tolist() == [Scope.STORED] * 2
    exact = MonitorConfig(coordinate_error=0.0)
    assert [step.scope for step in steps(top, config=exact)] == [Scope.MOTION] * 2


def test_results_hold_every_column_by_its_name(intact: MDAnalysis.Universe) -> None:
    results = IsotopyAnalysis(intact.atoms).run().results
    for column in StepTable.columns():
        assert len(results[column.name]) == N_FRAMES - 1
    assert results.summary.n_steps == N_FRAMES - 1


def test_results_are_one_line_at_a_prompt(intact: MDAnalysis.Universe) -> None:
    results = IsotopyAnalysis(intact.atoms).run().results
    line = f"<IsotopyResults: {results.summary.verdict.value}, {N_FRAMES - 1} steps, {len(results.alerts)} alerts;"
    assert str(results) == repr(results)
    assert str(results).startswith(line)
    assert len(str(results)) < 120


def test_no_step_is_no_proof(intact: MDAnalysis.Universe) -> None:
    results = IsotopyAnalysis(intact.atoms).run(start=4, stop=4).results
    assert len(results.clearance) == 0
    assert results.summary.verdict is RunVerdict.UNPROVEN
