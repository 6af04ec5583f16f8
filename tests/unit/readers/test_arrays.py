import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdtopo.errors import InputError, OptionError, StrandError, TrajectoryError, UnknownFormatError
from mdtopo.readers.arrays import ArraysReader
from mdtopo.readers.base import ReaderRequest, Source
from mdtopo.records import Frame, Strands
from mdtopo.testing import Expectation, ReaderContract

N_FRAMES = 5
STRANDS = Strands.from_lengths([4, 3], closed=[False, True])
POSITIONS = np.random.default_rng(1).normal(scale=20.0, size=(N_FRAMES, 7, 3))
TIMES = np.arange(N_FRAMES) * 0.5
CELLS = np.stack([np.diag([50.0, 60.0, 70.0 + k]) for k in range(N_FRAMES)])


def arrays(**changes):
    """The arrays of a good file; a change to None leaves one out."""
    stored = {"positions": POSITIONS, "offsets": STRANDS.offsets, "closed": STRANDS.closed} | changes
    return {key: value for key, value in stored.items() if value is not None}


def open_file(path):
    return ArraysReader.open(Source(paths=(path,)), ReaderRequest())


def open_stored(tmp_path, **changes):
    np.savez(tmp_path / "run.npz", **arrays(**changes))
    return open_file(tmp_path / "run.npz")


def open_array(array, *, strands=STRANDS, **options):
    return ArraysReader.open(Source(object=array), ReaderRequest(strands=strands, options=options))


def expectation(positions=POSITIONS, *, times=None, cells=None, strands=STRANDS):
    return Expectation(
        frames=tuple(
            Frame(
                k,
                float("nan") if times is None else float(times[k]),
                positions[k].astype(np.float64),
                None if cells is None else cells[k],
            )
            for k in range(N_FRAMES)
        ),
        strands=strands,
    )


class OfFile(ReaderContract):
    reader_class = ArraysReader
    stored = arrays()
    truth = expectation()
    save = staticmethod(np.savez)

    @pytest.fixture
    def source(self, tmp_path):
        self.save(tmp_path / "run.npz", **self.stored)
        return Source(paths=(tmp_path / "run.npz",))

    @pytest.fixture
    def request_(self):
        return ReaderRequest()

    @pytest.fixture
    def expected(self):
        return self.truth


class TestLeastFile(OfFile):
    pass


class TestFullFile(OfFile):
    stored = arrays(time=TIMES, cell=CELLS, names=np.array(["α", "B"]))
    truth = expectation(
        times=TIMES,
        cells=CELLS,
        strands=Strands.from_lengths([4, 3], closed=[False, True], names=["α", "B"]),
    )


class TestCompressedFloat32File(OfFile):
    save = staticmethod(np.savez_compressed)
    stored = arrays(positions=POSITIONS.astype(np.float32), cell=CELLS[0].astype(np.float32))
    truth = expectation(POSITIONS.astype(np.float32), cells=[CELLS[0]] * N_FRAMES)


class TestFortranOrderFile(OfFile):
    stored = arrays(positions=np.asfortranarray(POSITIONS))


class TestBigEndianFile(OfFile):
    stored = arrays(positions=POSITIONS.astype(">f8"))


class TestArrayInMemory(OfFile):
    truth = expectation(times=TIMES, cells=CELLS)

    @pytest.fixture
    def source(self):
        return Source(object=POSITIONS.copy())

    @pytest.fixture
    def request_(self):
        return ReaderRequest(strands=STRANDS, options={"time": TIMES, "cell": CELLS})


class TestStridedFloat32InMemory(OfFile):
    truth = expectation(POSITIONS.astype(np.float32))

    @pytest.fixture
    def source(self):
        doubled = np.repeat(POSITIONS.astype(np.float32), 2, axis=1)
        return Source(object=doubled[:, ::2])

    @pytest.fixture
    def request_(self):
        return ReaderRequest(strands=STRANDS)


def test_takes_one_npz_file_or_an_array(tmp_path):
    assert ArraysReader.can_open(Source(paths=(tmp_path / "RUN.NPZ",)))
    assert not ArraysReader.can_open(Source(paths=(tmp_path / "run.npy",)))
    assert not ArraysReader.can_open(Source(paths=(tmp_path / "top.pdb", tmp_path / "run.npz")))
    assert not ArraysReader.can_open(Source(object=[[0.0, 0.0, 0.0]]))
    with pytest.raises(UnknownFormatError, match="takes one"):
        ArraysReader.open(Source(paths=(tmp_path / "a.npz", tmp_path / "b.npz")), ReaderRequest())
    with pytest.raises(UnknownFormatError, match="one array"):
        ArraysReader.open(Source(object=[1.0]), ReaderRequest())


def test_a_negative_step_reads_backwards(tmp_path):
    with open_stored(tmp_path) as reader:
        assert [frame.index for frame in reader.frames(None, None, -2)] == [4, 2, 0]
        assert all(np.array_equal(frame.positions, POSITIONS[frame.index]) for frame in reader.frames(3, 0, -1))


@given(st.slices(N_FRAMES))
def test_any_slice_is_a_python_slice(part):
    reader = open_array(POSITIONS)
    found = [frame.index for frame in reader.frames(part.start, part.stop, part.step)]
    assert found == list(range(N_FRAMES))[part]


def test_values_that_are_not_finite_are_passed_on(tmp_path):
    holed = POSITIONS.copy()
    holed[1, 2, 0] = np.nan
    with open_stored(tmp_path, positions=holed) as reader:
        assert [not frame.problem for frame in reader.frames(0, 3)] == [True, False, True]


@pytest.mark.parametrize("changes", [{"positions": None}, {"offsets": None}, {"closed": None}])
def test_a_missing_key_is_named(tmp_path, changes):
    (key,) = changes
    with pytest.raises(InputError, match=f"run.npz has no array '{key}'; it holds "):
        open_stored(tmp_path, **changes)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"positions": POSITIONS[0]}, InputError, r"shape \(7, 3\); expected \(n_frames, n, 3\)"),
        ({"positions": POSITIONS[:, :, :2]}, InputError, r"shape \(5, 7, 2\)"),
        ({"positions": POSITIONS[:0]}, TrajectoryError, "no frames"),
        ({"positions": POSITIONS.astype(str)}, InputError, "dtype <U"),
        ({"positions": POSITIONS > 0}, InputError, "dtype bool"),
        ({"positions": POSITIONS.astype(complex)}, InputError, "dtype complex128"),
        ({"positions": POSITIONS.astype(np.longdouble)}, InputError, "expected float64 or float32"),
        ({"offsets": [0, 3, 6]}, StrandError, "end at vertex 6, but each frame of .* holds 7"),
        ({"offsets": [0, 4, 8]}, StrandError, "end at vertex 8"),
        ({"offsets": [1, 4, 7]}, StrandError, "must rise from 0"),
        ({"offsets": [0, 8, 7]}, StrandError, "must rise from 0"),
        ({"offsets": [0]}, StrandError, "expected integers of shape"),
        ({"offsets": [[0, 7]]}, StrandError, r"shape \(1, 2\)"),
        ({"offsets": [0.0, 4.0, 7.0]}, StrandError, "dtype float64"),
        ({"offsets": [0, 6, 7]}, StrandError, "1 vertex"),
        ({"closed": [True]}, StrandError, r"shape \(1,\); expected \(2,\)"),
        ({"closed": [0.0, 1.0]}, StrandError, "expected booleans"),
        ({"closed": [0, 2]}, StrandError, "0 and 1"),
        ({"names": ["A"]}, StrandError, r"text of shape \(2,\)"),
        ({"names": [1, 2]}, StrandError, "dtype int64"),
        ({"names": [b"\xff", b"B"]}, StrandError, "UTF-8"),
        ({"time": TIMES[:-1]}, InputError, r"'time' of .* shape \(4,\); expected \(5,\)"),
        ({"time": TIMES.astype(str)}, InputError, "'time' of .* dtype"),
        (
            {"cell": [50.0, 60.0, 70.0]},
            InputError,
            r"'cell' of .* shape \(3,\); expected \(3, 3\) or \(5, 3, 3\)",
        ),
        ({"cell": CELLS[:2]}, InputError, r"shape \(2, 3, 3\)"),
    ],
)
def test_a_wrong_array_is_described(tmp_path, changes, error, words):
    with pytest.raises(error, match=words) as caught:
        open_stored(tmp_path, **changes)
    assert type(caught.value) is error
    assert "run.npz" in str(caught.value) or "Strand" in str(caught.value)


def test_closed_may_be_one_answer_and_integers(tmp_path):
    with open_stored(tmp_path, closed=True) as reader:
        assert reader.strands.closed.tolist() == [True, True]
    with open_stored(tmp_path, closed=[0, 1]) as reader:
        assert reader.strands.closed.tolist() == [False, True]


def test_names_may_be_bytes(tmp_path):
    with open_stored(tmp_path, names=np.array(["α".encode(), b"B"])) as reader:
        assert reader.strands.names == ("α", "B")


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("unpickled",))


@pytest.mark.parametrize("key", ["positions", "offsets", "names"])
def test_objects_are_never_unpickled(tmp_path, key):
    np.savez(tmp_path / "run.npz", **arrays(**{key: np.array([Bomb(), Bomb()], dtype=object)}))
    with pytest.raises(InputError, match=f"'{key}' of .*run.npz holds Python objects, which are never loaded"):
        open_file(tmp_path / "run.npz")


@pytest.mark.parametrize("content", [b"", b"no archive at all", b"PK\x03\x04", b"PK\x05\x06" + bytes(18)])
def test_a_file_that_is_no_archive_of_arrays(tmp_path, content):
    (tmp_path / "run.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"run\.npz"):
        open_file(tmp_path / "run.npz")


def test_a_truncated_file(tmp_path):
    np.savez(tmp_path / "run.npz", **arrays())
    content = (tmp_path / "run.npz").read_bytes()
    (tmp_path / "run.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(TrajectoryError, match="may be truncated"):
        open_file(tmp_path / "run.npz")


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_header_that_promises_too_much(tmp_path, compression):
    np.savez(tmp_path / "run.npz", **arrays())
    with zipfile.ZipFile(tmp_path / "run.npz", "w", compression) as archive:
        for key, value in arrays().items():
            stored = io.BytesIO()
            np.save(stored, value)
            archive.writestr(f"{key}.npy", stored.getvalue()[: -8 if key == "positions" else None])
    with pytest.raises(TrajectoryError, match=r"'positions' of .* says 840 bytes, but 832 are stored"):
        open_file(tmp_path / "run.npz")


def save_with_a_flipped_bit(path, dtype):
    """Save a hundred frames, more than zipfile reads ahead when the file is opened."""
    positions = np.tile(POSITIONS, (20, 1, 1)).astype(dtype)
    np.savez(path, **arrays(positions=positions))
    content = bytearray(path.read_bytes())
    content[content.index(positions.tobytes()) + 5] ^= 1
    path.write_bytes(content)


def test_a_flipped_bit_is_found_by_the_check_sum(tmp_path):
    save_with_a_flipped_bit(tmp_path / "run.npz", np.float64)
    with open_file(tmp_path / "run.npz") as reader:
        frames = reader.frames()
        for _ in range(N_FRAMES - 1):
            next(frames)
        with pytest.raises(TrajectoryError, match=r"Frame \d+ of .*run.npz cannot be read \(Bad CRC-32"):
            list(frames)


@given(place=st.floats(0, 1, exclude_max=True), mask=st.integers(1, 255), compressed=st.booleans())
def test_damage_gives_an_input_error_or_is_not_seen(tmp_path_factory, place, mask, compressed):
    path = tmp_path_factory.mktemp("damage") / "run.npz"
    (np.savez_compressed if compressed else np.savez)(path, **arrays(time=TIMES))
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= mask
    path.write_bytes(content)
    try:
        with open_file(path) as reader:
            found = [frame.positions for frame in reader.frames()]
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017 - the point is that either outcome is right
    else:
        assert np.array_equal(found, POSITIONS)


def test_a_selection_is_refused(tmp_path):
    np.savez(tmp_path / "run.npz", **arrays())
    with pytest.raises(OptionError, match="takes no selection, and 'name CA' was given"):
        ArraysReader.open(Source(paths=(tmp_path / "run.npz",)), ReaderRequest(select="name CA"))


def test_options_are_for_arrays_in_memory(tmp_path):
    np.savez(tmp_path / "run.npz", **arrays())
    with pytest.raises(OptionError, match=r"store 'time' in .*run.npz instead"):
        ArraysReader.open(Source(paths=(tmp_path / "run.npz",)), ReaderRequest(options={"time": TIMES}))


def test_an_array_needs_strands():
    with pytest.raises(StrandError, match="pass strands="):
        open_array(POSITIONS, strands=None)
    with pytest.raises(StrandError, match="end at vertex 6, but each frame of the array holds 7"):
        open_array(POSITIONS, strands=Strands.from_lengths([6]))
    with pytest.raises(InputError, match=r"the array have shape \(7, 3\)"):
        open_array(POSITIONS[0])
    with pytest.raises(InputError, match="'time' of the array is not an array of numbers"):
        open_array(POSITIONS, time=[[1.0], [1.0, 2.0]])


def test_strands_may_be_given_for_a_file_without_them(tmp_path):
    np.savez(tmp_path / "run.npz", positions=POSITIONS)
    request = ReaderRequest(strands=STRANDS)
    with ArraysReader.open(Source(paths=(tmp_path / "run.npz",)), request) as reader:
        assert reader.strands is STRANDS
    np.savez(tmp_path / "run.npz", **arrays())
    with pytest.raises(StrandError, match="strands of its own"):
        ArraysReader.open(Source(paths=(tmp_path / "run.npz",)), request)


def test_a_zero_cell_is_no_cell(tmp_path):
    cells = CELLS.copy()
    cells[1] = 0.0
    cells[3, 0, 0] = np.nan
    with open_stored(tmp_path, cell=cells) as reader:
        assert [frame.cell is None for frame in reader.frames()] == [False, True, False, True, False]
        assert reader.notes == ("The cell of 2 frames, the first being 1, is zero or not finite, "
                                "and is taken as not periodic.",)  # fmt: skip
    with open_stored(tmp_path, cell=np.zeros((3, 3))) as reader:
        assert [frame.cell for frame in reader.frames()] == [None] * N_FRAMES
        assert reader.notes == ("The cell is zero or not finite, and is taken as not periodic.",)
    with open_stored(tmp_path, cell=CELLS) as reader:
        assert reader.notes == ()


def test_arrays_that_are_not_read_are_named(tmp_path):
    with open_stored(tmp_path, box=CELLS) as reader:
        assert reader.notes == (f"These arrays of {tmp_path / 'run.npz'} are not read: box.",)


def test_the_coordinate_error_is_what_float32_rounds():
    # between 64 and 128 neighbouring float32 numbers are 2^-17 apart
    greatest = np.zeros((2, 7, 3))
    greatest[1, 3, 1] = -100.0
    assert open_array(greatest).coordinate_error == 0.0
    assert open_array(greatest.astype(np.int64)).coordinate_error == 0.0
    assert open_array(greatest.astype(np.float32)).coordinate_error == pytest.approx(3**0.5 * 2.0**-18, rel=1e-12)
    greatest[0, 0, 0] = np.inf
    assert open_array(greatest.astype(np.float32)).coordinate_error == pytest.approx(3**0.5 * 2.0**-18, rel=1e-12)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_rounding_to_float32_stays_below_the_coordinate_error(x, y, z):
    engine = np.array([[[x, y, z], [0.0, 0.0, 0.0]]])
    reader = open_array(engine.astype(np.float32), strands=Strands.from_lengths([2]))
    (frame,) = reader.frames()
    assert np.linalg.norm(frame.positions - engine[0], axis=1).max() <= reader.coordinate_error


def test_the_coordinate_error_of_a_damaged_file_covers_the_frames_that_can_be_read(tmp_path):
    save_with_a_flipped_bit(tmp_path / "run.npz", np.float32)
    with open_file(tmp_path / "run.npz") as reader:
        assert 0.0 < reader.coordinate_error < 1e-5


def test_a_closed_reader_says_so(tmp_path):
    reader = open_stored(tmp_path)
    reader.close()
    with pytest.raises(TrajectoryError, match="closed"):
        next(reader.frames())


def test_memory_does_not_grow_with_the_frames(tmp_path):
    import tracemalloc

    np.savez(tmp_path / "run.npz", **arrays(positions=np.tile(POSITIONS, (2000, 1, 1))))
    with open_file(tmp_path / "run.npz") as reader:
        tracemalloc.start()
        count = sum(1 for _ in reader.frames())
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert count == 2000 * N_FRAMES
    assert peak < 2**19  # the positions take 1.6 MiB
