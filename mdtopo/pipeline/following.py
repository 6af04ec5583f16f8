"""A run that is followed by its output: its alerts once more, as its parts are finished, until it ends."""

import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from mdtopo.alerts import AlertStream
from mdtopo.errors import InputError
from mdtopo.pipeline.alertfile import AlertFile
from mdtopo.pipeline.growing import POLL_SECONDS
from mdtopo.pipeline.prometheus import write_metrics
from mdtopo.pipeline.tally import Progress, Tally
from mdtopo.records import Alert, MonitorConfig, RunSummary
from mdtopo.store.stages import Look, Stage, head_of, look_at, tables_behind

log = logging.getLogger("mdtopo")


@dataclass(frozen=True, slots=True)
class Followed:
    """What was seen of a run, and how it ended.

    Attributes
    ----------
    summary : RunSummary
        Of the steps that were seen.
    config : MonitorConfig
        Of the run.
    end : Look
        The last look; a stage that is running, or not begun, where the run was not followed to its end.
    """

    summary: RunSummary
    config: MonitorConfig
    end: Look


def follow(
    out: str | os.PathLike[str],
    *,
    alerts: str | os.PathLike[str] | None = None,
    prometheus: str | os.PathLike[str] | None = None,
    poll: float = POLL_SECONDS,
    idle_timeout: float | None = None,
    overwrite: bool = False,
    is_stopped: Callable[[], bool] = lambda: False,
    on_alert: Callable[[Alert], None] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Followed:
    """Follow a run of `mdtopo.monitor` by its output, from its first step to its end, and say its alerts.

    Parameters
    ----------
    out : path
        The output, as it was named to the run. It need not exist yet.
    alerts, prometheus, poll, overwrite, is_stopped, on_alert, on_progress
        As of `mdtopo.pipeline.watching.watch`.
    idle_timeout : float, optional
        Seconds without a new part after which nothing more is waited for; by default for ever.
    clock, sleep : callable
        Time, for tests.

    Raises
    ------
    InputError
        If a file of the output cannot be read, or another run has taken the place of this one.
    OutputError
        If the alert file or the metrics file cannot be written, or the state file of the run not be understood.

    Guarantee
    ---------
    The alerts are those that the run itself says, in the same order and bit for bit, each once: of all steps that are
    safe in finished parts, and, when the run has come to its end, of all.
    """
    out = Path(out)
    if look_at(out).stage is Stage.NOT_BEGUN:
        log.info("%s is not being written yet; waiting for its run.", out)
    with AlertFile(alerts, overwrite=overwrite) as alert_file:
        run = _Run(out, alert_file, on_alert, on_progress, None if prometheus is None else Path(prometheus))
        looks = _Looks(out, poll, idle_timeout, is_stopped, clock, sleep)
        for look in looks:
            looks.note(is_new=run.take(look, is_last=looks.is_last))
        return run.finish(looks.last)


@dataclass(slots=True)
class _Looks:
    """Looks at an output again and again, until its run has ended, nothing has come for long, or a stop is asked.

    A run that has ended before its last step counts as ended when two looks have found so: between the end of a job and
    its next try there is a moment.
    """

    out: Path
    poll: float
    idle_timeout: float | None
    is_stopped: Callable[[], bool]
    clock: Callable[[], float]
    sleep: Callable[[float], None]
    last: Look = field(default_factory=lambda: Look(Stage.NOT_BEGUN))
    is_last: bool = False
    _changed: float = 0.0

    def __iter__(self) -> Iterator[Look]:
        self._changed = self.clock()
        while True:
            before, self.last = self.last, look_at(self.out)
            self.is_last = self.last.has_results or (self.last.has_ended and self.last == before)
            yield self.last
            if self.is_last or self._waits_in_vain():
                return
            self._pause()

    def note(self, *, is_new: bool) -> None:
        """Say whether the last look has found anything new."""
        if is_new:
            self._changed = self.clock()

    def _waits_in_vain(self) -> bool:
        idle = self.clock() - self._changed
        return self.is_stopped() or (self.idle_timeout is not None and idle >= self.idle_timeout)

    def _pause(self) -> None:
        end = self.clock() + self.poll
        while not self.is_stopped() and (left := end - self.clock()) > 0.0:
            self.sleep(min(left, 0.2))


@dataclass(slots=True)
class _Run:
    """The steps of a run that have been seen."""

    out: Path
    alert_file: AlertFile
    on_alert: Callable[[Alert], None] | None
    on_progress: Callable[[Progress], None] | None
    metrics: Path | None
    _tally: Tally = field(default_factory=lambda: Tally(MonitorConfig()))
    _stream: AlertStream | None = None
    _started: str = ""
    _next_step: int = 0

    def take(self, look: Look, *, is_last: bool) -> bool:
        """Say the alerts of the steps that are new; return whether there are any."""
        if look.stage is Stage.NOT_BEGUN or not (is_last or look.n_steps > self._next_step):
            return False
        first = self._next_step
        try:
            self._read(look)
        except InputError:
            if look.has_results or look_at(self.out) == look:
                raise
            return self._next_step > first  # the run has ended meanwhile, and its parts are gone: look again
        if self._next_step > first and self.metrics is not None:
            self._write_metrics(self.metrics, is_running=True)
        return self._next_step > first

    def finish(self, end: Look) -> Followed:
        """Say what is to be said at the end of a run that has come to it, and return what was seen."""
        if end.has_results and self._stream is not None:
            self._say(self._stream.finish())
        if self.metrics is not None:
            self._write_metrics(self.metrics, is_running=not end.has_ended)
        summary = self._tally.summary(self.out if end.has_results else None, self._reason(end))
        return Followed(
            replace(summary, checkpoint=end.reason if end.stage is Stage.PUT_DOWN else ""), self._config, end
        )

    @property
    def _config(self) -> MonitorConfig:
        return self._tally.config

    def _reason(self, end: Look) -> str:
        """Return why the steps that were seen are not all; empty where they are."""
        return "" if end.stage is Stage.COMPLETE else end.reason or f"the run is {end.stage.value}"

    def _read(self, look: Look) -> None:
        if self._stream is None and not self._begin(look):
            return
        if look.started != self._started:
            raise InputError(f"{self.out} is being written by another run than before; start the watch again.")
        assert self._stream is not None
        for table in tables_behind(self.out, self._next_step, look):
            self._next_step += len(table)
            self._tally.add(table)
            self._say(self._stream.after(table))
            if self.on_progress is not None:
                self.on_progress(Progress(self._tally.counts.steps, None, sum(self._tally.alerts.values())))

    def _begin(self, look: Look) -> bool:
        found = head_of(self.out, look)
        if found is None:
            return False
        self._tally.config, self._started = MonitorConfig.from_mapping(found.config), look.started
        self._tally.strands = found.strands
        self._stream = AlertStream(found.strands, self._config)
        self._say(self._stream.opening())
        return True

    def _write_metrics(self, path: Path, *, is_running: bool) -> None:
        write_metrics(path, self._tally.summary(None, ""), run=str(self.out), is_running=is_running)

    def _say(self, alerts: Iterable[Alert]) -> None:
        for alert in alerts:
            self._tally.alerts[alert.severity] += 1
            self.alert_file.write(alert)
            if self.on_alert is not None:
                self.on_alert(alert)
