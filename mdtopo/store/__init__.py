"""The results file: HDF5, schema 1. No other package knows how it is laid out."""

from mdtopo.store.provenance import InputFile, Provenance, collect_provenance, fingerprint
from mdtopo.store.reader import Results, read_results
from mdtopo.store.schema import SCHEMA
from mdtopo.store.writer import ResultsWriter

__all__ = [
    "SCHEMA",
    "InputFile",
    "Provenance",
    "Results",
    "ResultsWriter",
    "collect_provenance",
    "fingerprint",
    "read_results",
]
