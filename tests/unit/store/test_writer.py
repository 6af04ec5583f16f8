import numpy as np
import pytest

from mdtopo.store.writer import _encoded


@pytest.mark.parametrize(
    "texts", [["a", "bcd", ""], [""], ["é", "ab"], ["\udc80x", "y"], ["a\0b", "c"], ["αβγ", "abcd"]]
)
def test_texts_are_encoded_as_numpy_encodes_them_one_by_one(texts):
    wide = np.array(texts).astype("U12")
    expected = np.char.encode(wide, "utf-8", "backslashreplace")
    found = _encoded(wide)
    assert (found.dtype, found.tolist()) == (expected.dtype, expected.tolist())
