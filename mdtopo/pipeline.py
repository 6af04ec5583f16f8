"""The whole job: reader → blocks of frames → step tables → alerts → results. The only place where they meet."""

import json
import logging
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from mdtopo.alerts import AlertStream, count_steps
from mdtopo.bonds import reference_lengths
from mdtopo.errors import InputError, OutputError, StrandError, TrajectoryError
from mdtopo.kernelcache import announce_compilation
from mdtopo.measure import Setting, measure_block, reference_samples, ring_windings
from mdtopo.readers import Reader, ReaderRequest, Source, open_reader
from mdtopo.records import (
    Alert,
    Frame,
    FrameBlock,
    MonitorConfig,
    ReferenceLengths,
    RunSummary,
    Severity,
    StepCounts,
    StepReport,
    StepTable,
    Strands,
    run_verdict,
)
from mdtopo.store import ResultsWriter, collect_provenance

log = logging.getLogger("mdtopo")

ALL_FRAMES = slice(None)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run has come: steps done, steps in all (None for a stream), alerts so far."""

    steps: int
    total: int | None
    alerts: int


@dataclass(slots=True)
class Tally:
    """What a run has come to so far."""

    config: MonitorConfig
    counts: StepCounts = field(default_factory=StepCounts)
    n_fractures: int = 0
    alerts: Counter[Severity] = field(default_factory=Counter)
    clearance: tuple[float, int] = (np.nan, -1)
    ratio: tuple[float, int] = (np.nan, -1)

    def add(self, table: StepTable) -> None:
        """Count the steps of a table."""
        self.counts += count_steps(table, self.config)
        self.n_fractures += len(table.broken)
        self.clearance = _extreme(self.clearance, -table.clearance, table.first_step, sign=-1.0)
        self.ratio = _extreme(self.ratio, table.pair_ratio, table.first_step, sign=1.0)

    def summary(self, results: Path | None, stopped: str) -> RunSummary:
        """Return the summary of the run."""
        warnings = self.alerts[Severity.WARNING] + self.alerts[Severity.CRITICAL]
        verdict = run_verdict(self.counts, self.n_fractures, warnings)
        alerts = {severity: self.alerts[severity] for severity in Severity}
        return RunSummary(
            verdict, self.counts, self.n_fractures, alerts, *self.clearance, *self.ratio, results, stopped
        )


def _extreme(
    best: tuple[float, int], values: "np.ndarray[Any, np.dtype[np.float64]]", first_step: int, *, sign: float
) -> tuple[float, int]:
    """Return the better of the best so far and the greatest of `values`, as (sign x value, step)."""
    if not len(values) or np.isnan(values).all():
        return best
    row = int(np.nanargmax(values))
    if best[1] >= 0 and sign * best[0] >= values[row]:
        return best
    return sign * float(values[row]), first_step + row


def open_input(
    *inputs: Any,
    select: str | None = None,
    strands: Strands | None = None,
    reader: str | None = None,
    reader_options: Mapping[str, Any] | None = None,
) -> Reader:
    """Return an open reader of the given input.

    Parameters
    ----------
    *inputs
        File paths (topology first, then the trajectory), or one Universe, AtomGroup, array or Reader.
    select : str, optional
        Which atoms are the backbone, in the reader's own language.
    strands : Strands, optional
        The strands of an array, which holds none itself.
    reader : str, optional
        Name of the reader to use.
    reader_options : mapping, optional
        Options of that reader by name.

    Raises
    ------
    InputError
        If the input cannot be opened.
    """
    if not inputs:
        raise InputError("There is no input; pass file paths, a Universe, an AtomGroup, an array or a Reader.")
    if all(isinstance(item, str | os.PathLike) for item in inputs):
        source = Source(paths=tuple(Path(item) for item in inputs))
    elif len(inputs) == 1:
        source = Source(object=inputs[0])
    else:
        raise InputError("Pass either file paths, or one Python object; not several objects.")
    request = ReaderRequest(select, dict(reader_options or {}), strands)
    return open_reader(source, request, reader=reader)


def steps(
    *inputs: Any,
    select: str | None = None,
    strands: Strands | None = None,
    frames: slice = ALL_FRAMES,
    config: MonitorConfig | None = None,
    reader: str | None = None,
    reader_options: Mapping[str, Any] | None = None,
) -> Iterator[StepReport]:
    """Yield what each step measures and proves, in order; parameters as for `monitor`.

    Memory does not grow with the trajectory. The reader is closed when the generator ends.
    """
    opened = open_input(*inputs, select=select, strands=strands, reader=reader, reader_options=reader_options)
    with opened:
        for table in step_tables(opened, frames=frames, config=config or MonitorConfig()):
            yield from table.reports()


def step_tables(
    reader: Reader,
    *,
    frames: slice = ALL_FRAMES,
    config: MonitorConfig,
    on_reference: Callable[[ReferenceLengths], None] | None = None,
) -> Iterator[StepTable]:
    """Yield the measures of all steps of a reader's frames, block by block.

    Raises
    ------
    StrandError
        If a ring closes through the periodic boundary in the first frame.
    TrajectoryError
        When a frame cannot be read; the steps before it have been yielded by then.
    """
    first, stream = _lead_in(reader, frames, config.reference_frames)
    if not first:
        return
    announce_compilation()
    reference = reference_lengths(reference_samples(first, reader.strands))
    if on_reference is not None:
        on_reference(reference)
    refuse_winding(first[0], reader.strands)
    periodic = first[0].cell is not None
    if not periodic:
        log.info("The first frame has no periodic box; the run is treated as not periodic.")
    setting = Setting.start(reader.strands, config, reference)
    for block in frame_blocks(stream, config.block_steps, periodic=periodic):
        table, setting = measure_block(block, setting)
        yield table


def _lead_in(reader: Reader, frames: slice, n_reference: int) -> tuple[list[Frame], Iterator[Frame]]:
    """Return the trajectory's first frames, and the stream of analysed frames; read once where they overlap."""
    from_start = frames.start in (None, 0) and frames.step in (None, 1)
    if from_start and (frames.stop is None or frames.stop >= n_reference or reader.n_frames is None):
        stream = reader.frames(frames.start, frames.stop, frames.step)
        first, failure = _take(stream, n_reference)
        return first, chain(first, _raising(failure), stream)
    first, failure = _take(reader.frames(0, n_reference, 1), n_reference)
    if failure is not None and not first:
        raise failure
    return first, reader.frames(frames.start, frames.stop, frames.step)


def _take(stream: Iterator[Frame], n: int) -> tuple[list[Frame], TrajectoryError | None]:
    """Return up to n frames, and the error that ended them early, if one did."""
    taken: list[Frame] = []
    try:
        taken.extend(islice(stream, n))
    except TrajectoryError as error:
        return taken, error
    return taken, None


def _raising(failure: TrajectoryError | None) -> Iterator[Frame]:
    if failure is not None:
        raise failure
    yield from ()


def frame_blocks(frames: Iterator[Frame], block_steps: int, *, periodic: bool) -> Iterator[FrameBlock]:
    """Yield the frames in blocks that share one frame; a frame that cannot be used carries the reason.

    If the stream fails, the frames before the failure are yielded first, then the error is raised.
    """
    carried = next(frames, None)
    if carried is None:
        return
    first_step, failure = 0, None
    while failure is None:
        taken, failure = _take(frames, block_steps)
        if not taken:
            break
        yield block_of([carried, *taken], first_step, periodic=periodic)
        carried, first_step = taken[-1], first_step + len(taken)
    if failure is not None:
        raise failure


def refuse_winding(frame: Frame, strands: Strands) -> None:
    """Refuse rings that close through the periodic boundary, by name.

    Raises
    ------
    StrandError
        If there is such a ring in the frame, the trajectory's first.
    """
    if frame.cell is None or frame_problem(frame, periodic=True):
        return
    for name, winding in ring_windings(frame, strands):
        raise StrandError(
            f"Ring {name!r} closes through the periodic boundary (winding {winding} in frame {frame.index}); mdtopo "
            "does not handle such a ring. Leave it out of the selection."
        )


def block_of(frames: Sequence[Frame], first_step: int, *, periodic: bool) -> FrameBlock:
    """Return consecutive analysed frames as one block.

    Parameters
    ----------
    frames : sequence of Frame
        At least one.
    first_step : int
        The step that joins the first two.
    periodic : bool
        Whether the run is periodic, as its trajectory's first frame says.
    """
    empty = np.full((3, 3), np.nan)
    cells = np.stack([frame.cell if frame.cell is not None else empty for frame in frames])
    return FrameBlock(
        first_step,
        np.array([frame.index for frame in frames], dtype=np.int64),
        np.array([frame.time for frame in frames]),
        np.stack([frame.positions for frame in frames]),
        cells if periodic else None,
        tuple(frame_problem(frame, periodic=periodic) for frame in frames),
    )


def frame_problem(frame: Frame, *, periodic: bool) -> str:
    """Return why a frame cannot be used in a run, in words; empty where it can."""
    if periodic and frame.cell is None:
        return "it has no periodic box, unlike the trajectory's first frame"
    if not periodic and frame.cell is not None:
        return "it has a periodic box, unlike the trajectory's first frame"
    return frame.problem


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
    config = config or MonitorConfig()
    with ExitStack() as stack:
        opened = stack.enter_context(
            open_input(*inputs, select=select, strands=strands, reader=reader, reader_options=reader_options)
        )
        config = _with_coordinate_error(config, opened)
        alert_file = stack.enter_context(AlertFile(alerts, overwrite=overwrite))
        writer = None
        if out is not None:
            origin = collect_provenance(_paths(inputs), argv=argv or [])
            writer = stack.enter_context(
                ResultsWriter.create(Path(out), opened.strands, config, origin, overwrite=overwrite)
            )
        for note in opened.notes:
            log.info("%s", note)
        job = _Job(opened, frames, config, alert_file, writer, on_alert, on_progress)
        return job.run(Path(out) if out is not None else None)


def _paths(inputs: tuple[Any, ...]) -> list[Path]:
    return [Path(item) for item in inputs if isinstance(item, str | os.PathLike)]


def _with_coordinate_error(config: MonitorConfig, reader: Reader) -> MonitorConfig:
    if config.coordinate_error is not None:
        return config
    return replace(config, coordinate_error=reader.coordinate_error)


@dataclass(slots=True)
class _Job:
    """One run of `monitor`, with all that it holds open."""

    reader: Reader
    frames: slice
    config: MonitorConfig
    alert_file: "AlertFile"
    writer: ResultsWriter | None
    on_alert: Callable[[Alert], None] | None
    on_progress: Callable[[Progress], None] | None

    def run(self, results: Path | None) -> RunSummary:
        tally, stopped = Tally(self.config), ""
        stream = AlertStream(self.reader.strands, self.config)
        total = _n_steps(self.reader.n_frames, self.frames)
        self._say(stream.opening(), tally)
        on_reference = self.writer.add_reference if self.writer is not None else None
        tables = step_tables(self.reader, frames=self.frames, config=self.config, on_reference=on_reference)
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


class AlertFile:
    """The alert stream as JSON Lines: one object per line, one write per line, flushed at once.

    Parameters
    ----------
    target : path or None
        A file, a named pipe, ``-`` for standard output, or None for nowhere.
    overwrite : bool
        Whether an existing file may be replaced; a pipe or device is written to in any case.

    Raises
    ------
    OutputError
        If the file exists already, or cannot be written.
    """

    def __init__(self, target: str | os.PathLike[str] | None, *, overwrite: bool = False) -> None:
        self._target = target
        self._overwrite = overwrite
        self._file: IO[str] | None = None

    def __enter__(self) -> "AlertFile":
        if self._target is None:
            return self
        if str(self._target) == "-":
            self._file = sys.stdout
            return self
        path = Path(self._target)
        if path.is_file() and not self._overwrite:
            raise OutputError(f"The alert file {path} exists already; choose another name, or pass --overwrite.")
        try:
            self._file = path.open("w", encoding="utf-8")
        except OSError as error:
            raise OutputError(f"The alert file {path} cannot be written: {error.strerror}.") from error
        return self

    def write(self, alert: Alert) -> None:
        """Write one line."""
        if self._file is None:
            return
        try:
            self._file.write(json.dumps(alert.to_mapping(), ensure_ascii=False, allow_nan=False) + "\n")
            self._file.flush()
        except OSError as error:
            raise OutputError(f"An alert could not be written to {self._target}: {error.strerror}.") from error

    def __exit__(self, *_: object) -> None:
        if self._file is not None and self._file is not sys.stdout:
            self._file.close()
