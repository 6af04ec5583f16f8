"""From a stream of frames to blocks that can be measured: what is read when, and which frames can be used."""

from collections.abc import Generator, Iterator, Sequence
from itertools import chain, islice

import numpy as np

from mdtopo.curves import greatest_magnitudes
from mdtopo.errors import StrandError, TrajectoryError
from mdtopo.planning import ring_windings
from mdtopo.readers import Reader
from mdtopo.records import Frame, FrameBlock, Strands
from mdtopo.records.frames import LARGEST_COORDINATE


def lead_in(
    reader: Reader, frames: slice, n_reference: int, resume_at: int | None = None
) -> tuple[list[Frame], Iterator[Frame]]:
    """Return the trajectory's first frames, and the stream of analysed frames; read once where they overlap.

    With `resume_at`, the stream begins with that frame, which is one of the analysed ones.
    """
    if resume_at is not None and reader.n_frames is None:  # a stream can be read once only, from its start
        first, stream = lead_in(reader, frames, n_reference)
        return first, (frame for frame in stream if frame.index >= resume_at)
    if resume_at is not None:
        frames = slice(resume_at, frames.stop, frames.step)
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


def frame_blocks(
    frames: Iterator[Frame], block_steps: int, *, periodic: bool, first_step: int = 0
) -> Generator[FrameBlock, None, None]:
    """Yield the frames in blocks that share one frame; a frame that cannot be used carries the reason.

    If the stream fails, the frames before the failure are yielded first, then the error is raised.
    """
    carried = next(frames, None)
    if carried is None:
        return
    failure = None
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
    positions = np.stack([frame.positions for frame in frames])
    sound = (greatest_magnitudes(positions) <= LARGEST_COORDINATE).tolist()  # not where one is NaN
    return FrameBlock(
        first_step,
        np.array([frame.index for frame in frames], dtype=np.int64),
        np.array([frame.time for frame in frames]),
        positions,
        cells if periodic else None,
        tuple(frame_problem(*each, periodic=periodic) for each in zip(frames, sound, strict=True)),
    )


def frame_problem(frame: Frame, has_sound_coordinates: bool = False, *, periodic: bool) -> str:
    """Return why a frame cannot be used in a run, in words; empty where it can.

    Its coordinates are looked at unless they are known to be sound.
    """
    if periodic and frame.cell is None:
        return "it has no periodic box, unlike the trajectory's first frame"
    if not periodic and frame.cell is not None:
        return "it has a periodic box, unlike the trajectory's first frame"
    return frame.cell_problem if has_sound_coordinates else frame.problem
