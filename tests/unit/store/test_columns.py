from enum import IntEnum

import h5py
import numpy as np
import pytest

from mdtopo.store.columns import create_column, extend, open_column
from mdtopo.store.schema import CHUNK_ROWS, TEXT, Layout, enum_dtype


class Shade(IntEnum):
    DARK = 0
    LIGHT = 1


LAYOUTS = {
    "number": (Layout(np.float64, "how far", "Å"), [1.5, np.nan, -0.0]),
    "index": (Layout(np.int64, "which"), [3, -1, 2**40]),
    "flag": (Layout(np.bool_, "whether"), [True, False, True]),
    "vector": (Layout(np.float32, "where to", "Å", (3,)), np.arange(9.0).reshape(3, 3)),
    "code": (Layout(enum_dtype(Shade), "what"), [0, 1, 1]),
    "text": (Layout(TEXT, "in words"), ["α", "", "two words"]),
    "short_text": (Layout(h5py.string_dtype("utf-8", 4), "label"), [b"A", b"", "é".encode()]),
}


def plain_column(group: h5py.Group, name: str, layout: Layout) -> h5py.Dataset:
    """Return what h5py's own call makes."""
    dataset = group.create_dataset(
        name,
        shape=(0, *layout.row_shape),
        maxshape=(None, *layout.row_shape),
        chunks=(CHUNK_ROWS, *layout.row_shape),
        dtype=layout.dtype,
        compression="gzip",
        shuffle=True,
        track_times=False,
    )
    dataset.attrs["unit"] = layout.unit
    dataset.attrs["description"] = layout.description
    return dataset


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_column_is_what_the_plain_calls_of_h5py_make(name, tmp_path):
    layout, values = LAYOUTS[name]
    rows = np.array(values, layout.dtype)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        plain = plain_column(file.create_group("plain"), name, layout)
        for part in (rows[:1], rows[1:]):
            plain.resize(len(plain) + len(part), axis=0)
            plain[-len(part) :] = part
        ours = file.create_group("ours")
        extend(create_column(ours, name, layout), rows[:1])
        extend(open_column(ours, name), rows[1:])
        extend(open_column(ours, name), rows[:0])
    with h5py.File(tmp_path / "a.h5") as file:
        expected, found = file["plain"][name], file["ours"][name]
        assert found.id.get_type().encode() == expected.id.get_type().encode()
        assert (found.shape, found.maxshape, found.chunks) == (expected.shape, expected.maxshape, expected.chunks)
        assert found.id.get_create_plist().equal(expected.id.get_create_plist())
        assert found[()].tobytes() == expected[()].tobytes() or found[()].tolist() == expected[()].tolist()
        assert dict(found.attrs) == dict(expected.attrs) == {"unit": layout.unit, "description": layout.description}
        for key in expected.attrs:
            ids = [h5py.h5a.open(dataset.id, key.encode()) for dataset in (found, expected)]
            assert ids[0].get_type().encode() == ids[1].get_type().encode()
            assert ids[0].get_space().get_simple_extent_type() == ids[1].get_space().get_simple_extent_type()


def test_numbers_of_another_width_are_stored_as_the_column_has_them(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        extend(create_column(file, "index", Layout(np.int64, "which")), np.array([1, 2], np.int32))
        extend(open_column(file, "index"), np.arange(6)[::2])
        assert file["index"].dtype == np.int64
        assert file["index"][()].tolist() == [1, 2, 0, 2, 4]
