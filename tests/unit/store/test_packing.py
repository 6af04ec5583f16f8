import h5py
import numpy as np
import pytest

from mdtopo.store.columns import create_column, extend, open_column
from mdtopo.store.packing import packed
from mdtopo.store.schema import CHUNK_ROWS, Layout

RNG = np.random.default_rng(7)
KINDS = {
    "lengths": RNG.normal(size=2 * CHUNK_ROWS + 9),
    "vectors": RNG.normal(size=(CHUNK_ROWS + 1, 3)),
    "small lengths": RNG.normal(size=CHUNK_ROWS + 1).astype(np.float32),
    "pairs": RNG.integers(-1, 2000, (CHUNK_ROWS + 1, 2, 2)),
    "codes": RNG.integers(0, 3, CHUNK_ROWS + 1).astype(np.int8),
    "flags": RNG.random(CHUNK_ROWS + 1) < 0.5,
    "names": np.array([f"A{k % 77}".encode() for k in range(CHUNK_ROWS + 1)]),
    "nothing": np.full(CHUNK_ROWS + 1, np.nan),
    "negative zeros": np.full((CHUNK_ROWS + 1, 3), -0.0),
}


def stored(path, values, *parts):
    """Return what HDF5 reads of rows that were added in such parts, and of how many bytes the dataset is."""
    with h5py.File(path, "w") as file:
        create_column(file, "x", Layout(values.dtype, "", row_shape=values.shape[1:]))
        for start, stop in zip((0, *parts), (*parts, len(values)), strict=True):
            extend(open_column(file, "x"), values[start:stop])
    with h5py.File(path) as file:
        return file["x"][()], file["x"].id.get_storage_size()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, CHUNK_ROWS // 16, CHUNK_ROWS // 16 + 1, CHUNK_ROWS, CHUNK_ROWS + 1, None])
def test_hdf5_reads_what_was_packed(kind, count, tmp_path):
    values = KINDS[kind][:count]
    found, _ = stored(tmp_path / "a.h5", values)
    assert (found.dtype, found.shape, found.tobytes()) == (values.dtype, values.shape, values.tobytes())


@pytest.mark.parametrize("parts", [(1,), (CHUNK_ROWS,), (CHUNK_ROWS - 1, CHUNK_ROWS + 1), (5, 7, 2 * CHUNK_ROWS)])
def test_rows_may_come_in_parts_that_begin_within_a_chunk(parts, tmp_path):
    values = KINDS["lengths"]
    assert stored(tmp_path / "a.h5", values, *parts)[0].tobytes() == values.tobytes()


@pytest.mark.parametrize("count", [64, CHUNK_ROWS // 16, CHUNK_ROWS])
@pytest.mark.parametrize("kind", ["lengths", "vectors", "small lengths", "pairs", "codes"])
def test_a_chunk_is_hardly_larger_than_what_hdf5_makes_of_it(kind, count, tmp_path):
    values = KINDS[kind][:count]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        chunks = (CHUNK_ROWS, *values.shape[1:])
        how = {"maxshape": (None, *chunks[1:]), "chunks": chunks, "compression": 4, "shuffle": True}
        plain = file.create_dataset("x", data=values, **how)
        file.flush()
        assert len(packed(values, CHUNK_ROWS * values[0].size)) <= 1.05 * plain.id.get_storage_size()


def test_equal_rows_are_told_apart_by_their_number_and_their_value():
    some = [packed(np.full(n, x), CHUNK_ROWS) for n in (3, 4) for x in (0.0, -0.0, 1.0)]
    assert len({*some}) == 5  # zeros are the fill value
    assert packed(np.zeros(3), CHUNK_ROWS) != packed(np.zeros(3), 2 * CHUNK_ROWS)
