"""The kernels over a block of frames: one call for whole strands, one for all of its steps.

The hot path is columnar. A kernel runs over many steps and fills columns, because a Python object for each step would
cost more than the mathematics.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.contacts import Found, both_found
from mdtopo.curves import (
    StepMotion,
    greatest_magnitude,
    image_jumps,
    jumping_edge,
    lies_whole,
    step_motion,
    whole_strands,
    write_edge_lengths,
)
from mdtopo.extremes import N_RUNGS
from mdtopo.geometry.lattice import basis_of, reduced_basis, store_basis, total_length
from mdtopo.geometry.rigid import covariance
from mdtopo.ladder import measure_step
from mdtopo.records import Rung

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
CodeArray = NDArray[np.int8]
BoolArray = NDArray[np.bool_]

EXACT, OPEN = int(Rung.EXACT), int(Rung.OPEN)


class WholeFrames(NamedTuple):
    """Frames with whole strands: positions, reduced cells, edge lengths, and which frames can be used at all.

    `jumps` counts the edges whose stored vector jumps by a lattice vector between a frame and the one before.
    """

    positions: FloatArray
    cells: FloatArray
    lengths: FloatArray
    winding: IntArray
    jumps: IntArray
    placing: FloatArray
    usable: BoolArray

    def first(self, count: int) -> "WholeFrames":
        """Return the first frames; all of them as they are."""
        if count == len(self.positions):
            return self
        return type(self)._make(array[:count] for array in self)


class Columns(NamedTuple):
    """The columns that the kernel writes, one row per step."""

    displacement: FloatArray
    displacement_vertex: IntArray
    angle: FloatArray
    is_turned: BoolArray
    translation: FloatArray
    nu: FloatArray
    nu_witness: IntArray
    nu_class: CodeArray
    ratio: FloatArray
    ratio_witness: IntArray
    clearances: FloatArray
    clearance_witness: IntArray
    rung: CodeArray
    rung_pairs: IntArray
    cell_ok: BoolArray
    jump: IntArray

    def part(self, rows: slice) -> "Columns":
        """Return views of some rows; all of them as they are."""
        if rows.stop - rows.start == len(self.rung):
            return self
        return type(self)._make(array[rows] for array in self)

    def settle(self, row: int, undecided: int, still_open: int) -> None:
        """Note that exact arithmetic has decided some pairs of a step that the ladder left undecided."""
        if not undecided:
            return
        self.rung_pairs[row, EXACT] += undecided - still_open
        self.rung_pairs[row, OPEN] -= undecided - still_open
        if not self.rung_pairs[row, OPEN]:
            self.rung[row] = EXACT


@njit(cache=True, nogil=True)
def whole_frames(
    positions: FloatArray,
    cells: FloatArray,
    usable: BoolArray,
    periodic: bool,
    vertices: IntArray,
    offsets: IntArray,
    closed: BoolArray,
    edges: IntArray,
) -> WholeFrames:
    """Return the frames of a block with whole strands and the lengths of their edges; NaN where a frame is unusable."""
    n_frames = len(positions)
    whole, is_copied = positions, False  # nobody writes to them: most often nothing has to be moved
    bases = np.zeros((n_frames, 3, 3))
    lengths = np.full((n_frames, len(edges)), np.nan)
    winding = np.zeros((n_frames, len(closed), 3), dtype=np.int64)
    jumps, placing = np.zeros(n_frames, dtype=np.int64), np.zeros(n_frames)
    nothing = np.zeros((len(positions[0]) if periodic else 0, 3), dtype=np.int64)
    before, was_moved = nothing, False
    for k in range(n_frames):
        if not usable[k]:
            continue
        longest = write_edge_lengths(positions[k], edges, lengths[k])
        if not periodic:
            continue
        basis, counts = reduced_basis(basis_of(cells[k])), nothing
        store_basis(basis, bases[k])
        is_moved = not lies_whole(positions[k], basis, longest, vertices, offsets)
        if is_moved:
            if not is_copied:
                whole, is_copied = positions.copy(), True
            whole[k], _, winding[k], counts, placing[k] = whole_strands(
                positions[k], cells[k], vertices, offsets, closed
            )
            write_edge_lengths(whole[k], edges, lengths[k])
        else:
            placing[k] = greatest_magnitude(positions[k]) + total_length(basis_of(cells[k]))
        if k > 0 and usable[k - 1] and (is_moved or was_moved):
            jumps[k] = image_jumps(before, counts, bases[k - 1], bases[k], edges)
        before, was_moved = counts, is_moved
    return WholeFrames(whole, bases, lengths, winding, jumps, placing, usable)


@njit(cache=True, nogil=True)
def covariances(
    positions: FloatArray, measurable: BoolArray, vertices: IntArray, groups: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return covariance, shape (k, 3, 3), and size of each step's two frames; zero where it is not measurable."""
    found, sizes = np.zeros((len(measurable), 3, 3)), np.zeros(len(measurable))
    for k in range(len(measurable)):
        if measurable[k]:
            found[k], sizes[k] = covariance(positions[k], positions[k + 1], vertices, groups)
    return found, sizes


@njit(cache=True, nogil=True)
def motion_of(
    frames: WholeFrames,
    k: int,
    periodic: bool,
    rigid: bool,
    rotation: FloatArray,
    vertices: IntArray,
    offsets: IntArray,
) -> StepMotion:
    """Return the motion between frames k and k + 1; see `mdtopo.curves.step_motion`."""
    return step_motion(
        frames.positions[k],
        frames.positions[k + 1],
        frames.cells[k],
        frames.cells[k + 1],
        max(frames.placing[k], frames.placing[k + 1]),
        periodic,
        rigid,
        rotation,
        vertices,
        offsets,
    )


@njit(cache=True, nogil=True)
def measure_steps(
    frames: WholeFrames,
    measurable: BoolArray,
    periodic: bool,
    rigid: bool,
    rotations: FloatArray,
    vertices: IntArray,
    offsets: IntArray,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    local_pairs: IntArray,
    end_terms: IntArray,
    out: Columns,
) -> tuple[IntArray, Found]:
    """Measure each step whose two frames can be used, and write its row; other rows stay as they are.

    Returns
    -------
    starts : ndarray of int, shape (n_steps + 1, 2)
        Where the passages, and the undecided pairs, of each step begin.
    found : Found
        Those of all steps, one after the other.
    """
    reach, starts = 0.0, np.zeros((len(frames.positions), 2), dtype=np.int64)
    total = Found(np.empty((0, 14)), np.empty((0, 6), dtype=np.int64))
    for k in range(len(frames.positions) - 1):
        starts[k + 1] = starts[k]
        if not measurable[k]:
            continue
        motion = motion_of(frames, k, periodic, rigid, rotations[k], vertices, offsets)
        out.is_turned[k], out.cell_ok[k] = motion.is_turned, motion.usable
        out.translation[k, 0], out.translation[k, 1], out.translation[k, 2] = motion.translation
        if not motion.usable:
            continue
        if periodic:
            out.jump[k] = jumping_edge(motion, edges)
            if out.jump[k] >= 0:
                continue
        m = measure_step(motion, periodic, edges, following, trace, local_pairs, end_terms, reach)
        reach, out.cell_ok[k] = m.needed_reach, m.countable
        out.displacement[k], out.displacement_vertex[k] = m.displacement, m.displacement_vertex
        out.nu[k], out.nu_class[k], out.ratio[k], out.rung[k] = m.nu, m.nu_class, m.ratio, m.rung
        out.nu_witness[k, :], out.ratio_witness[k, :] = m.nu_witness, m.ratio_witness
        out.clearances[k, :], out.clearance_witness[k, :, :] = m.clearances, m.clearance_witness
        out.rung_pairs[k, :] = m.rung_pairs
        if len(m.found.passages) + len(m.found.undecided) > 0:
            total = both_found(total, m.found)
            starts[k + 1, 0], starts[k + 1, 1] = len(total.passages), len(total.undecided)
    return starts, total


def empty_columns(n: int) -> Columns:
    """Return columns for n steps, none of them measured."""
    return Columns._make([column.copy() for column in _unmeasured(n)])


@lru_cache(maxsize=8)
def _unmeasured(n: int) -> Columns:
    """Return columns to copy, which costs half as much as making them."""
    number, index, code = np.full((n, 3), np.nan), np.full((n, 3, 4), -1, dtype=np.int64), np.full(n, -1, dtype=np.int8)
    return Columns(
        displacement=number[:, 0],
        displacement_vertex=index[:, 0, 0],
        angle=number[:, 0],
        is_turned=np.zeros(n, dtype=np.bool_),
        translation=number,
        nu=number[:, 0],
        nu_witness=index[:, 0],
        nu_class=code,
        ratio=number[:, 0],
        ratio_witness=index[:, 0],
        clearances=number,
        clearance_witness=index,
        rung=np.full(n, OPEN, dtype=np.int8),
        rung_pairs=np.zeros((n, N_RUNGS), dtype=np.int64),
        cell_ok=np.ones(n, dtype=np.bool_),
        jump=index[:, 0, 0],
    )
