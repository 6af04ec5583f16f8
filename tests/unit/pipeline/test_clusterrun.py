"""Shards as tasks of a Dask cluster: the outcome is that of a single run, whatever happens to tasks and workers."""

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import kill_runs
import pytest

import mdtopo
from mdtopo.cli import main
from mdtopo.cli.exits import Exit
from mdtopo.errors import ClusterError, InputError, MissingDependencyError, OutputError
from mdtopo.pipeline import StopRequest, cluster, monitor_on_cluster, shardtask
from mdtopo.pipeline.clusterrun import _ClusterJob
from mdtopo.pipeline.shardtask import ShardTask
from mdtopo.records import MonitorConfig

distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra 'dask')")
dask = pytest.importorskip("dask")

INSTALLED = Path(mdtopo.__file__).parents[1]
CONFIG = MonitorConfig(block_steps=4)
QUIET = {"dashboard_address": "127.0.0.1:0", "silence_logs": "CRITICAL"}


def local_cluster(n_workers: int, **settings: object) -> Any:
    return distributed.LocalCluster(n_workers=n_workers, threads_per_worker=1, **QUIET, **settings)


@pytest.fixture(scope="module")
def processes() -> Iterator[str]:
    """Two workers, each a process, as on a cluster of machines."""
    path = {"PYTHONPATH": os.pathsep.join([str(INSTALLED), os.environ.get("PYTHONPATH", "")])}
    with dask.config.set({"distributed.nanny.pre-spawn-environ": path}), local_cluster(2, processes=True) as running:
        yield running.scheduler_address


@pytest.fixture
def threads() -> Iterator[str]:
    """One worker in this process, which can be changed under its hands."""
    with local_cluster(1, processes=False, protocol="tcp") as running:
        yield running.scheduler_address


@pytest.fixture
def trajectory(tmp_path: Path) -> Path:
    return kill_runs.write_input(tmp_path / "input.npz")


def check_equal(out: Path, whole: Path) -> None:
    found, expected = kill_runs.contents(out), kill_runs.contents(whole)
    for key in {*found, *expected} - {"@provenance"}:
        assert found[key] == expected[key], key
    assert out.with_suffix(".jsonl").read_bytes() == whole.with_suffix(".jsonl").read_bytes()


def single_run(trajectory: Path, folder: Path, frames: slice = slice(None)) -> Path:
    whole = folder / "whole.h5"
    mdtopo.monitor(trajectory, out=whole, alerts=whole.with_suffix(".jsonl"), config=CONFIG, frames=frames)
    return whole


@pytest.mark.parametrize("frames", [slice(None), slice(7, 220, 3)], ids=["all frames", "every third"])
def test_the_outcome_is_that_of_a_single_run_though_a_bond_breaks(
    processes: str, trajectory: Path, tmp_path: Path, frames: slice
) -> None:
    """The edge breaks in the third of five shards: the two behind it are measured again."""
    whole, out = single_run(trajectory, tmp_path, frames), tmp_path / "run.h5"
    seen: list[int] = []
    summary = monitor_on_cluster(
        trajectory, cluster=processes, out=out, alerts=out.with_suffix(".jsonl"), config=CONFIG, frames=frames,
        shard_steps=48 if frames.step is None else 16, on_progress=lambda progress: seen.append(progress.steps),
    )  # fmt: skip
    check_equal(out, whole)
    assert summary.n_fractures > 1
    assert summary.to_mapping() == mdtopo.read_results(whole).summary
    assert max(seen) == summary.n_steps
    assert not list(tmp_path.glob("run.h5.*"))


def test_a_finished_run_measures_nothing(processes: str, trajectory: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.h5"
    first = monitor_on_cluster(trajectory, cluster=processes, out=out, config=CONFIG)
    before = out.read_bytes()
    assert monitor_on_cluster(trajectory, cluster="tcp://127.0.0.1:1", out=out, config=CONFIG) == first
    assert mdtopo.monitor(trajectory, out=out, config=CONFIG) == first
    assert out.read_bytes() == before
    with pytest.raises(OutputError, match="exists already"):
        monitor_on_cluster(trajectory, cluster=processes, out=out, config=MonitorConfig(near_limit=0.7))


@pytest.fixture
def patched_monitor(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., Any]], None]:
    return lambda replacement: monkeypatch.setattr(shardtask, "monitor", replacement)


def slow(*inputs: str, stop: StopRequest, **how: Any) -> Any:
    """A `monitor` that begins late enough to be stopped."""
    time.sleep(0.4)
    return mdtopo.monitor(*inputs, stop=stop, **how)


def wait_for_a_shard(folder: Path) -> None:
    end = time.monotonic() + 30
    while not list(folder.glob("run.h5.shards/shard-*.h5")) and time.monotonic() < end:
        time.sleep(0.01)


def test_an_interrupted_command_ends_with_75_and_goes_on(
    threads: str, trajectory: Path, tmp_path: Path, patched_monitor: Callable[..., None],
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    whole, out = single_run(trajectory, tmp_path), tmp_path / "run.h5"
    words = ["monitor", str(trajectory), "-o", str(out), "--alerts", str(out.with_suffix(".jsonl"))]
    words += ["--block-steps", "4", "--dask", threads, "--shard-steps", "30"]

    def interrupt() -> None:
        wait_for_a_shard(tmp_path)
        os.kill(os.getpid(), signal.SIGINT)

    patched_monitor(slow)
    watcher = threading.Thread(target=interrupt)
    watcher.start()
    assert main(words) == Exit.CHECKPOINT
    watcher.join()
    said = capsys.readouterr().err
    assert f"because SIGINT was received; they are in {out}.shards, and the same command goes on with them." in said
    assert not out.exists()
    assert 0 < len(list(tmp_path.glob("run.h5.shards/shard-*.h5"))) < 8
    patched_monitor(mdtopo.monitor)
    assert main(words) == Exit.DONE
    check_equal(out, whole)


def failing(error: Exception) -> Callable[..., Any]:
    """Return a `monitor` whose shard at frame 119 fails, as on a machine that lacks a file."""

    def monitor(*inputs: str, frames: slice, **how: Any) -> Any:
        if frames.start == 119:
            raise error
        return mdtopo.monitor(*inputs, frames=frames, **how)

    return monitor


@pytest.mark.parametrize("error", [InputError("input.npz does not exist."), OutputError("The disk is full.")])
def test_a_shard_that_fails_is_named_and_the_others_are_kept(
    threads: str, trajectory: Path, tmp_path: Path, patched_monitor: Callable[..., None], error: Exception
) -> None:
    out = tmp_path / "run.h5"
    patched_monitor(failing(error))
    with pytest.raises(ClusterError) as caught:
        monitor_on_cluster(trajectory, cluster=threads, out=out, config=CONFIG, shard_steps=60)
    said = str(caught.value)
    assert said.startswith("Shard --frames 119:180 was not done on ")
    assert str(error) in said
    assert f"3 of 4 shards are finished in {out}.shards; the same command goes on with the others." in said
    patched_monitor(mdtopo.monitor)
    summary = monitor_on_cluster(trajectory, cluster=threads, out=out, config=CONFIG, shard_steps=60)
    assert summary.n_steps == 239


def test_a_fault_of_mdtopo_on_a_worker_is_a_fault_of_mdtopo(
    threads: str, trajectory: Path, tmp_path: Path, patched_monitor: Callable[..., None],
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    patched_monitor(failing(ZeroDivisionError("division by zero")))
    words = ["monitor", str(trajectory), "-o", str(tmp_path / "run.h5"), "--dask", threads, "--shard-steps", "60"]
    assert main(words) == Exit.INTERNAL
    assert "internal error: ZeroDivisionError: division by zero" in capsys.readouterr().err


DIES = "import os, mdtopo.pipeline.shardtask as task; task.monitor = lambda *words, **more: os._exit(1)"


def test_a_worker_that_dies_again_and_again_is_one_sentence(
    trajectory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run.h5"
    words = ["monitor", str(trajectory), "-o", str(out), "--shard-steps", "120", "--block-steps", "4"]
    path = {"PYTHONPATH": os.pathsep.join([str(INSTALLED), os.environ.get("PYTHONPATH", "")])}
    settings = {"distributed.nanny.pre-spawn-environ": path, "distributed.scheduler.allowed-failures": 0}
    with dask.config.set(settings), local_cluster(1, processes=True) as running:
        with distributed.Client(running, set_as_default=False) as client:
            client.run(exec, DIES)
        assert main([*words, "--dask", running.scheduler_address]) == Exit.BAD_INPUT
        said = capsys.readouterr().err
        assert "was not done: its worker died each time that it was tried" in said
        assert "Traceback" not in said
        # the worker's successor is whole
        assert main([*words, "--dask", running.scheduler_address]) == Exit.DONE


def test_a_scheduler_that_goes_is_one_sentence(
    trajectory: Path, tmp_path: Path, patched_monitor: Callable[..., None], capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run.h5"
    words = ["monitor", str(trajectory), "-o", str(out), "--shard-steps", "30", "--block-steps", "4"]
    patched_monitor(slow)
    with local_cluster(1, processes=False, protocol="tcp") as running:

        def close() -> None:
            wait_for_a_shard(tmp_path)
            running.close()

        closer = threading.Thread(target=close)
        closer.start()
        assert main([*words, "--dask", running.scheduler_address]) == Exit.BAD_INPUT
        closer.join()
    said = capfd.readouterr().err
    assert f"The Dask scheduler at {running.scheduler_address} is gone (" in said
    assert f"of 8 shards are finished in {out}.shards; the same command goes on with the others." in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("status", "reason", "is_gone"),
    [("running", "scheduler-connection-lost", True), ("connecting", "", True), ("running", "scheduler-restart", False)],
)
def test_a_task_that_is_dropped_while_it_is_asked_for(status: str, reason: str, is_gone: bool) -> None:
    """Its status still said that it had ended."""
    cancelled = CancelledError("mdtopo-0:30")
    cancelled.reason = reason  # type: ignore[attr-defined]

    class Future:
        status = "finished"

        def exception(self) -> None:
            raise cancelled

    job = _ClusterJob(SimpleNamespace(status=status), "tcp://", None, [], StopRequest(), None)  # type: ignore[arg-type]
    if is_gone:
        with pytest.raises(OSError, match="the connection is lost"):
            job._outcome(Future())
    else:
        assert job._outcome(Future()).failure == "the cluster has dropped it."


def test_who_does_not_answer_is_named(trajectory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 0.5)
    for address in ("tcp://127.0.0.1:1", "no address"):
        with pytest.raises(ClusterError, match=f"No Dask scheduler answers at {address} "):
            monitor_on_cluster(trajectory, cluster=address, out=tmp_path / "run.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["input.npz"]


@pytest.mark.parametrize(("there", "words"), [("0.0.9", "has mdtopo 0.0.9, and this is"), (None, "has no mdtopo")])
def test_a_worker_with_another_mdtopo_is_refused(there: str | None, words: str) -> None:
    class Client:
        def get_versions(self, packages: list[str]) -> dict[str, Any]:
            return {"workers": {"tcp://w:1": {"packages": dict.fromkeys(packages, there)}}}

    with pytest.raises(ClusterError, match=f"The Dask worker tcp://w:1 {words}"):
        cluster.check_workers(Client())


def test_without_the_package_the_cure_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'mdtopo\[dask\]'"), cluster.connected("tcp://a:1"):
        pass


def test_a_command_without_a_results_file_is_refused(trajectory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["monitor", str(trajectory), "--dask", "tcp://a:1"]) == Exit.BAD_INPUT
    assert "--dask needs --out" in capsys.readouterr().err


def test_a_task_survives_its_way_to_a_worker() -> None:
    task = ShardTask(("a",), "b", slice(0, 5, 1), None, CONFIG, None, {}, 1, (), None, "stop")
    assert distributed.protocol.deserialize(*distributed.protocol.serialize(task)) == task
    assert json.loads(json.dumps(task.inputs)) == ["a"]
