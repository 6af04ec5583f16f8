"""Memory that was freed is there again without the system clearing it anew."""

import os
import platform
import subprocess
import sys

import pytest

PAGES = """
import resource, sys
import numpy as np
from mdtopo.heap import keep_freed_memory

def new_pages():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.ones(1 << 17) for _ in range(16)]  # 16 MiB
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

if sys.argv[1] == "keep":
    keep_freed_memory()
new_pages(), new_pages()
print(new_pages())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc is known to give memory back at once")
def test_memory_is_cleared_once_and_not_again_and_again() -> None:
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_"))}

    def pages(mode: str, **limits: str) -> int:
        command = [sys.executable, "-c", PAGES, mode]
        run = subprocess.run(command, capture_output=True, check=True, text=True, env=plain | limits)
        return int(run.stdout)

    cleared = pages("as it is")
    assert cleared > 1000  # of 4096
    assert pages("keep") < 0.1 * cleared
    assert pages("keep", MALLOC_TRIM_THRESHOLD_="131072") > 1000  # who has said otherwise is heard
