"""From any input to step tables and step reports: the part of the job that writes nothing."""

import os
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdtopo.bonds import BondState, reference_lengths
from mdtopo.curverows import refuse_long_strands
from mdtopo.errors import InputError, OptionError, TrajectoryError
from mdtopo.kernelcache import announce_compilation
from mdtopo.measure import measure_plan
from mdtopo.pipeline.ahead import read_ahead
from mdtopo.pipeline.framing import frame_blocks, lead_in, refuse_winding
from mdtopo.planning import BlockPlan, Setting, plan_block, reference_samples
from mdtopo.readers import Reader, ReaderRequest, Source, open_reader
from mdtopo.records import FrameBlock, MonitorConfig, ReferenceLengths, StepReport, StepTable, Strands

ALL_FRAMES = slice(None)

SPARE = 1
"""Blocks that are planned beyond the next one: threads find them while a result is being written, which takes longer
where a file is begun or a chunk of it is full."""


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
    threads: int | None = None,
) -> Iterator[StepReport]:
    """Yield what each step measures and proves, in order; parameters as for `monitor`.

    Memory does not grow with the trajectory. The reader is closed when the generator ends.
    """
    opened = open_input(*inputs, select=select, strands=strands, reader=reader, reader_options=reader_options)
    with opened:
        settled = replace(with_coordinate_error(config or MonitorConfig(), opened), profile_steps=0)
        for table in step_tables(opened, frames=frames, config=settled, threads=threads):
            yield from table.reports()


def with_coordinate_error(config: MonitorConfig, reader: Reader) -> MonitorConfig:
    """Return the configuration with what the reader knows of the coordinate error, unless it holds one already.

    Certificates need it: without, they would claim to hold before the file rounded its coordinates.
    """
    if config.coordinate_error is not None:
        return config
    return replace(config, coordinate_error=reader.coordinate_error)


def step_tables(
    reader: Reader,
    *,
    frames: slice = ALL_FRAMES,
    config: MonitorConfig,
    threads: int | None = None,
    on_reference: Callable[[ReferenceLengths], None] | None = None,
) -> Iterator[StepTable]:
    """Yield the measures of all steps of a reader's frames, block by block and in order; see `measured_blocks`."""
    blocks = measured_blocks(reader, frames=frames, config=config, threads=threads, on_reference=on_reference)
    return (measured.table for measured in blocks)


@dataclass(frozen=True, slots=True)
class Measured:
    """The steps of a block, and the bonds after its first frame and after its last one."""

    table: StepTable
    bonds: tuple[BondState, BondState]


@dataclass(frozen=True, slots=True)
class Restart:
    """Where a run goes on: its next step, the frame that this step begins with, and the bonds after that frame."""

    step: int
    frame: int
    bonds: BondState


def measured_blocks(
    reader: Reader,
    *,
    frames: slice = ALL_FRAMES,
    config: MonitorConfig,
    threads: int | None = None,
    on_reference: Callable[[ReferenceLengths], None] | None = None,
    restart: Restart | None = None,
    bonds: BondState | None = None,
    ahead: bool = False,
) -> Generator[Measured, None, None]:
    """Yield the measures of all steps of a reader's frames, block by block and in order.

    Memory is bounded: at most two blocks wait to be measured, and one for each thread is being measured or is done.

    Parameters
    ----------
    reader : Reader
        Read by one thread at a time.
    frames : slice
        Which frames are analysed.
    config : MonitorConfig
    threads : int, optional
        How many threads measure blocks while the next ones are read; by default `default_threads`. The tables do not
        depend on it, bit for bit.
    on_reference : callable, optional
        Called with the reference lengths of the edges before the first table.
    restart : Restart, optional
        Where to go on; by default at the first of `frames`.
    bonds : BondState, optional
        The bonds after the first of `frames`, where another run has judged it; by default it is the first to be judged.
    ahead : bool
        Whether a thread of its own reads frames ahead. Not for an object of somebody who may use it meanwhile.

    Raises
    ------
    OptionError
        If `threads` is below 1.
    StrandError
        If a ring closes through the periodic boundary in the first frame, or a strand is too long for its curve.
    TrajectoryError
        When a frame cannot be read; the steps before it have been yielded by then.
    """
    check_frames(reader, frames)
    threads = settled_threads(threads)
    resume_at = None if restart is None else restart.frame
    first, stream = lead_in(reader, frames, config.reference_frames, resume_at)
    if not first:
        next(stream, None)  # raises what kept the first frame from being read
        return
    announce_compilation()
    reference = reference_lengths(reference_samples(first, reader.strands))
    refuse_winding(first[0], reader.strands)
    refuse_long_strands(reader.strands, config.curve)
    if on_reference is not None:
        on_reference(reference)
    setting = Setting.start(reader.strands, config, reference)
    known = bonds if restart is None else restart.bonds
    if known is not None:
        setting = setting.behind(known)
    periodic, first_step = first[0].cell is not None, 0 if restart is None else restart.step
    blocks = frame_blocks(stream, config.block_steps, periodic=periodic, first_step=first_step)
    with closing(read_ahead(blocks) if ahead else blocks) as ready:
        yield from _measured(_planned(ready, setting), setting, threads)


def check_frames(reader: Reader, frames: slice) -> None:
    """Refuse a frame range that is no slice, runs backward, or selects nothing.

    Raises
    ------
    InputError
        If it does.
    """
    if not isinstance(frames, slice):
        raise InputError(f"frames is {frames!r}; pass a slice, such as slice(0, None, 10).")
    if frames.step is not None and frames.step < 1:
        raise InputError(f"The frame range has the step {frames.step}; it must be 1 or more: time runs forward.")
    if reader.n_frames is not None and not range(reader.n_frames)[frames]:
        raise InputError(f"The frame range selects none of the {reader.n_frames} frames; they are counted from 0.")


def check_end(reader: Reader, frames: slice) -> None:
    """Refuse to cut a frame range into shards where the file ends early: the last shard would not know of it.

    Raises
    ------
    TrajectoryError
        If the range strides over the last frame, and that one cannot be read.
    """
    if reader.n_frames is not None and frames.step not in (None, 1):
        last = range(reader.n_frames)[frames][-1]
        for _ in reader.frames(last, frames.stop, frames.step):
            pass


def _planned(blocks: Iterator[FrameBlock], setting: Setting) -> Iterator[BlockPlan]:
    for block in blocks:
        plan, setting = plan_block(block, setting)
        yield plan


def _measured(plans: Iterator[BlockPlan], setting: Setting, threads: int) -> Iterator[Measured]:
    """Yield the tables of the plans, in order, measured by threads while the next plans are made.

    If making a plan fails, the tables before it are yielded first. If measuring one fails, or nobody wants more, what
    has not begun is not begun.
    """
    waiting: deque[tuple[BlockPlan, Future[StepTable]]] = deque()
    failure: TrajectoryError | None = None
    pool = ThreadPoolExecutor(threads, thread_name_prefix="mdtopo")
    try:
        while failure is None:
            try:
                plan = next(plans, None)
            except TrajectoryError as error:
                failure = error
                break
            if plan is None:
                break
            waiting.append((plan, pool.submit(measure_plan, plan, setting.strands, setting.config)))
            while len(waiting) > threads + SPARE or (waiting and waiting[0][1].done()):
                yield _next_measured(waiting)
        while waiting:
            yield _next_measured(waiting)
    finally:
        pool.shutdown(cancel_futures=True)
    if failure is not None:
        raise failure


def _next_measured(waiting: deque[tuple[BlockPlan, Future[StepTable]]]) -> Measured:
    plan, future = waiting.popleft()
    return Measured(future.result(), plan.bonds)


def settled_threads(threads: int | None) -> int:
    """Return how many threads measure, by default `default_threads`.

    Raises
    ------
    OptionError
        If fewer than one are asked for.
    """
    if threads is not None and threads < 1:
        raise OptionError(f"threads is {threads}; it must be at least 1.")
    return default_threads() if threads is None else threads


def default_threads() -> int:
    """Return the number of threads to use: SLURM_CPUS_PER_TASK where it is set, else the cores of this process."""
    allotted = os.environ.get("SLURM_CPUS_PER_TASK", "")
    if allotted.isdigit() and int(allotted) > 0:
        return int(allotted)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
