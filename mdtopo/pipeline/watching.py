"""A run that grows with its trajectory: steps are measured, and alerts raised, as frames come."""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mdtopo.alerts import AlertStream
from mdtopo.bonds import reference_lengths
from mdtopo.curverows import refuse_long_strands
from mdtopo.errors import TrajectoryError
from mdtopo.kernelcache import announce_compilation
from mdtopo.measure import measure_block
from mdtopo.pipeline.alertfile import AlertFile
from mdtopo.pipeline.framing import block_of, refuse_winding
from mdtopo.pipeline.growing import POLL_SECONDS, GrowingTrajectory
from mdtopo.pipeline.prometheus import write_metrics
from mdtopo.pipeline.tables import open_input, with_coordinate_error
from mdtopo.pipeline.tally import Progress, Tally
from mdtopo.planning import Setting, reference_samples
from mdtopo.readers import Reader
from mdtopo.records import Alert, Frame, MonitorConfig, RunSummary, Strands


def watch(
    *inputs: str | os.PathLike[str],
    select: str | None = None,
    alerts: str | os.PathLike[str] | None = None,
    prometheus: str | os.PathLike[str] | None = None,
    config: MonitorConfig | None = None,
    reader: str | None = None,
    reader_options: Mapping[str, Any] | None = None,
    poll: float = POLL_SECONDS,
    idle_timeout: float | None = None,
    overwrite: bool = False,
    is_stopped: Callable[[], bool] = lambda: False,
    on_alert: Callable[[Alert], None] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> RunSummary:
    """Follow a trajectory while another program writes it: measure every step, raise alerts, as frames come.

    Parameters
    ----------
    *inputs : path
        Topology first, then the trajectory; its last file grows, and need not exist yet.
    select, reader, reader_options, config
        As of `mdtopo.monitor`.
    alerts : path, optional
        Alert stream (JSON Lines); ``-`` is standard output.
    prometheus : path, optional
        A text file for Prometheus' node exporter, replaced after every look that found new frames.
    poll : float
        Seconds between two looks at the file.
    idle_timeout : float, optional
        Seconds without a change after which the trajectory counts as finished; by default it is watched for ever.
    overwrite : bool
        Whether an existing alert file may be replaced.
    is_stopped : callable
        Asked between two looks and between blocks; the watch ends when it says so.
    on_alert, on_progress : callable, optional
        Called with each `Alert`, and with a `Progress` after each block.

    Returns
    -------
    RunSummary
        The verdict and the counts of all steps that were seen. `stopped` says why the last frame could not be read,
        where the watch ended by `idle_timeout` and the file within a frame.

    Raises
    ------
    InputError
        If the input cannot be used, or nothing of it could be read until the end.
    OutputError
        If an output exists already, or cannot be written.

    Guarantee
    ---------
    As of `mdtopo.monitor`; the steps and alerts are those that it finds in the finished trajectory, in the same order.
    """
    config = config or MonitorConfig()

    def opened() -> Reader:
        """Open the input as it is now."""
        return open_input(*inputs, select=select, reader=reader, reader_options=reader_options)

    growing = GrowingTrajectory(
        opened, [Path(item) for item in inputs], poll=poll, idle_timeout=idle_timeout, is_stopped=is_stopped
    )
    with AlertFile(alerts, overwrite=overwrite) as alert_file:
        watched = _Watched(opened, config, alert_file, on_alert, on_progress, Tally(config))
        metrics = None if prometheus is None else Path(prometheus)
        title = str(inputs[-1])
        for batch in growing.batches(config.block_steps):
            watched.take(batch)
            if metrics is not None:
                write_metrics(metrics, watched.tally.summary(None, ""), run=title, is_running=True)
        stopped = "" if is_stopped() else growing.failure
        if stopped and not watched.has_frames:
            raise TrajectoryError(stopped)
        watched.finish()
        summary = watched.tally.summary(None, stopped)
        if metrics is not None:
            write_metrics(metrics, summary, run=title, is_running=False)
    return summary


@dataclass(slots=True)
class _Watched:
    """The steps of the frames seen so far."""

    opened: Callable[[], Reader]
    config: MonitorConfig
    alert_file: AlertFile
    on_alert: Callable[[Alert], None] | None
    on_progress: Callable[[Progress], None] | None
    tally: Tally
    has_frames: bool = False
    _frames: list[Frame] = field(default_factory=list)
    _setting: Setting | None = None
    _stream: AlertStream | None = None
    _periodic: bool = False
    _first_step: int = 0

    def take(self, batch: list[Frame]) -> None:
        """Measure the steps that the frames make; the first ones wait until the reference lengths are known."""
        self.has_frames = True
        self._frames += batch
        if self._setting is None and len(self._frames) < self.config.reference_frames:
            return
        self._measure()

    def finish(self) -> None:
        """Measure what waits, and say the events that are still open."""
        if self.has_frames:
            self._measure()
        if self._stream is not None:
            self._say(self._stream.finish())

    def _start(self) -> Setting:
        with self.opened() as reader:
            strands: Strands = reader.strands
            self.config = self.tally.config = with_coordinate_error(self.config, reader)
        self.tally.strands = strands
        announce_compilation()
        first = self._frames[: self.config.reference_frames]
        refuse_winding(first[0], strands)
        refuse_long_strands(strands, self.config.curve)
        self._periodic = first[0].cell is not None
        self._stream = AlertStream(strands, self.config)
        self._say(self._stream.opening())
        return Setting.start(
            strands, replace(self.config, profile_steps=0), reference_lengths(reference_samples(first, strands))
        )

    def _measure(self) -> None:
        if self._setting is None:
            self._setting = self._start()
        assert self._stream is not None
        while len(self._frames) > 1:
            taken = self._frames[: self.config.block_steps + 1]
            block = block_of(taken, self._first_step, periodic=self._periodic)
            table, self._setting = measure_block(block, self._setting)
            self._frames = self._frames[len(taken) - 1 :]
            self._first_step += len(table)
            self.tally.add(table)
            self._say(self._stream.after(table))
            if self.on_progress is not None:
                self.on_progress(Progress(self.tally.counts.steps, None, sum(self.tally.alerts.values())))

    def _say(self, alerts: Iterator[Alert]) -> None:
        for alert in alerts:
            self.tally.alerts[alert.severity] += 1
            self.alert_file.write(alert)
            if self.on_alert is not None:
                self.on_alert(alert)
