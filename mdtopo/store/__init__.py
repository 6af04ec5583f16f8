"""The results file: HDF5, schema 1. No other package knows how it is laid out."""

from mdtopo.store.identity import differences
from mdtopo.store.lock import OutputLock
from mdtopo.store.parts import (
    Head,
    Part,
    PartsWriter,
    discard,
    finished_parts,
    folder_of,
    make_folder,
    part_tables,
    read_state,
    remove_folder,
)
from mdtopo.store.provenance import InputFile, Provenance, collect_provenance, fingerprint
from mdtopo.store.reader import Results, read_results
from mdtopo.store.running import read_running, read_so_far
from mdtopo.store.schema import SCHEMA
from mdtopo.store.tables import stored_tables
from mdtopo.store.writer import ResultsWriter

__all__ = [
    "SCHEMA",
    "Head",
    "InputFile",
    "OutputLock",
    "Part",
    "PartsWriter",
    "Provenance",
    "Results",
    "ResultsWriter",
    "collect_provenance",
    "differences",
    "discard",
    "fingerprint",
    "finished_parts",
    "folder_of",
    "make_folder",
    "part_tables",
    "read_results",
    "read_running",
    "read_so_far",
    "read_state",
    "remove_folder",
    "stored_tables",
]
