"""The whole job with its shards as tasks of a Dask cluster: given out, watched, and made one results file."""

import logging
import os
import shutil
import uuid
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdtopo.bonds import BondState
from mdtopo.errors import AuditError, ClusterError, InputError
from mdtopo.pipeline.alertfile import AlertFile
from mdtopo.pipeline.cluster import LOST_WORKER, check_workers, connected
from mdtopo.pipeline.merge import joined
from mdtopo.pipeline.output import open_output
from mdtopo.pipeline.preceding import after_shard
from mdtopo.pipeline.run import PartLength, monitor
from mdtopo.pipeline.shardtask import ShardOutcome, ShardTask, measure_shard
from mdtopo.pipeline.stopping import StopRequest
from mdtopo.pipeline.tables import ALL_FRAMES, check_end, check_frames, open_input, with_coordinate_error
from mdtopo.pipeline.tally import Progress, Tally
from mdtopo.records import MonitorConfig, RunSummary
from mdtopo.records.shards import SHARD_STEPS, frames_text, shard_frames
from mdtopo.store import Head, collect_provenance, discard, read_results, stored_tables
from mdtopo.store.atomic import failed
from mdtopo.store.tiling import Shard, read_shard, same_bonds

log = logging.getLogger("mdtopo")

LOOK_SECONDS = 1.0
"""Time between two looks at whether the run is to be put down."""


def monitor_on_cluster(
    *inputs: str | os.PathLike[str],
    cluster: str,
    out: str | os.PathLike[str],
    select: str | None = None,
    alerts: str | os.PathLike[str] | None = None,
    frames: slice = ALL_FRAMES,
    config: MonitorConfig | None = None,
    reader: str | None = None,
    reader_options: Mapping[str, Any] | None = None,
    threads: int | None = None,
    shard_steps: int = SHARD_STEPS,
    overwrite: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    argv: list[str] | None = None,
    stop: StopRequest | None = None,
    parts: PartLength | None = None,
    broken_from: str | os.PathLike[str] | None = None,
) -> RunSummary:
    """Run the whole job over a trajectory, its shards as tasks of a Dask cluster that is running already.

    Each shard is measured into a file of its own in ``<out>.shards``, by `monitor`, so that finished shards, and the
    finished parts of others, are there for the same call when it is made again. In the end they are merged, and the
    directory is removed. Where a bond breaks in one shard, those behind it are measured once more, one after the other,
    because they could not know.

    Parameters
    ----------
    *inputs : path
        Topology first, then the trajectory. Every worker must find them under the same names.
    cluster : str
        Address of the scheduler, such as ``tcp://host:8786``.
    out : path
        Results file; its directory must be there for every worker under the same name too.
    alerts : path, optional
        Alert stream; it is written in the end, when all shards are there.
    threads : int, optional
        How many threads each task measures with; by default one, because a worker has a task for each of its threads.
    shard_steps : int
        Greatest number of steps in a shard.
    select, frames, config, reader, reader_options, overwrite, argv, stop, parts, broken_from
        As of `monitor`.
    on_progress : callable, optional
        Called with a `Progress` after each shard; its alerts are counted in the end only.

    Returns
    -------
    RunSummary
        That of one run over all frames. Where the run was put down, `checkpoint` says why, and the counts are those of
        the finished shards; the same call goes on.

    Raises
    ------
    InputError
        If the input cannot be used, or cannot be cut into shards.
    OutputError
        As of `monitor`.
    ClusterError
        If the cluster cannot be used, or a shard was not done: says which, where, and why. Finished shards stay.

    Guarantee
    ---------
    Every column of the results file equals that of a single run, bit for bit.
    """
    config, argv, threads = config or MonitorConfig(), argv or [], threads or 1
    paths = [Path(item).absolute() for item in inputs]
    target = Path(out).absolute()
    with ExitStack() as stack:
        opened = stack.enter_context(open_input(*paths, select=select, reader=reader, reader_options=reader_options))
        check_frames(opened, frames)
        if opened.n_frames is None:
            raise InputError(f"{paths[-1]} is a stream: it cannot be cut into shards. Run it without a cluster.")
        for note in opened.notes:
            log.info("%s", note)
        config = with_coordinate_error(config, opened)
        request = {
            "select": select,
            "frames": [frames.start, frames.stop, frames.step],
            "reader": reader,
            "reader_options": dict(reader_options or {}),
        }
        origin = collect_provenance(paths, argv=argv, threads=threads)
        head = Head(opened.strands, config, replace(origin, notes=tuple(opened.notes)), request)
        check_end(opened, frames)
        ranges = shard_frames(opened.n_frames, frames, shard_steps)
        bonds = BondState.intact(len(opened.strands.edges))
        if broken_from is not None:
            head, bonds = after_shard(Path(broken_from), head, opened, frames)
        # before anything is written, unless there may be nothing to do
        client = None if target.exists() else stack.enter_context(connected(cluster))
        output = open_output(stack, target, head, bonds, overwrite=overwrite)
        if not output.is_finished and len(range(opened.n_frames)[frames]) > 1:
            client = client or stack.enter_context(connected(cluster))
            alert_file = stack.enter_context(AlertFile(alerts, overwrite=overwrite, resume=output.resumed))
            folder = _shard_folder(target, keep=output.resumed)
            template = ShardTask(
                tuple(map(str, paths)), "", frames, select, config, reader, dict(reader_options or {}), threads,
                tuple(argv), parts, f"mdtopo-{uuid.uuid4().hex}",
                None if broken_from is None else str(Path(broken_from).absolute()),
            )  # fmt: skip
            shards = [_Entry(part, folder / f"shard-{part.start:010d}-{part.stop:010d}.h5") for part in ranges]
            job = _ClusterJob(client, cluster, template, shards, stop or StopRequest(), on_progress)
            if output.parts is not None:
                output.parts.is_measuring = True
            checkpoint = job.run()
            if checkpoint:
                if output.parts is not None:
                    output.parts.note_end("put down", checkpoint)
                return _put_down(job, config, checkpoint)
            summary = joined(
                [entry.measured for entry in shards], target, output.head, overwrite=overwrite, alert_file=alert_file
            )
            alert_file.finish()
            discard(target)
            shutil.rmtree(folder, ignore_errors=True)
            return summary
    return monitor(  # nothing is left to be given out
        *inputs, select=select, out=out, alerts=alerts, frames=frames, config=config, reader=reader,
        reader_options=reader_options, threads=threads, overwrite=overwrite, on_progress=on_progress, argv=argv,
        stop=stop, parts=parts, broken_from=broken_from,
    )  # fmt: skip


def _shard_folder(out: Path, *, keep: bool) -> Path:
    """Return the directory of an output's shards; without those that are there, unless they are of this run."""
    folder = out.with_name(f"{out.name}.shards")
    if not keep:
        shutil.rmtree(folder, ignore_errors=True)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise failed(out, error) from error
    return folder


def _put_down(job: "_ClusterJob", config: MonitorConfig, reason: str) -> RunSummary:
    """Return the summary of the shards that are finished."""
    tally = Tally(config)
    for entry in job.entries:
        for table in stored_tables(entry.path) if entry.shard is not None else ():
            tally.add(table)
    return replace(tally.summary(None, reason), checkpoint=reason)


def _outcome_of(future: Any) -> ShardOutcome:
    """Return how a task ended that has not been dropped."""
    from distributed import KilledWorker

    error = future.exception()
    if isinstance(error, KilledWorker):
        return ShardOutcome("", failure=f"{LOST_WORKER}.")
    if error is not None:
        raise error
    outcome: ShardOutcome = future.result()
    return outcome


@dataclass(slots=True)
class _Entry:
    """One shard on its way: given out while it has a future, measured when `shard` is there."""

    frames: slice
    path: Path
    shard: Shard | None = None
    future: Any = None
    failure: str = ""
    is_redone: bool = False

    @property
    def measured(self) -> Shard:
        """The shard, once it has been measured."""
        assert self.shard is not None
        return self.shard


@dataclass(slots=True)
class _ClusterJob:
    """All shards of a run: from the first in order, as many as `n_settled` are as one run would have them."""

    client: Any
    address: str
    template: ShardTask
    entries: list[_Entry]
    stop: StopRequest
    on_progress: Callable[[Progress], None] | None
    n_settled: int = 0
    _told: bool = False

    def run(self) -> str:
        """Measure what is missing; return why the run was put down, or nothing where all shards are there.

        Raises
        ------
        ClusterError
            If a shard was not done.
        """
        if not check_workers(self.client):
            log.info("The Dask cluster at %s has no worker yet; the shards wait for one.", self.address)
        try:
            self._begin()
            while waiting := [entry for entry in self.entries if entry.future is not None]:
                for entry in self._finished(waiting):
                    self._take(entry)
                self._settle()
                self._look_whether_to_stop()
        except OSError as error:
            raise ClusterError(f"The Dask scheduler at {self.address} is gone ({error}). {self._kept()}") from error
        finally:
            self._call_back()
        self._refuse_failures()
        return "" if self.n_settled == len(self.entries) else self.stop.reason

    def _begin(self) -> None:
        for entry in self.entries:
            if (found := _complete(entry.path)) is not None:
                entry.shard = found
            else:
                self._give_out(entry)
        n_kept = sum(entry.shard is not None for entry in self.entries)
        log.info(
            "%d shards, %d of them finished before, on the Dask cluster at %s.", len(self.entries), n_kept, self.address
        )
        self._settle()

    def _give_out(self, entry: _Entry, before: Path | None = None) -> None:
        first = self.template.broken_from if entry is self.entries[0] else None
        task = replace(
            self.template,
            out=str(entry.path),
            frames=entry.frames,
            broken_from=first if before is None else str(before),
        )
        entry.shard = None
        entry.future = self.client.submit(
            measure_shard, task, pure=False, key=f"mdtopo-{frames_text(entry.frames)}-{uuid.uuid4().hex}"
        )

    def _finished(self, waiting: list[_Entry]) -> list[_Entry]:
        """Return the shards that have ended, however they did, after a second at most."""
        from distributed import wait

        try:
            wait([entry.future for entry in waiting], timeout=LOOK_SECONDS, return_when="FIRST_COMPLETED")
        except TimeoutError:
            return []
        except CancelledError:  # the scheduler has dropped one of them
            pass
        return [entry for entry in waiting if entry.future.done()]

    def _take(self, entry: _Entry) -> None:
        """Note how a task ended.

        Raises
        ------
        BaseException
            What it raised, where that is a fault of mdtopo.
        """
        future, entry.future = entry.future, None
        outcome = self._outcome(future)
        if outcome.checkpoint:
            return
        if outcome.failure:
            entry.failure = f"{f' on {outcome.host}' if outcome.host else ''}: {outcome.failure}"
            return
        entry.shard = _complete(entry.path)
        if entry.shard is None:
            entry.failure = (
                f": it was measured on {outcome.host}, but {entry.path} is not there; the directory must be on a file "
                "system that this machine and all workers share."
            )
        if self.on_progress is not None:
            done = sum(entry.shard.n_steps for entry in self.entries if entry.shard is not None)
            total = sum(len(range(e.frames.start, e.frames.stop, e.frames.step)) - 1 for e in self.entries)
            self.on_progress(Progress(done, total, 0))

    def _outcome(self, future: Any) -> ShardOutcome:
        """Return how a task ended."""
        try:
            if future.status == "cancelled":
                return self._dropped("")
            return _outcome_of(future)
        except CancelledError as error:  # since it was asked
            return self._dropped(str(getattr(error, "reason", "")))

    def _dropped(self, reason: str) -> ShardOutcome:
        """Return the outcome of a task that the cluster has dropped.

        Raises
        ------
        OSError
            If the scheduler is gone.
        """
        if self.client.status != "running" or reason == "scheduler-connection-lost":
            raise OSError("the connection is lost")
        return ShardOutcome("", failure="the cluster has dropped it.")

    def _settle(self) -> None:
        """Go on along the seams as far as shards are measured; give out again the first that did not know a bond."""
        while self.n_settled < len(self.entries):
            entry = self.entries[self.n_settled]
            if entry.shard is None:
                return
            before = self.entries[self.n_settled - 1] if self.n_settled else None
            if before is not None and not same_bonds(before.measured.bonds[1], entry.shard.bonds[0]):
                if entry.is_redone:
                    raise AuditError(f"{entry.path} does not begin with the bonds that {before.path} ends with.")
                if self._told:
                    return
                log.info("Frames %s again: a bond was broken before.", frames_text(entry.frames))
                entry.is_redone = True
                self._give_out(entry, before.path)
                return
            self.n_settled += 1

    def _look_whether_to_stop(self) -> None:
        """Tell all workers to put their work down, once, and take back what has not begun."""
        if self._told or not self.stop.reason:
            return
        self._told = True
        self._stop_event().set()
        begun = {key for keys in self.client.processing().values() for key in keys}
        for entry in self.entries:
            if entry.future is not None and entry.future.key not in begun:
                self.client.cancel(entry.future)
                entry.future = None

    def _stop_event(self) -> Any:
        from distributed import Event

        return Event(self.template.stop, client=self.client)

    def _call_back(self) -> None:
        """Leave no task behind that nobody waits for: after a failure those that run put their work down."""
        left = [entry.future for entry in self.entries if entry.future is not None]
        if left and self.client.status == "running":
            self._stop_event().set()
            self.client.cancel(left)

    def _refuse_failures(self) -> None:
        failures = [entry for entry in self.entries if entry.failure]
        if failures:
            others = f" {len(failures) - 1} other shards failed too." if len(failures) > 1 else ""
            raise ClusterError(
                f"Shard --frames {frames_text(failures[0].frames)} was not done{failures[0].failure}{others} "
                f"{self._kept()}"
            )

    def _kept(self) -> str:
        n_done = sum(entry.shard is not None for entry in self.entries)
        return (
            f"{n_done} of {len(self.entries)} shards are finished in {self.entries[0].path.parent}; the same command "
            "goes on with the others."
        )


def _complete(path: Path) -> Shard | None:
    """Return a shard that is measured to its end; None where there is none yet."""
    if not path.exists():
        return None
    return read_shard(path) if read_results(path, columns=()).complete else None
