"""What MDAnalysis warns of, as log lines."""

import logging
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
    "Failed to guess the mass for the following atom types",
    "Not all velocities were present.",
    "Reader has no dt information, set to 1.0 ps",
)
"""How warnings of MDAnalysis begin that change nothing here: velocities and masses are not used, and a
missing box is said in the reader's notes."""


@contextmanager
def mdanalysis_warnings_logged(subject: str) -> Iterator[None]:
    """Turn warnings into log lines while the body, a call of MDAnalysis and nothing else, runs.

    Every warning is recorded, so none is raised under ``-W error``. The harmless ones are logged at debug
    level. The body must be short: other threads' warnings are caught too.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for text in dict.fromkeys(one_line(warning.message) for warning in caught):
        level = logging.DEBUG if text.startswith(HARMLESS) else logging.WARNING
        _log.log(level, "MDAnalysis says of %s: %s", subject, text)


def one_line(message: object) -> str:
    """Return a message, or the name of its class where it is empty, as one line of at most 300 characters."""
    return " ".join(str(message).split())[:300] or type(message).__name__
