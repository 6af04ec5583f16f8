"""One shard of a run, measured on a worker of a Dask cluster."""

import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mdtopo.errors import InputError, OutputError
from mdtopo.pipeline.run import PartLength, monitor
from mdtopo.pipeline.stopping import StopRequest
from mdtopo.records import MonitorConfig

ASK_SECONDS = 2.0
"""Time between two questions to the scheduler whether to stop."""


@dataclass(frozen=True, slots=True)
class ShardTask:
    """What a worker needs to know of its shard.

    Attributes
    ----------
    inputs : tuple of str
        Absolute paths, the same on every machine.
    out : str
        The shard's results file, absolute too.
    frames : slice
        Which frames are analysed.
    select, config, reader, reader_options, threads, argv, parts
        As of `mdtopo.monitor`.
    broken_from : str or None
        Results file of the shard before, where its bonds are not those that this one would begin with.
    stop : str
        Name of the event that tells all workers to put their work down.
    """

    inputs: tuple[str, ...]
    out: str
    frames: slice
    select: str | None
    config: MonitorConfig
    reader: str | None
    reader_options: Mapping[str, Any]
    threads: int
    argv: tuple[str, ...]
    parts: PartLength | None
    stop: str
    broken_from: str | None = None


@dataclass(frozen=True, slots=True)
class ShardOutcome:
    """How a shard ended: well where both texts are empty.

    Attributes
    ----------
    host : str
        Name of the machine.
    checkpoint : str
        Why it was put down, so that the same task goes on with it.
    failure : str
        Why it cannot be measured.
    """

    host: str
    checkpoint: str = ""
    failure: str = ""


class ClusterStop(StopRequest):
    """Says whether whoever gave the tasks out wants them put down."""

    def __init__(self, name: str) -> None:
        super().__init__()
        from distributed import Event

        self._event = Event(name)
        self._asked = -ASK_SECONDS
        self._is_set = False

    @property
    def reason(self) -> str:
        """Why to stop, in words; empty while there is no reason."""
        now = time.monotonic()
        if not self._is_set and now - self._asked >= ASK_SECONDS:
            self._asked = now
            try:
                self._is_set = bool(self._event.is_set())
            except OSError:  # nobody is there who could take the outcome
                self._is_set = True
        return "the run was put down" if self._is_set else ""


def measure_shard(task: ShardTask) -> ShardOutcome:
    """Measure a shard into its file, or go on with what an earlier worker has left of it."""
    host, stop = socket.gethostname(), ClusterStop(task.stop)
    if stop.reason:
        return ShardOutcome(host, checkpoint=stop.reason)
    try:
        summary = monitor(
            *task.inputs,
            select=task.select,
            out=task.out,
            frames=task.frames,
            config=task.config,
            reader=task.reader,
            reader_options=task.reader_options,
            threads=task.threads,
            overwrite=True,
            argv=list(task.argv),
            stop=stop,
            parts=task.parts,
            broken_from=task.broken_from,
        )
    except (InputError, OutputError) as error:
        return ShardOutcome(host, failure=str(error))
    return ShardOutcome(host, summary.checkpoint, "" if summary.checkpoint else summary.stopped)
