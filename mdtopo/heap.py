"""Memory that a step has freed is kept for the next step.

The C library of Linux gives freed memory back to the system above a limit of some hundred kilobytes, and asks for it
again with the next array: the system then clears it page by page, which can cost more than what is computed in it.
"""

import ctypes
import os
from functools import cache

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Names of limits in glibc's malloc.h; see mallopt(3)."""

MOST_KEPT = 256 << 20
"""Bytes that are free and stay with the process: more than a step of 200,000 edges needs beside its positions."""

LARGEST_KEPT = 8 << 20
"""Bytes. Greater arrays go back at once, because what is kept in one piece comes to lie in the way of other arrays."""

SAID_OTHERWISE = ("MALLOC_", "GLIBC_TUNABLES")


@cache
def keep_freed_memory() -> None:
    """Let the C library keep what is freed, for the whole process, from the first call on.

    Nothing is taken that was not in use before. Limits that were set in the environment (``MALLOC_…``,
    ``GLIBC_TUNABLES``) stand, and C libraries other than glibc are left alone.
    """
    if any(name.startswith(SAID_OTHERWISE) for name in os.environ):
        return
    library = ctypes.CDLL(None) if os.name == "posix" else None
    if hasattr(library, "gnu_get_libc_version") and library is not None:
        library.mallopt(M_MMAP_THRESHOLD, LARGEST_KEPT)
        library.mallopt(M_TRIM_THRESHOLD, MOST_KEPT)
