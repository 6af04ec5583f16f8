from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdtopo.errors import InputError
from mdtopo.records.shards import frames_text, shard_frames


def test_neighbours_share_one_frame() -> None:
    assert shard_frames(11, slice(None), 4) == [slice(0, 4, 1), slice(3, 7, 1), slice(6, 11, 1)]


@pytest.mark.parametrize(("steps", "count"), [(9, 2), (10, 1), (11, 1)])
def test_one_shard_is_enough_up_to_its_length(steps: int, count: int) -> None:
    assert len(shard_frames(11, slice(None), steps)) == count


def test_a_single_frame_is_one_shard_without_steps() -> None:
    assert shard_frames(1, slice(None)) == [slice(0, 1, 1)]


@pytest.mark.parametrize("frames", [slice(20, None), slice(5, 5), slice(0)])
def test_no_frames_are_refused(frames: slice) -> None:
    with pytest.raises(InputError, match="selects none of the 11 frames"):
        shard_frames(11, frames)


def test_a_shard_without_steps_is_refused() -> None:
    with pytest.raises(InputError, match="at least 1"):
        shard_frames(11, slice(None), 0)


@given(
    n_frames=st.integers(1, 300),
    start=st.none() | st.integers(-300, 300),
    stop=st.none() | st.integers(-300, 300),
    stride=st.integers(1, 40),
    steps=st.integers(1, 80),
)
def test_every_step_is_in_exactly_one_shard(
    n_frames: int, start: int | None, stop: int | None, stride: int, steps: int
) -> None:
    frames = slice(start, stop, stride)
    analysed = list(range(n_frames)[frames])
    if not analysed:
        return
    shards = [list(range(n_frames)[shard]) for shard in shard_frames(n_frames, frames, steps)]
    pairs = [pair for shard in shards for pair in pairwise(shard)]
    assert pairs == list(pairwise(analysed))
    lengths = [len(shard) - 1 for shard in shards]
    assert max(lengths) <= max(steps, 1)
    assert max(lengths) - min(lengths) <= 1


@pytest.mark.parametrize("text", ["0:5", "2:7:4"])
def test_a_range_in_words_is_read_back(text: str) -> None:
    from mdtopo.cli.options import frame_slice

    found = frame_slice(text)
    assert frames_text(found) == text
