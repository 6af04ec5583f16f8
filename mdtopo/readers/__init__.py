"""Plugins that turn an input into frames: the contract, and the registry that finds who keeps it.

Nothing heavy is imported here; a reader's module is imported when the reader is asked for the first time.
"""

from mdtopo.readers.base import Reader, ReaderRequest, Source
from mdtopo.readers.registry import BrokenReader, ReaderListing, installed_readers, open_reader

__all__ = [
    "BrokenReader",
    "Reader",
    "ReaderListing",
    "ReaderRequest",
    "Source",
    "installed_readers",
    "open_reader",
]
