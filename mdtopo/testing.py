"""What the author of a reader plugin inherits to show that the reader keeps its contract.

Nothing here imports pytest before a test runs.
"""

# ruff: noqa: D102 - a test's name says what it shows

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from mdtopo.errors import OptionError
from mdtopo.readers.base import Reader, ReaderRequest, Source
from mdtopo.readers.registry import open_with
from mdtopo.records import Frame, Strands

FORWARD_SLICES = (
    slice(None),
    slice(1, None),
    slice(None, 2),
    slice(None, None, 2),
    slice(1, None, 3),
    slice(2, 2),
    slice(10**9, None),
    slice(0, 10**9),
)
"""Slices that a stream can answer too."""

COUNTED_SLICES = (slice(-2, None), slice(-(10**9), None), slice(None, -1), slice(-3, -1, 2), slice(-1, 0))
"""Slices that need the number of frames."""

NONSENSE = Source(paths=(Path("nobody-reads.mdtopo-nonsense"),))
"""A source that no reader takes; nothing may be read to find that out, so it need not exist."""


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a reader must find in the source.

    Attributes
    ----------
    frames : tuple of Frame
        Every frame, in order; at least three show something.
    strands : Strands
        The strands; names and closing edges are compared as well.
    """

    frames: tuple[Frame, ...]
    strands: Strands


class ReaderContract:
    """The tests that every reader passes.

    A subclass whose name starts with ``Test`` sets `reader_class` and defines three pytest fixtures:
    ``source``, a `Source` that the reader takes; ``request_``, the `ReaderRequest` to open it with; and
    ``expected``, the `Expectation`, known in another way than by the reader. Values are compared bit by bit.

    Examples
    --------
    ::

        class TestMyReader(ReaderContract):
            reader_class = MyReader

            @pytest.fixture
            def source(self, tmp_path):
                (tmp_path / "run.my").write_text(...)
                return Source(paths=(tmp_path / "run.my",))

            @pytest.fixture
            def request_(self):
                return ReaderRequest(options={"stride": "2"})

            @pytest.fixture
            def expected(self):
                return Expectation(frames=(Frame(0, 0.0, positions), ...), strands=Strands.from_lengths([12]))
    """

    reader_class: ClassVar[type[Reader]]

    def _open(self, source: Source, request: ReaderRequest) -> Reader:
        return open_with(self.reader_class, source, request)

    def _read(self, source: Source, request: ReaderRequest, part: slice = slice(None)) -> list[Frame]:
        with closing(self._open(source, request)) as reader:
            return list(reader.frames(part.start, part.stop, part.step))

    def test_it_describes_itself_in_one_line(self) -> None:
        assert self.reader_class.summary, "summary is empty"
        assert "\n" not in self.reader_class.summary, "summary has several lines"
        for name, text in self.reader_class.option_help.items():
            assert text, f"the option {name!r} has no help"

    def test_it_takes_its_own_source(self, source: Source) -> None:
        assert self.reader_class.can_open(source) is True

    def test_it_leaves_nonsense_to_others(self) -> None:
        assert self.reader_class.can_open(NONSENSE) is False
        assert self.reader_class.can_open(Source(object=object())) is False

    def test_it_counts_its_frames(self, source: Source, request_: ReaderRequest, expected: Expectation) -> None:
        with closing(self._open(source, request_)) as reader:
            assert reader.n_frames in {None, len(expected.frames)}

    def test_frames_are_those_expected(self, source: Source, request_: ReaderRequest, expected: Expectation) -> None:
        _assert_same_frames(self._read(source, request_), expected.frames)

    def test_slices_are_python_slices(self, source: Source, request_: ReaderRequest, expected: Expectation) -> None:
        with closing(self._open(source, request_)) as reader:
            is_stream = reader.n_frames is None
        for part in FORWARD_SLICES if is_stream else FORWARD_SLICES + COUNTED_SLICES:
            _assert_same_frames(self._read(source, request_, part), expected.frames[part], f"{part}: ")

    def test_strands_are_those_expected_and_stay(
        self, source: Source, request_: ReaderRequest, expected: Expectation
    ) -> None:
        with closing(self._open(source, request_)) as reader:
            _assert_same_strands(reader.strands, expected.strands)
            for frame in reader.frames():
                assert len(frame.positions) == reader.strands.n_vertices, "vertices and strands do not agree"
            _assert_same_strands(reader.strands, expected.strands)

    def test_arrays_are_positions(self, source: Source, request_: ReaderRequest) -> None:
        for frame in self._read(source, request_):
            assert frame.positions.dtype == np.float64, f"frame {frame.index} is {frame.positions.dtype}"
            assert frame.positions.flags.c_contiguous, f"frame {frame.index} is not C-contiguous"
            assert frame.positions.flags.writeable, f"frame {frame.index} is read-only"
            assert frame.cell is None or frame.cell.shape == (3, 3), f"frame {frame.index}: cell of a wrong shape"
            assert type(frame.index) is int, f"frame {frame.index}: the index is no plain int"
            assert type(frame.time) is float, f"frame {frame.index}: the time is no plain float"

    def test_no_frame_is_overwritten(self, source: Source, request_: ReaderRequest, expected: Expectation) -> None:
        with closing(self._open(source, request_)) as reader:
            frames = list(reader.frames())
        _assert_same_frames(frames, expected.frames, "after closing, ")
        arrays = [array for frame in frames for array in (frame.positions, frame.cell) if array is not None]
        for i, array in enumerate(arrays):
            for other in arrays[:i]:
                assert not np.shares_memory(array, other), "two arrays share memory"

    def test_a_frame_may_be_changed_by_its_owner(
        self, source: Source, request_: ReaderRequest, expected: Expectation
    ) -> None:
        with closing(self._open(source, request_)) as reader:
            for frame, truth in zip(reader.frames(), expected.frames, strict=True):
                _assert_same_frames([frame], [truth], "after the frame before was changed, ")
                frame.positions[:] = -1.0
                if frame.cell is not None:
                    frame.cell[:] = -1.0
            if reader.n_frames is not None:
                _assert_same_frames(list(reader.frames()), expected.frames, "in the second pass, ")

    def test_two_passes_at_once(self, source: Source, request_: ReaderRequest, expected: Expectation) -> None:
        with closing(self._open(source, request_)) as reader:
            if reader.n_frames is None:
                import pytest

                pytest.skip("a stream is read once")
            ahead, behind = reader.frames(1), reader.frames()
            pairs = list(zip(ahead, behind, strict=False))
        _assert_same_frames([later for later, _ in pairs], expected.frames[1:], "ahead, ")
        _assert_same_frames([earlier for _, earlier in pairs], expected.frames[:-1], "behind, ")

    def test_an_unfinished_pass_may_be_dropped(self, source: Source, request_: ReaderRequest) -> None:
        reader = self._open(source, request_)
        passing: Iterator[Frame] = reader.frames()
        next(passing)
        del passing
        reader.close()

    def test_closing_twice_is_no_error(self, source: Source, request_: ReaderRequest) -> None:
        reader = self._open(source, request_)
        reader.close()
        reader.close()

    def test_it_is_a_context_manager(self, source: Source, request_: ReaderRequest) -> None:
        reader = self._open(source, request_)
        with reader as entered:
            assert entered is reader
        reader.close()

    def test_an_unknown_option_is_refused(self, source: Source, request_: ReaderRequest) -> None:
        import pytest

        name = "mdtopo-nonsense"
        with pytest.raises(OptionError, match=name):
            self._open(source, replace(request_, options={**request_.options, name: "1"})).close()

    def test_the_coordinate_error_is_a_length(self, source: Source, request_: ReaderRequest) -> None:
        with closing(self._open(source, request_)) as reader:
            assert 0.0 <= reader.coordinate_error < float("inf")

    def test_notes_are_sentences(self, source: Source, request_: ReaderRequest) -> None:
        with closing(self._open(source, request_)) as reader:
            for note in reader.notes:
                assert note.endswith("."), f"not a sentence: {note!r}"


def _assert_same_frames(found: list[Frame], expected: "list[Frame] | tuple[Frame, ...]", where: str = "") -> None:
    assert [frame.index for frame in found] == [frame.index for frame in expected], f"{where}other frames"
    for one, other in zip(found, expected, strict=True):
        place = f"{where}frame {other.index}"
        assert np.array_equal(one.time, other.time, equal_nan=True), f"{place}: {one.time} ps, not {other.time}"
        assert np.array_equal(one.positions, other.positions, equal_nan=True), f"{place}: other positions"
        assert (one.cell is None) == (other.cell is None), f"{place}: the cell is {one.cell}, not {other.cell}"
        if one.cell is not None and other.cell is not None:
            assert np.array_equal(one.cell, other.cell), f"{place}: the cell is {one.cell}, not {other.cell}"


def _assert_same_strands(found: Strands, expected: Strands) -> None:
    assert found.offsets.tolist() == expected.offsets.tolist(), "other offsets"
    assert found.closed.tolist() == expected.closed.tolist(), "other closing edges"
    assert found.names == expected.names, "other names"
    assert len(found.labels.resid) == found.n_vertices, "labels and vertices do not agree"
