"""Whether the kernels are compiled already, and where numba keeps them.

numba itself chooses the place: ``NUMBA_CACHE_DIR`` if that is set, else beside the package where that can be written,
else a directory of the user. A key of its index names the signature, the processor and the bytecode.
"""

import logging
from pathlib import Path
from typing import Any

from mdtopo.blocks import measure_steps

log = logging.getLogger("mdtopo")


def announce_compilation() -> None:
    """Log one line if the kernels are to be compiled now, because that takes long and looks like a hang."""
    directory = cold_cache()
    if directory is not None:
        log.info("Compiling the kernels, once, for about two minutes; they are kept in %s.", directory)


def cold_cache() -> Path | None:
    """Return the directory where the kernels will be kept, if they are yet to be compiled; None if they are there.

    Heuristic: it asks for the one kernel that nearly all of the time is spent on. numba offers no public way to ask,
    so where its insides have changed the answer is None.
    """
    try:
        if measure_steps.signatures:
            return None
        return None if _is_stored(measure_steps) else Path(str(measure_steps.stats.cache_path))
    except (
        Exception
    ):  # a line of information must not cost the run; under NUMBA_DISABLE_JIT there is no dispatcher either
        return None


def _is_stored(kernel: Any) -> bool:
    processor = kernel.targetctx.codegen().magic_tuple()
    return any(key[1] == processor for key in kernel._cache._cache_file._load_index())
