"""From what the ladder finds in a step to its crossings: exact arithmetic for what it left open, and rows of the table.

Which numbers are exact: the stored coordinates, and with a cell the stored cell times whole numbers, where the motion
is the stored one (`--motion lab`). Where a rigid motion is taken out, the turned float64 coordinates are what is
certified, and they are taken as they are.
"""

from collections.abc import Collection
from fractions import Fraction
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mdtopo.blocks import motion_of
from mdtopo.contacts import Found, passage_row
from mdtopo.curves import StepMotion
from mdtopo.geometry.lattice import Counts
from mdtopo.geometry.rational import FREE, PASSAGE, ExactCorners, exact_passages
from mdtopo.planning import BlockPlan, Stretch
from mdtopo.records import Crossings, Grade, Reason, Shape, Strands, Traces
from mdtopo.typing import Cell, Indices, Points

Meeting: TypeAlias = tuple[int, int, Counts]
"""Two traces, and the image of the second, in the step's reduced cell."""

UNDERSAMPLED, RESOLVED, PROVEN = int(Grade.UNDERSAMPLED), int(Grade.RESOLVED), int(Grade.PROVEN)
POLYLINE = int(Shape.POLYLINE)

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


class StepData(NamedTuple):
    """What exact arithmetic, and a row of the table, need of a step.

    Attributes
    ----------
    motion : StepMotion
        What the ladder has measured.
    stored : two ndarrays, shape (n, 3)
        Positions as the two frames hold them, Å.
    cells : two ndarrays, shape (3, 3), or None
        Lattice vectors as the two frames hold them, Å.
    rigid : bool
        Whether a rigid motion was taken out.
    """

    motion: StepMotion
    stored: tuple[Points, Points]
    cells: tuple[Cell, Cell] | None
    rigid: bool


def step_data(plan: BlockPlan, part: Stretch, k: int, rotation: Cell, rigid: bool) -> StepData:
    """Return step k of a part as the ladder has seen it, and as the frames hold it."""
    frames, block, row = part.frames, plan.block, part.steps.start + k
    t = part.traces
    motion = motion_of(frames, k, block.cells is not None, rigid, rotation, t.vertices, t.offsets)
    cells = None if block.cells is None else (block.cells[row], block.cells[row + 1])
    return StepData(motion, (block.positions[row], block.positions[row + 1]), cells, rigid)


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
    edges, rows = traces.edges, decided.passages
    tails = edges[:, 0][rows[:, :2].astype(np.int64)]
    low, high = np.minimum(tails[:, 0], tails[:, 1]), np.maximum(tails[:, 0], tails[:, 1])
    rows = rows[np.lexsort((high, low, rows[:, 5]))]
    pairs, places, image, point = _in_strand_order(rows, step, edges)
    image, point = _as_stored(image, point, rows[:, 5], edges[pairs][:, :, 0], step)
    length = rows[:, 13].copy() if resolution is None else np.full(len(rows), resolution)
    grade = np.full(len(rows), UNDERSAMPLED, dtype=np.int8)
    grade[rows[:, 12] < length] = RESOLVED
    if changed:
        grade[[meeting_of(row, traces) in changed for row in rows]] = PROVEN
    return Crossings(
        strands=strands,
        step=np.full(len(rows), number, dtype=np.int64),
        frame_t0=np.full(len(rows), frames[0], dtype=np.int64),
        frame_t1=np.full(len(rows), frames[1], dtype=np.int64),
        t=rows[:, 5].copy(),
        edges=edges[pairs],
        parameters=places,
        point=point,
        sign=rows[:, 11].astype(np.int64),
        image=image,
        grade=grade,
        object=np.full(len(rows), int(shape), dtype=np.int8),
        motion=rows[:, 12].copy(),
        resolution=length,
    )


def meeting_of(row: NDArray[Any], traces: Traces) -> Meeting:
    """Return which two traces a row of `Found` is about, and the image of the second; the same for both orders."""
    a, b = int(traces.trace[int(row[0])]), int(traces.trace[int(row[1])])
    image = (int(row[2]), int(row[3]), int(row[4]))
    mirrored = (-image[0], -image[1], -image[2])
    return min((a, b, image), (b, a, mirrored))


def _in_strand_order(
    rows: NDArray[np.float64], step: StepData, edges: Indices
) -> tuple[Indices, NDArray[np.float64], Indices, Points]:
    """Return edges, parameters, image and point of passages, the edge with the lower first vertex first.

    Where the two change places, the point moves along by the image, into the copy of the strand that is at home.
    """
    pairs, places = rows[:, :2].astype(np.int64), rows[:, 6:8].copy()
    image = rows[:, 2:5].astype(np.int64)
    point = rows[:, 8:11].copy()
    swap = edges[pairs[:, 1], 0] < edges[pairs[:, 0], 0]
    if swap.any():
        if step.cells is not None:
            point[swap] -= _moving_vectors(image, rows[:, 5], step.motion)[swap]
        pairs[swap], places[swap], image[swap] = pairs[swap][:, ::-1], places[swap][:, ::-1], -image[swap]
    return pairs, places, image, point


def _as_stored(
    image: Indices, point: Points, t: NDArray[np.float64], tails: Indices, step: StepData
) -> tuple[Indices, Points]:
    """Return images and points seen from where the first frame stores the edges, not from where strands are whole."""
    if step.cells is None:
        return image, point
    m = step.motion
    moved = m.x0[tails] - step.stored[0][tails]
    counts = lattice_counts(moved.reshape(-1, 3), m.cell0).reshape(-1, 2, 3)
    seen = (image + counts[:, 1] - counts[:, 0]) @ lattice_counts(m.cell0, step.cells[0])
    return seen, point - _moving_vectors(counts[:, 0], t, m)


def _moving_vectors(counts: Indices, t: NDArray[np.float64], motion: StepMotion) -> Points:
    """Return lattice vectors at given times of the step, by counts of its reduced cell."""
    times = t[:, np.newaxis, np.newaxis]
    vectors: Points = np.einsum("ki,kij->kj", counts, (1.0 - times) * motion.cell0 + times * motion.cell1)
    return vectors
