"""Two processes that compile one kernel at the same moment never mix up its signatures."""

from pathlib import Path
from typing import Any

import pytest
from numba.core.caching import IndexDataCacheFile

from mdtopo.kernelfiles import keep_signatures_apart

ONE, OTHER = ("int64",), ("float64",)


class Late(IndexDataCacheFile):
    """A process that has read the index before another one wrote it, and writes behind it."""

    def _load_index(self) -> dict[Any, str]:
        return {}


def numbas_own_save(self: Any, key: Any, data: Any) -> None:
    """As numba 0.61 to 0.67 has it: the next free number of what the index holds."""
    overloads = self._load_index()
    if key not in overloads:
        taken = set(overloads.values())
        overloads[key] = next(name for n in range(1, 99) if (name := self._data_name(n)) not in taken)
        self._save_index(overloads)
    self._save_data(overloads[key], data)


def opened(path: Path, kind: type[IndexDataCacheFile] = IndexDataCacheFile) -> IndexDataCacheFile:
    return kind(str(path), "kernel-1.py311", "stamp")


def test_a_late_writer_does_not_take_the_file_of_another_signature(tmp_path: Path) -> None:
    opened(tmp_path).save(ONE, "code of one")
    opened(tmp_path, Late).save(OTHER, "code of other")
    assert opened(tmp_path).load(OTHER) == "code of other"
    assert opened(tmp_path).load(ONE) in (None, "code of one")


@pytest.mark.parametrize("is_apart", [False, True])
def test_the_slower_code_does_not_stand_for_the_other_signature(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_apart: bool
) -> None:
    """The index of one is written last, and the code of the other: numba as it comes mixes them up."""
    if not is_apart:
        monkeypatch.setattr(IndexDataCacheFile, "save", numbas_own_save)
    one, other = opened(tmp_path, Late), opened(tmp_path, Late)
    save_data = other._save_data

    def save_slowly(name: str, data: Any) -> None:
        one.save(ONE, "code of one")
        save_data(name, data)

    monkeypatch.setattr(other, "_save_data", save_slowly)
    other.save(OTHER, "code of other")
    found = {key: opened(tmp_path).load(key) for key in (ONE, OTHER)}
    mixed = found[ONE] == "code of other" or found[OTHER] == "code of one"
    assert mixed == (not is_apart)


def test_what_is_saved_again_stays_where_it_is(tmp_path: Path) -> None:
    first = opened(tmp_path)
    for data in ("code", "the same code, compiled again"):
        first.save(ONE, data)
        first.save(OTHER, "other code")
        assert (first.load(ONE), first.load(OTHER)) == (data, "other code")
    assert len(list(tmp_path.glob("*.nbc"))) == 2


def test_kernels_are_kept_so() -> None:
    keep_signatures_apart()
    assert IndexDataCacheFile.save.__module__ == "mdtopo.kernelfiles"
