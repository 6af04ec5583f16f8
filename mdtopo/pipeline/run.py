"""The whole job over a trajectory: measure every step, raise alerts, write the results."""

import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdtopo.alerts import AlertStream
from mdtopo.bonds import BondState
from mdtopo.errors import OptionError, OutputError, TrajectoryError
from mdtopo.pipeline.alertfile import AlertFile
from mdtopo.pipeline.assembly import assemble
from mdtopo.pipeline.output import Output, open_output
from mdtopo.pipeline.preceding import after_shard
from mdtopo.pipeline.stopping import StopRequest
from mdtopo.pipeline.tables import (
    ALL_FRAMES,
    Measured,
    check_frames,
    measured_blocks,
    open_input,
    settled_threads,
    with_coordinate_error,
)
from mdtopo.pipeline.tally import Progress, Tally
from mdtopo.readers import Reader
from mdtopo.records import Alert, MonitorConfig, RunSummary, Strands
from mdtopo.store import Head, PartsWriter, collect_provenance, discard, folder_of

log = logging.getLogger("mdtopo")


@dataclass(frozen=True, slots=True)
class PartLength:
    """How long a part of a running output may get: in steps, and in minutes.

    Raises
    ------
    OptionError
        If `steps` is below 1, or `minutes` below 0 or no number.
    """

    steps: int = 100_000
    minutes: float = 10.0

    def __post_init__(self) -> None:
        if not (self.steps >= 1 and self.minutes >= 0.0):
            raise OptionError(
                f"A part would have {self.steps} steps and {self.minutes:g} minutes; it must have 1 step or more, and "
                "no less than 0 minutes."
            )


def monitor(
    *inputs: Any,
    select: str | None = None,
    out: str | os.PathLike[str] | None = None,
    alerts: str | os.PathLike[str] | None = None,
    strands: Strands | None = None,
    frames: slice = ALL_FRAMES,
    config: MonitorConfig | None = None,
    reader: str | None = None,
    reader_options: Mapping[str, Any] | None = None,
    threads: int | None = None,
    overwrite: bool = False,
    on_alert: Callable[[Alert], None] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    argv: list[str] | None = None,
    max_hours: float | None = None,
    stop: StopRequest | None = None,
    parts: PartLength | None = None,
    broken_from: str | os.PathLike[str] | None = None,
) -> RunSummary:
    """Run the whole job over a trajectory: measure every step, raise alerts, write the results.

    Parameters
    ----------
    *inputs
        File paths (topology first, then the trajectory), or one Universe, AtomGroup, array or Reader.
    select : str, optional
        Which atoms are the backbone, in the reader's own language; by default CA of proteins, C4' of nucleic acids, or
        every bead.
    out : path, optional
        Results file (HDF5). Nothing is stored where it is left out.
    alerts : path, optional
        Alert stream (JSON Lines); ``-`` is standard output.
    strands : Strands, optional
        The strands of an array, which holds none itself.
    frames : slice, optional
        Which frames are analysed; a step joins consecutive analysed frames.
    config : MonitorConfig, optional
        Every other knob.
    reader, reader_options : optional
        Name of the reader to use, and its options.
    threads : int, optional
        How many threads measure steps while frames are read; results do not depend on it.
    overwrite : bool
        Whether existing output files may be replaced.
    on_alert, on_progress : callable, optional
        Called with each `Alert`, and with a `Progress` after each block.
    argv : list of str, optional
        The command line, for the provenance.
    max_hours : float, optional
        After so many hours the run is put down; the same call goes on with it.
    stop : StopRequest, optional
        Asked after each block whether to put the run down; in place of `max_hours`.
    parts : PartLength, optional
        How often what was measured is made safe; results do not depend on it.
    broken_from : path, optional
        Results file of the shard before, which ends with the first of `frames`: the bonds that are broken there, or too
        long, are so from the start. Both together are then what one run would give.

    Returns
    -------
    RunSummary
        The verdict and the counts. Where the trajectory could not be read to its end, `stopped` says why; what was read
        until then is in the results, which are marked as incomplete. Where the run was put down, `checkpoint` says why;
        the same call goes on with it.

    Raises
    ------
    InputError
        If the input cannot be opened or has no usable strands, or `broken_from` is no shard that ends where this run
        begins.
    OutputError
        If an output exists already, is being written by another process, belongs to a run with other input or settings,
        or cannot be written. What was finished stays, and the same call goes on with it.

    Guarantee
    ---------
    Proven: a step that counts as proved has no passage along the linear motion between its two frames; what the strands
    did between the frames in truth is not known to anyone.
    """
    config, threads = config or MonitorConfig(), settled_threads(threads)
    stop = stop or StopRequest(max_hours)
    with ExitStack() as stack:
        opened = stack.enter_context(
            open_input(*inputs, select=select, strands=strands, reader=reader, reader_options=reader_options)
        )
        check_frames(opened, frames)
        config = with_coordinate_error(config, opened)
        paths, output, bonds = _paths(inputs), None, None
        request = {
            "select": select,
            "frames": [frames.start, frames.stop, frames.step],
            "reader": reader,
            "reader_options": dict(reader_options or {}),
        }
        origin = collect_provenance(paths, argv=argv or [], threads=threads)
        head = Head(opened.strands, config, replace(origin, notes=tuple(opened.notes)), request)
        if broken_from is not None:
            head, bonds = after_shard(Path(broken_from), head, opened, frames)
        AlertFile(alerts).check()
        if out is not None:
            start = BondState.intact(len(opened.strands.edges)) if bonds is None else bonds
            output = open_output(stack, Path(out), head, start, overwrite=overwrite)
        resumed = output is not None and output.resumed
        alert_file = stack.enter_context(AlertFile(alerts, overwrite=overwrite, resume=resumed))
        for note in opened.notes:
            log.info("%s", note)
        job = _Job(
            opened,
            frames,
            config,
            threads,
            alert_file,
            output,
            on_alert,
            on_progress,
            stop,
            parts or PartLength(),
            bonds,
        )
        return job.run(ahead=bool(paths))


def _paths(inputs: tuple[Any, ...]) -> list[Path]:
    return [Path(item) for item in inputs if isinstance(item, str | os.PathLike)]


@dataclass(slots=True)
class _Job:
    """One run of `monitor`, with all that it holds open."""

    reader: Reader
    frames: slice
    config: MonitorConfig
    threads: int
    alert_file: AlertFile
    output: Output | None
    on_alert: Callable[[Alert], None] | None
    on_progress: Callable[[Progress], None] | None
    stop: StopRequest
    part_length: PartLength
    bonds: BondState | None

    def run(self, *, ahead: bool) -> RunSummary:
        """Measure all steps, and return what they come to."""
        tally, stream = Tally(self.config, self.reader.strands), AlertStream(self.reader.strands, self.config)
        self._say(stream.opening(), tally, again=self._is_resumed)
        if self.output is not None:
            for table in self.output.tables():
                tally.add(table)
                self._say(stream.after(table), tally, again=True)
        stopped = checkpoint = ""
        if self.output is None or not self.output.is_finished:
            stopped, checkpoint = self._measure(tally, stream, ahead=ahead)
        if checkpoint and self.output is not None and self.output.parts is not None:
            self.output.parts.note_end("put down", checkpoint)
            return replace(tally.summary(None, checkpoint), checkpoint=checkpoint)
        try:
            self._say(stream.finish(), tally)
            self.alert_file.finish()
            return self._finish(tally, stopped)
        finally:
            if self.output is not None and self.output.parts is not None and self.output.parts.has_only_part_open:
                self.output.parts.close_part()

    @property
    def _is_resumed(self) -> bool:
        return self.output is not None and (self.output.is_finished or self.output.restart() is not None)

    def _measure(self, tally: Tally, stream: AlertStream, *, ahead: bool) -> tuple[str, str]:
        """Measure what is left; return why it ended before the last frame, and why it was put down, in words."""
        blocks = measured_blocks(
            self.reader,
            frames=self.frames,
            config=self.config if self.output is not None else replace(self.config, profile_steps=0),
            threads=self.threads,
            on_reference=self.output.note_reference if self.output is not None else None,
            restart=self.output.restart() if self.output is not None else None,
            bonds=self.bonds,
            ahead=ahead,
        )
        parts = self.output.parts if self.output is not None else None
        with closing(blocks), _Shelf(parts, self.part_length) as shelf:
            try:
                for measured in blocks:
                    self._take(measured, tally, stream, shelf)
                    if self.stop.reason:
                        return self._put_down()
            except TrajectoryError as error:
                shelf.has_all = True
                return str(error), ""
            shelf.has_all = True
        return "", ""

    def _take(self, measured: Measured, tally: Tally, stream: AlertStream, shelf: "_Shelf") -> None:
        tally.add(measured.table)
        shelf.append(measured)
        self._say(stream.after(measured.table), tally)
        shelf.close_if_due()
        if self.on_progress is not None:
            total = _n_steps(self.reader.n_frames, self.frames)
            self.on_progress(Progress(tally.counts.steps, total, sum(tally.alerts.values())))

    def _put_down(self) -> tuple[str, str]:
        """Return what is said of a run that is asked to stop: it can go on only where its input has a name."""
        if self.output is None or not self.output.head.provenance.inputs:
            return self.stop.reason, ""
        return "", self.stop.reason

    def _finish(self, tally: Tally, stopped: str) -> RunSummary:
        if self.output is None:
            return tally.summary(None, stopped)
        path, parts = self.output.path, self.output.parts
        if parts is None:
            return tally.summary(path, stopped)
        try:
            summary = self._made_whole(self.output, parts, tally, stopped)
        except OutputError as error:
            if not parts.parts:
                raise
            raise OutputError(
                f"{error} All {tally.counts.steps} steps are safe in {folder_of(path)}; run the same command again."
            ) from error
        discard(path)
        return summary

    @staticmethod
    def _made_whole(output: Output, parts: PartsWriter, tally: Tally, stopped: str) -> RunSummary:
        """Make the results file, and return the summary; where all steps are in one open part, it becomes the file."""
        if parts.has_only_part_open and (output.overwrite or not output.path.exists()):
            summary = tally.summary(output.path, stopped)
            parts.publish(summary.to_mapping(), complete=not stopped, overwrite=output.overwrite)
            return summary
        parts.close_part()
        return assemble(
            output.path,
            output.head,
            output.tables(),
            output.bonds(),
            stopped=stopped,
            overwrite=output.overwrite,
            folder=folder_of(output.path),
        )

    def _say(self, alerts: Iterator[Alert], tally: Tally, *, again: bool = False) -> None:
        for alert in alerts:
            tally.alerts[alert.severity] += 1
            self.alert_file.write(alert, again=again)
            if again:
                continue
            if self.output is not None and self.output.parts is not None:
                self.output.parts.append_alert(alert)
            if self.on_alert is not None:
                self.on_alert(alert)


class _Shelf:
    """Puts measured blocks into parts, and closes one when it is long enough or the run ends, however it ends.

    A run that has measured all its steps before the first part was due leaves that one open, to become the results.
    """

    def __init__(self, parts: PartsWriter | None, length: PartLength) -> None:
        self.has_all = False
        self._parts = parts
        self._length = length
        self._begun = time.monotonic()

    def append(self, measured: Measured) -> None:
        """Keep the rows of a block in the open part, where parts are kept."""
        if self._parts is not None:
            self._parts.append(measured.table, *measured.bonds)

    def close_if_due(self) -> None:
        """Close the open part where it is old or long enough."""
        if self._parts is None:
            return
        age = time.monotonic() - self._begun
        if self._parts.n_open >= self._length.steps or age >= 60.0 * self._length.minutes:
            self._parts.close_part()
            self._begun = time.monotonic()

    def __enter__(self) -> "_Shelf":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._parts is None:
            return
        if kind is not None and issubclass(kind, OutputError):
            self._parts.abandon_part()
        elif not (kind is None and self.has_all and self._parts.has_only_part_open):
            self._parts.close_part()


def _n_steps(n_frames: int | None, frames: slice) -> int | None:
    if n_frames is None:
        return None
    return max(len(range(*frames.indices(n_frames))) - 1, 0)
