"""From what the ladder finds in a step to its crossings: exact arithmetic for what it left open, and rows of the table.

Which numbers are exact: the stored coordinates, and with a cell the stored cell times whole numbers, where the motion
is the stored one (`--motion lab`). Where a rigid motion is taken out, the turned float64 coordinates are what is
certified, and they are taken as they are.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mdtopo.blocks import motion_of
from mdtopo.contacts import Found, passage_row
from mdtopo.crossingrows import ROW, CrossingRows, columns_of, in_order_of_time, is_swapped, write_rows
from mdtopo.curves import StepMotion
from mdtopo.geometry.lattice import Counts
from mdtopo.geometry.rational import FREE, PASSAGE, ExactCorners, exact_passages
from mdtopo.planning import BlockPlan, Stretch
from mdtopo.records import Crossings, Grade, Reason, Shape, Strands, Traces
from mdtopo.typing import Cell, Indices, Points

Meeting: TypeAlias = tuple[int, int, Counts]
"""Two traces, and the image of the second, in the step's reduced cell."""

PROVEN = int(Grade.PROVEN)

MOST_EXACT = 500
"""Pairs of one step that exact arithmetic decides; each costs milliseconds, and a step with more is beyond help."""

REASONS = {
    "frame": Reason.FRAME,
    "vertex": Reason.VERTEX,
    "touch": Reason.TOUCH,
    "sliding": Reason.SLIDING,
}

WORST_FIRST = (Reason.LADDER, Reason.FRAME, Reason.VERTEX, Reason.TOUCH, Reason.SLIDING)
"""Which reason a step has whose pairs are undecided for several."""


@dataclass(frozen=True, eq=False)
class StepData:
    """What exact arithmetic, and a row of the table, need of a step; worked out when it is asked for.

    Attributes
    ----------
    plan, part, k
        The block, the part of it, and the step, counted within the part.
    rotation : ndarray, shape (3, 3)
        What was taken out of the step.
    rigid : bool
        Whether a rigid motion was taken out.
    """

    plan: BlockPlan
    part: Stretch
    k: int
    rotation: Cell
    rigid: bool

    @cached_property
    def motion(self) -> StepMotion:
        """What the ladder has measured."""
        t, periodic = self.part.traces, self.plan.block.cells is not None
        return motion_of(self.part.frames, self.k, periodic, self.rigid, self.rotation, t.vertices, t.offsets)

    @property
    def row(self) -> int:
        """The step, counted within the block."""
        return int(self.part.steps.start) + self.k

    @property
    def stored(self) -> tuple[Points, Points]:
        """Positions as the two frames hold them, Å."""
        positions = self.plan.block.positions
        return positions[self.row], positions[self.row + 1]

    @property
    def cells(self) -> tuple[Cell, Cell] | None:
        """Lattice vectors as the two frames hold them, Å; None where there are none."""
        cells = self.plan.block.cells
        return None if cells is None else (cells[self.row], cells[self.row + 1])


class Decided(NamedTuple):
    """What is known of a step after exact arithmetic.

    Attributes
    ----------
    passages : ndarray, shape (k, 14)
        As in `mdtopo.contacts.Found`.
    open_pairs : ndarray of int, shape (l, 6)
        Pairs that stay undecided, as in `mdtopo.contacts.Found`.
    reason : Reason
        Why; NONE where there are none.
    """

    passages: NDArray[np.float64]
    open_pairs: Indices
    reason: Reason


def decide_exactly(found: Found, step: StepData, edges: Indices) -> Decided:
    """Return the passages of a step, those included that only exact arithmetic can tell.

    Guarantee
    ---------
    Proven for the numbers named above: a pair that is neither among the passages nor open never meets.
    """
    if not len(found.undecided):
        return Decided(found.passages, found.undecided, Reason.NONE)
    rows, open_pairs, reasons = [found.passages], [], set()
    for row in found.undecided[:MOST_EXACT]:
        i, j, image = int(row[0]), int(row[1]), (int(row[2]), int(row[3]), int(row[4]))
        state, meetings = exact_passages(*exact_corners(step, edges[i], edges[j], image))
        for at in meetings:
            rows.append(passage_row(i, j, image, (at.t, at.s, at.r), float(at.sign), step.motion, edges)[np.newaxis])
        if state not in (FREE, PASSAGE):
            open_pairs.append(row)
            reasons.add(REASONS[state])
    if len(found.undecided) > MOST_EXACT:
        open_pairs += list(found.undecided[MOST_EXACT:])
        reasons.add(Reason.LADDER)
    reason = next((r for r in WORST_FIRST if r in reasons), Reason.NONE)
    return Decided(np.concatenate(rows), np.array(open_pairs, dtype=np.int64).reshape(-1, 6), reason)


def exact_corners(step: StepData, first: Indices, second: Indices, image: Counts) -> tuple[ExactCorners, ExactCorners]:
    """Return the ends of two edges, the second one in its image, as exact numbers at both ends of the step."""
    m, vertices = step.motion, np.concatenate([first, second])
    shift = np.array([(0, 0, 0), (0, 0, 0), image, image])
    if step.rigid or step.cells is None:
        return _moved(m.x0[vertices], shift, m.cell0), _moved(m.x1[vertices], shift, m.cell1)
    return (
        _in_cell(step.stored[0][vertices], m.x0[vertices], shift, step.cells[0], m.cell0),
        _in_cell(step.stored[1][vertices], m.x1[vertices], shift, step.cells[1], m.cell1),
    )


def _in_cell(stored: Points, placed: Points, shift: Indices, cell: Cell, basis: Cell) -> ExactCorners:
    """Return stored points, moved to where they were placed and by so many vectors of a basis, in exact numbers."""
    return _moved(stored, lattice_counts(placed - stored, cell) + shift @ lattice_counts(basis, cell), cell)


def _moved(points: Points, counts: Indices, cell: Cell) -> ExactCorners:
    vectors = [[Fraction(value) for value in vector] for vector in cell.tolist()]
    a, b, c, d = (
        [
            Fraction(x) + sum(n * vector[axis] for n, vector in zip(move, vectors, strict=True))
            for axis, x in enumerate(p)
        ]
        for p, move in zip(points.tolist(), counts.tolist(), strict=True)
    )
    return a, b, c, d


def lattice_counts(vectors: Points, cell: Cell) -> Indices:
    """Return vectors of the lattice as whole numbers of the cell's vectors."""
    counts: Indices = np.rint(np.linalg.solve(cell.T, vectors.T).T).astype(np.int64)
    return counts


def crossing_table(
    decided: Decided,
    step: StepData,
    traces: Traces,
    changed: Collection[Meeting],
    number: int,
    frames: Indices,
    strands: Strands,
    resolution: float | None,
    shape: Shape = Shape.POLYLINE,
) -> Crossings:
    """Return the crossings of one step, in order of time.

    Parameters
    ----------
    decided : Decided
    step : StepData
    traces : Traces
    changed : collection of tuple
        Pairs of traces, and image, of which an invariant has changed: from `mdtopo.audit`.
    number : int
        The step.
    frames : ndarray of int, shape (2,)
        Its frames.
    strands : Strands
    resolution : float or None
        Resolution length, Å; by default the length of the shorter edge.
    shape : Shape
        What has crossed.
    """
    passages = in_order_of_time(decided.passages, traces.edges)
    if step.cells is not None:
        _move_home(passages, traces.edges, step.motion)
    rows = np.empty(len(passages), dtype=ROW)
    length = math.nan if resolution is None else resolution
    write_rows(passages, traces.edges, number, int(frames[0]), int(frames[1]), int(shape), length, rows)
    if step.cells is not None:
        rows["image"], rows["point"] = _as_stored(rows, step, step.cells[0])
    if changed:
        rows["grade"][[meeting_of(row, traces) in changed for row in passages]] = PROVEN
    return Crossings(strands, **columns_of(rows))


def meeting_of(row: NDArray[Any], traces: Traces) -> Meeting:
    """Return which two traces a row of `Found` is about, and the image of the second; the same for both orders."""
    a, b = int(traces.trace[int(row[0])]), int(traces.trace[int(row[1])])
    image = (int(row[2]), int(row[3]), int(row[4]))
    mirrored = (-image[0], -image[1], -image[2])
    return min((a, b, image), (b, a, mirrored))


def _move_home(passages: NDArray[np.float64], edges: Indices, motion: StepMotion) -> None:
    """Move points along by the image, in place, where the edges change places: into the copy of the strand at home."""
    swap = np.array([is_swapped(passages, k, edges) for k in range(len(passages))], dtype=np.bool_)
    passages[swap, 8:11] -= _moving_vectors(passages[:, 2:5].astype(np.int64), passages[:, 5], motion)[swap]


def _as_stored(rows: CrossingRows, step: StepData, cell: Cell) -> tuple[Indices, Points]:
    """Return images and points seen from where the first frame stores the edges, not from where strands are whole."""
    m, tails = step.motion, rows["edges"][:, :, 0]
    moved = m.x0[tails] - step.stored[0][tails]
    counts = lattice_counts(moved.reshape(-1, 3), m.cell0).reshape(-1, 2, 3)
    seen = (rows["image"] + counts[:, 1] - counts[:, 0]) @ lattice_counts(m.cell0, cell)
    return seen, rows["point"] - _moving_vectors(counts[:, 0], rows["t"], m)


def _moving_vectors(counts: Indices, t: NDArray[np.float64], motion: StepMotion) -> Points:
    """Return lattice vectors at given times of the step, by counts of its reduced cell."""
    times = t[:, np.newaxis, np.newaxis]
    vectors: Points = np.einsum("ki,kij->kj", counts, (1.0 - times) * motion.cell0 + times * motion.cell1)
    return vectors
