"""Calls of MDAnalysis: its warnings become log lines, and its failed readers leave nothing behind."""

import gc
import logging
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

_log = logging.getLogger("mdtopo.readers.mdanalysis")

HARMLESS = (
    "DCDReader currently makes independent timesteps",
    "Cannot write lock/offset file in same location as",
    "Reload offsets from trajectory",
    "Reading offsets from",
    "Failed to load offsets file",
    "Couldn't save offsets because",
    "Unit cell dimensions not found.",
    "1 A^3 CRYST1 record",
    "Element information is missing",
    "Unknown element",
    "Unknown elements found",
    "Empty box",
    "Unknown masses are set to 0.0",
    "No coordinate reader found for",
    "Cannot close a netcdf_file opened with mmap=True",
    "there is no reference attributes",
    "The TRZ reader is deprecated",
    "Failed to guess the mass for the following atom types",
    "Not all velocities were present.",
    "Reader has no dt information, set to 1.0 ps",
)
"""How warnings of MDAnalysis begin that change nothing here: velocities and masses are not used, and a
missing box is said in the reader's notes."""


@contextmanager
def mdanalysis_call(subject: str) -> Iterator[None]:
    """Turn warnings into log lines while the body, a call of MDAnalysis and nothing else, runs.

    Every warning is recorded, so none is raised under ``-W error``. The harmless ones are logged at debug
    level. The body must be short: other threads' warnings are caught too. When the call fails, the half-made
    readers that it leaves behind are taken away at once: their destructors fail as well and would print a
    traceback.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        except Exception as error:
            _destroy_leftovers(error)
            raise
        finally:
            texts = dict.fromkeys(one_line(warning.message) for warning in caught)
    for text in texts:
        level = logging.DEBUG if text.startswith(HARMLESS) else logging.WARNING
        _log.log(level, "MDAnalysis says of %s: %s", subject, text)


def _destroy_leftovers(error: BaseException) -> None:
    announced, sys.unraisablehook = sys.unraisablehook, _log_unraisable
    try:
        failure: BaseException | None = error
        while failure is not None:
            traceback.clear_frames(failure.__traceback__)
            failure = failure.__cause__ or failure.__context__
        gc.collect()
    finally:
        sys.unraisablehook = announced


def _log_unraisable(failure: "sys.UnraisableHookArgs") -> None:
    _log.debug("MDAnalysis failed again in clearing up: %s", failure.exc_value)


def one_line(message: object) -> str:
    """Return a message, or the name of its class where it is empty, as one line of at most 300 characters."""
    return " ".join(str(message).split())[:300] or type(message).__name__
