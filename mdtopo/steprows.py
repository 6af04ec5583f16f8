"""What is measured of a step, as one record: the memory that the kernels write to, and that step tables look into.

Its fields are the columns of `StepTable` that are about the polyline, under the same names, and a few that are only
needed on the way. One array of records costs less to make, and to hand to a kernel, than forty columns.
"""

import math
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mdtopo.records import Rung, StepTable

StepRow: TypeAlias = Any
"""One record. Kernels write to its fields."""

StepRows: TypeAlias = NDArray[Any]
"""Records of type `ROW`, one for each step."""

EXACT, OPEN = int(Rung.EXACT), int(Rung.OPEN)

FOUND_ELSEWHERE = ("frame_", "time_", "curve_")
"""How the names of those columns begin that are not about the polyline's motion."""

MEASURED = tuple(c for c in StepTable.columns() if not c.name.startswith(FOUND_ELSEWHERE))

ON_THE_WAY = [
    ("is_turned", np.bool_),  # whether the rotation was taken out
    ("cell_ok", np.bool_),  # whether periodic images can be counted
    ("jumping_edge", np.int64),  # the first edge of the traces that jumps by a lattice vector; -1 where none does
]

ROW = np.dtype([*((c.name, c.dtype, c.shape) for c in MEASURED), *ON_THE_WAY], align=True)


def unmeasured(n: int) -> StepRows:
    """Return the rows of n steps, none of them measured: numbers are NaN, indices -1, verdicts UNRESOLVED."""
    return np.frombuffer(bytearray(_blank() * n), dtype=ROW)  # NumPy copies records field by field


@cache
def _blank() -> bytes:
    row = np.zeros(1, dtype=ROW)
    for column in MEASURED:
        if column.enum is None:
            row[column.name] = math.nan if column.dtype is np.float64 else -1
    row["nu_class"], row["jumping_edge"], row["cell_ok"] = -1, -1, True
    row["rung"], row["rung_pairs"], row["n_crossings"], row["image_jumps"] = OPEN, 0, 0, 0
    return row.tobytes()


def columns_of(rows: StepRows) -> dict[str, Any]:
    """Return the columns of a `StepTable` that the rows hold, as views of them."""
    return {column.name: rows[column.name] for column in MEASURED}


def first_values(rows: StepRows) -> list[Any]:
    """Return what the first row holds of these columns, in their order, as plain numbers and arrays."""
    values: list[Any] = list(rows.item(0)[: len(MEASURED)])
    return values


def settle(row: StepRow, undecided: int, still_open: int) -> None:
    """Note that exact arithmetic has decided some pairs of a step that the ladder left undecided."""
    if not undecided:
        return
    pairs = row["rung_pairs"]
    pairs[EXACT] += undecided - still_open
    pairs[OPEN] -= undecided - still_open
    if not pairs[OPEN]:
        row["rung"] = EXACT
