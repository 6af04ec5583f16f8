"""Memory that a step has freed is kept for the next step.

The C library of Linux gives freed memory back to the system above a limit of some hundred kilobytes, and asks for it
again with the next array: the system then clears it page by page, which can cost more than what is computed in it.
"""

from functools import cache

import numpy as np

OF_A_STEP = 4 << 20
"""Bytes. The arrays of a step of some ten thousand edges are smaller; those of a greater one may go, and take less."""

OF_A_RUN = 31 << 20
"""Bytes. Blocks of frames are as large, and several are on their way. The C library heeds no more than 32 MiB."""


@cache
def keep_freed_memory(size: int) -> None:
    """Let the C library keep what is freed, up to twice this size, from the first call on.

    glibc raises its limits to the size of a block that is freed, and to twice that size (mallopt(3), "dynamic mmap
    threshold"). Such a block is asked for and freed at once; nobody touches it, so that it takes no memory. Limits that
    were set in the environment (``MALLOC_…``) stand, and other C libraries do not care.

    Parameters
    ----------
    size : int
        Bytes: `OF_A_STEP` or `OF_A_RUN`.
    """
    np.empty(size, dtype=np.uint8)
