"""The whole job over a trajectory: measure every step, raise alerts, write the results."""

import logging
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mdtopo.alerts import AlertStream
from mdtopo.errors import TrajectoryError
from mdtopo.pipeline.alertfile import AlertFile
from mdtopo.pipeline.tables import (
    ALL_FRAMES,
    check_frames,
    default_threads,
    open_input,
    step_tables,
    with_coordinate_error,
)
from mdtopo.pipeline.tally import Progress, Tally
from mdtopo.readers import Reader
from mdtopo.records import Alert, MonitorConfig, RunSummary, Strands
from mdtopo.store import ResultsWriter, collect_provenance

log = logging.getLogger("mdtopo")


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

    Returns
    -------
    RunSummary
        The verdict and the counts. Where the trajectory could not be read to its end, `stopped` says why; what was read
        until then is in the results, which are marked as incomplete.

    Raises
    ------
    InputError
        If the input cannot be opened or has no usable strands.
    OutputError
        If an output exists already, or cannot be written.

    Guarantee
    ---------
    Proven: a step that counts as proved has no passage along the linear motion between its two frames; what the strands
    did between the frames in truth is not known to anyone.
    """
    config, threads = config or MonitorConfig(), threads or default_threads()
    with ExitStack() as stack:
        opened = stack.enter_context(
            open_input(*inputs, select=select, strands=strands, reader=reader, reader_options=reader_options)
        )
        check_frames(opened, frames)
        config = with_coordinate_error(config, opened)
        alert_file = stack.enter_context(AlertFile(alerts, overwrite=overwrite))
        writer = None
        if out is not None:
            request = {
                "select": select,
                "frames": [frames.start, frames.stop, frames.step],
                "reader": reader,
                "reader_options": dict(reader_options or {}),
            }
            origin = collect_provenance(_paths(inputs), argv=argv or [], threads=threads)
            writer = stack.enter_context(
                ResultsWriter.create(Path(out), opened.strands, config, origin, request=request, overwrite=overwrite)
            )
        for note in opened.notes:
            log.info("%s", note)
        job = _Job(opened, frames, config, threads, alert_file, writer, on_alert, on_progress)
        return job.run(Path(out) if out is not None else None)


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
    writer: ResultsWriter | None
    on_alert: Callable[[Alert], None] | None
    on_progress: Callable[[Progress], None] | None

    def run(self, results: Path | None) -> RunSummary:
        tally, stopped = Tally(self.config), ""
        stream = AlertStream(self.reader.strands, self.config)
        total = _n_steps(self.reader.n_frames, self.frames)
        self._say(stream.opening(), tally)
        on_reference = self.writer.add_reference if self.writer is not None else None
        tables = step_tables(
            self.reader, frames=self.frames, config=self.config, threads=self.threads, on_reference=on_reference
        )
        try:
            for table in tables:
                tally.add(table)
                if self.writer is not None:
                    self.writer.append(table)
                self._say(stream.after(table), tally)
                if self.on_progress is not None:
                    self.on_progress(Progress(tally.counts.steps, total, sum(tally.alerts.values())))
        except TrajectoryError as error:
            stopped = str(error)
        self._say(stream.finish(), tally)
        summary = tally.summary(results, stopped)
        if self.writer is not None:
            self.writer.finish(summary.to_mapping(), complete=not stopped)
        return summary

    def _say(self, alerts: Iterator[Alert], tally: Tally) -> None:
        for alert in alerts:
            tally.alerts[alert.severity] += 1
            self.alert_file.write(alert)
            if self.writer is not None:
                self.writer.append_alert(alert)
            if self.on_alert is not None:
                self.on_alert(alert)


def _n_steps(n_frames: int | None, frames: slice) -> int | None:
    if n_frames is None:
        return None
    return max(len(range(*frames.indices(n_frames))) - 1, 0)
