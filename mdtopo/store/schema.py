"""What the results file holds: names, types, units and descriptions, for the writer and the reader alike.

========== ==============================================================================================
group      holds
========== ==============================================================================================
/steps     one dataset for each column of `StepTable`, one row for each step; attribute ``first_step``
/crossings one dataset for each column of `Crossings`, one row for each crossing, by step, object and time
/alerts    one dataset for each field of the JSON lines, one row for each alert; attribute ``schema``
/stretches edges beyond their stretch limit, one row for each edge and step
/problems  steps with a frame that cannot be used, one row each
/profile   clearance of every vertex in the closest step of each window; attribute ``window_frames``
/strands   which vertices form which strand, how they are called, reference lengths, broken edges
========== ==============================================================================================

Attributes of the file: ``schema`` (this number), ``config``, ``request``, ``provenance``, ``summary`` (JSON) and
``complete``, which is written last. A group that a version of mdtopo does not write is absent.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import h5py
import numpy as np

from mdtopo.records import Column, Grade, Shape

SCHEMA = 1
"""Rises when a program that reads the file would have to change."""

OLDEST_SCHEMA = 1
"""The first one that is still read; what is added within a schema is absent in files that were written before."""

CHUNK_ROWS = 4096
"""Rows of a chunk, and rows that the writer holds back until it writes them."""

TEXT = h5py.string_dtype("utf-8")
"""Text of any length."""


def column_dtype(column: Column) -> np.dtype[Any]:
    """Return the dtype of a step column: an HDF5 enum on int8, int64 for indices, float64 for the rest."""
    return np.dtype(column.dtype) if column.enum is None else enum_dtype(column.enum)


def enum_dtype(enum: type[IntEnum]) -> np.dtype[Any]:
    """Return the HDF5 enum of the codes, on int8."""
    dtype: np.dtype[Any] = h5py.enum_dtype({member.name: member.value for member in enum}, basetype="i1")
    return dtype


@dataclass(frozen=True, slots=True)
class Layout:
    """One dataset: its dtype, the shape of one row, its unit and its description."""

    dtype: Any
    description: str
    unit: str = ""
    row_shape: tuple[int, ...] = ()


CROSSINGS = {
    "step": Layout(np.int64, "the step"),
    "frame_t0": Layout(np.int64, "frame index at the step's start"),
    "frame_t1": Layout(np.int64, "frame index at the step's end"),
    "t": Layout(np.float64, "time within the step, from 0 to 1"),
    "edges": Layout(
        np.int64,
        "vertices [[a, b], [c, d]] of the two edges, each in strand order; the edge with the lower first vertex comes "
        "first",
        row_shape=(2, 2),
    ),
    "parameters": Layout(np.float64, "where on the edges, from 0 (first vertex) to 1", row_shape=(2,)),
    "point": Layout(
        np.float64, "where in space: on the first edge, in the coordinates of the step's first frame", "Å", (3,)
    ),
    "sign": Layout(np.int64, "+1 where det(a - c, b - a, d - c) rises through zero, -1 where it falls"),
    "image": Layout(
        np.int64,
        "lattice counts that bring the second edge, as the first frame stores its first vertex, to the first edge",
        row_shape=(3,),
    ),
    "grade": Layout(enum_dtype(Grade), "what the crossing says about the physics"),
    "object": Layout(enum_dtype(Shape), "what crossed: the polyline or the smooth curve"),
    "motion": Layout(np.float64, "greatest relative motion of the two edges in the step", "Å"),
    "resolution": Layout(np.float64, "resolution length of the pair; a motion below it makes it RESOLVED", "Å"),
}
"""The columns of `Crossings`, in their order."""

ALERTS = {
    "id": Layout(TEXT, "stable identity of the alert"),
    "kind": Layout(TEXT, "what the alert is about"),
    "severity": Layout(TEXT, "info, warning or critical"),
    "step_start": Layout(np.int64, "first step of the event"),
    "step_peak": Layout(np.int64, "worst step of the event"),
    "step_end": Layout(np.int64, "last step of the event"),
    "frame_start": Layout(np.int64, "first frame of the first step"),
    "frame_end": Layout(np.int64, "last frame of the last step"),
    "time_start": Layout(np.float64, "time of the first frame; NaN where unknown", "ps"),
    "time_end": Layout(np.float64, "time of the last frame; NaN where unknown", "ps"),
    "strands": Layout(TEXT, "names of the strands concerned, a JSON list"),
    "residues": Layout(TEXT, "labels of the vertices concerned, a JSON list"),
    "value": Layout(np.float64, "the worst value; NaN where null in the JSON lines"),
    "limit": Layout(np.float64, "the limit that it met; NaN where null in the JSON lines"),
    "message": Layout(TEXT, "the event in one sentence"),
    "object": Layout(TEXT, "what it is about: polyline or curve"),
}
"""The fields of the JSON lines, in their order."""

STRETCHES = {
    "step": Layout(np.int64, "the step at whose end the edge was longer than its stretch limit"),
    "edge": Layout(np.int64, "the two vertices of the edge, in strand order", row_shape=(2,)),
    "ratio": Layout(np.float64, "length over reference length"),
    "limit": Layout(np.float64, "the stretch limit, as such a ratio"),
}
"""The columns of `Stretches`; with them alerts can be raised again from a file."""

PROBLEMS = {
    "step": Layout(np.int64, "the step"),
    "text": Layout(TEXT, "what is wrong with one of its frames"),
}
"""Steps that could not be measured."""

PROFILE = {
    "window": Layout(
        np.int64,
        "the window; it begins with frame window * window_frames. One in which nothing could be measured has no row",
    ),
    "step": Layout(np.int64, "the window's step of least clearance"),
    "least": Layout(np.float64, "the clearance of that step", "Å"),
    "clearance": Layout(
        np.float32,
        "proven lower bound of the distance, during that step, of every pair of edges of which one ends in the vertex, "
        "one column for each vertex; NaN where there is no pair",
        "Å",
    ),
}
"""The columns of `Profile`."""

STRANDS = {
    "offsets": Layout(np.int64, "strand s holds the vertices offsets[s] to offsets[s + 1] - 1"),
    "closed": Layout(np.bool_, "whether a closing edge joins the last vertex to the first"),
    "names": Layout(TEXT, "what the strand is called"),
    "vertex_atom": Layout(np.int64, "0-based index of the vertex's atom in the input file"),
    "vertex_resid": Layout(np.int64, "residue number of the vertex"),
    "gap_vertices": Layout(np.int64, "last vertex before a cut and first one after it", row_shape=(2,)),
    "gap_reason": Layout(TEXT, "why there is no edge"),
}
"""Strands: what `Strands` holds, but for its texts of one value for each vertex."""

VERTEX_TEXTS = {
    "vertex_label": "the vertex in words: chain, residue name and number",
    "vertex_chain": "chain or molecule",
    "vertex_icode": "insertion code",
    "vertex_resname": "residue name",
    "vertex_name": "atom name",
}
"""Texts of the vertices, in UTF-8 of one fixed length, which is small and fast for a million vertices."""

REFERENCE = {
    "edge": Layout(np.int64, "the two vertices of each edge, in strand order", row_shape=(2,)),
    "reference_length": Layout(
        np.float64,
        "median length over the first frames; attributes: median, spread, n_frames of all edges",
        "Å",
    ),
}
"""Reference lengths; absent when none were given."""

BROKEN = {
    "broken_step": Layout(np.int64, "the step whose end frame settled that the edge is broken"),
    "broken_frame": Layout(np.int64, "that frame"),
    "broken_edge": Layout(np.int64, "the two vertices of the edge, in strand order", row_shape=(2,)),
    "broken_ratio": Layout(np.float64, "length over reference length in that frame"),
    "broken_limit": Layout(np.float64, "the fracture limit, as such a ratio"),
}
"""Edges that broke, in the order in which they did."""
