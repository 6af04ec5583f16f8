"""How a trajectory is cut into shards: ranges of frames whose steps follow each other without gap or overlap."""

from itertools import pairwise

from mdtopo.errors import InputError

SHARD_STEPS = 10_000
"""Steps of a shard, unless another number is asked for."""


def shard_frames(n_frames: int, frames: slice, steps: int = SHARD_STEPS) -> list[slice]:
    """Return frame ranges that hold every step of the analysed frames exactly once.

    Consecutive shards share one frame, the last of one and the first of the next, because a step joins two frames. The
    shards differ by at most one step in length, so that none of them is a stub.

    Parameters
    ----------
    n_frames : int
        Frames of the trajectory.
    frames : slice
        Which of them are analysed.
    steps : int
        Greatest number of steps in a shard.

    Raises
    ------
    InputError
        If no frame is selected, or `steps` is below 1.

    Examples
    --------
    >>> shard_frames(11, slice(None), steps=4)
    [slice(0, 4, 1), slice(3, 7, 1), slice(6, 11, 1)]
    >>> shard_frames(11, slice(2, None, 4), steps=1)
    [slice(2, 7, 4), slice(6, 11, 4)]
    """
    analysed = range(n_frames)[frames]
    if not analysed:
        raise InputError(f"The frame range selects none of the {n_frames} frames; they are counted from 0.")
    if steps < 1:
        raise InputError(f"A shard of {steps} steps was asked for; it must hold at least 1.")
    n_steps = len(analysed) - 1
    n_shards = max(-(-n_steps // steps), 1)
    edges = [n_steps * shard // n_shards for shard in range(n_shards + 1)]
    return [slice(analysed[first], analysed[last] + 1, analysed.step) for first, last in pairwise(edges)]


def frames_text(frames: slice) -> str:
    """Return a range of frames as ``--frames`` takes it.

    Examples
    --------
    >>> frames_text(slice(2, 7, 4)), frames_text(slice(0, 5, 1))
    ('2:7:4', '0:5')
    """
    stride = f":{frames.step}" if frames.step not in (None, 1) else ""
    return f"{frames.start}:{frames.stop}{stride}"
