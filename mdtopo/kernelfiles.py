"""Compiled kernels on disk: each signature in a file of its own, whoever writes at the same moment.

numba keeps an index of the signatures of a kernel, and gives the machine code of a new one the next free number. Two
processes that compile one kernel for two signatures at the same moment, as the jobs of an array do that start on an
empty cache, both take the same number: in the end the one's signature may stand for the other's code, and its numbers
are wrong from then on, without a word.
"""

import hashlib
from typing import Any

from numba.core.caching import IndexDataCacheFile
from numba.core.serialize import dumps

DIGEST = 7
"""Bytes of the digest that names a file: two of a million signatures of one kernel share one with odds of 10^-5."""


def keep_signatures_apart() -> None:
    """Let numba name the files of compiled kernels after their signatures, for the whole process.

    What is there already is still found. Proven for writers of any number: the index of a signature names a file that
    only that signature is ever written to. Of two that write the index at the same moment one may be lost, and is
    compiled again.
    """
    IndexDataCacheFile.save = _save  # type: ignore[method-assign]


def _save(self: Any, key: Any, data: Any) -> None:
    """Save compiled code; the code first, so that the index names no file that is not there."""
    pickled: bytes = dumps(key)  # type: ignore[no-untyped-call]
    name = self._data_name(int.from_bytes(hashlib.sha256(pickled).digest()[:DIGEST], "big"))
    self._save_data(name, data)
    overloads = self._load_index()
    if overloads.get(key) != name:
        overloads[key] = name
        self._save_index(overloads)
