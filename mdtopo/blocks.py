"""The kernels over a block of frames: one call for whole strands, one for all of its steps.

A kernel runs over many steps and fills their rows, because a Python object for each step would cost more than the
mathematics.
"""

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
    may_jump,
    step_motion,
    whole_strands,
    write_edge_lengths,
)
from mdtopo.geometry.lattice import basis_of, reduced_basis, store_basis, total_length
from mdtopo.geometry.rigid import covariance_about, group_centroids
from mdtopo.ladder import StepMeasure, measure_step
from mdtopo.records import PairClass
from mdtopo.steprows import StepRow, StepRows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LOCAL, SELF, INTER = int(PairClass.LOCAL), int(PairClass.SELF), int(PairClass.INTER)


class WholeFrames(NamedTuple):
    """Frames with whole strands: positions, reduced cells, edge lengths, and which frames can be used at all.

    `longest` holds the square of the longest edge, Å²; `jumps` counts the edges whose stored vector jumps by a lattice
    vector between a frame and the one before.
    """

    positions: FloatArray
    cells: FloatArray
    lengths: FloatArray
    longest: FloatArray
    winding: IntArray
    jumps: IntArray
    placing: FloatArray
    usable: BoolArray

    def first(self, count: int) -> "WholeFrames":
        """Return the first frames; all of them as they are."""
        if count == len(self.positions):
            return self
        return type(self)._make(array[:count] for array in self)


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
    lengths = np.empty((n_frames, len(edges)))
    winding = np.zeros((n_frames, len(closed), 3), dtype=np.int64)
    jumps, placing, longest = np.zeros(n_frames, dtype=np.int64), np.zeros(n_frames), np.zeros(n_frames)
    nothing = np.zeros((len(positions[0]) if periodic else 0, 3), dtype=np.int64)
    before, was_moved = nothing, False
    for k in range(n_frames):
        if not usable[k]:
            lengths[k] = np.nan
            continue
        longest[k] = write_edge_lengths(positions[k], edges, lengths[k])
        if not periodic:
            continue
        basis, counts = reduced_basis(basis_of(cells[k])), nothing
        store_basis(basis, bases[k])
        is_moved = not lies_whole(positions[k], basis, longest[k], vertices, offsets)
        if is_moved:
            if not is_copied:
                whole, is_copied = positions.copy(), True
            whole[k], _, winding[k], counts, placing[k] = whole_strands(
                positions[k], cells[k], vertices, offsets, closed
            )
            longest[k] = write_edge_lengths(whole[k], edges, lengths[k])
        else:
            placing[k] = greatest_magnitude(positions[k]) + total_length(basis_of(cells[k]))
        if k > 0 and usable[k - 1] and (is_moved or was_moved):
            jumps[k] = image_jumps(before, counts, bases[k - 1], bases[k], edges)
        before, was_moved = counts, is_moved
    return WholeFrames(whole, bases, lengths, longest, winding, jumps, placing, usable)


@njit(cache=True, nogil=True)
def covariances(
    positions: FloatArray, measurable: BoolArray, vertices: IntArray, groups: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return covariance, shape (k, 3, 3), and size of each step's two frames; zero where it is not measurable."""
    found, sizes = np.zeros((len(measurable), 3, 3)), np.zeros(len(measurable))
    after = np.empty((len(groups) - 1, 3))
    for k in range(len(measurable)):
        if measurable[k]:
            before = after if k > 0 and measurable[k - 1] else group_centroids(positions[k], vertices, groups)
            after = group_centroids(positions[k + 1], vertices, groups)
            found[k], sizes[k] = covariance_about(before, after, positions[k], positions[k + 1], vertices, groups)
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
    rows: StepRows,
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
        starts[k + 1], row = starts[k], rows[k]
        row["image_jumps"] = frames.jumps[k + 1]
        if not measurable[k]:
            continue
        motion = motion_of(frames, k, periodic, rigid, rotations[k], vertices, offsets)
        row["is_turned"], row["cell_ok"] = motion.is_turned, motion.usable
        for axis in range(3):
            row["translation"][axis] = motion.translation[axis]
        if not motion.usable:
            continue
        if periodic and may_jump(motion, max(frames.longest[k], frames.longest[k + 1])):
            row["jumping_edge"] = jumping_edge(motion, edges)
            if row["jumping_edge"] >= 0:
                continue
        m = measure_step(motion, periodic, edges, following, trace, local_pairs, end_terms, reach)
        reach = m.needed_reach
        write_measure(m, row)
        if len(m.found.passages) + len(m.found.undecided) > 0:
            total = both_found(total, m.found)
            starts[k + 1, 0], starts[k + 1, 1] = len(total.passages), len(total.undecided)
    return starts, total


@njit(cache=True, nogil=True)
def write_measure(m: StepMeasure, row: StepRow) -> None:
    """Write what the ladder has found in a step."""
    row["cell_ok"], row["rung"], row["rung_pairs"][:] = m.countable, m.rung, m.rung_pairs
    row["displacement_max"], row["displacement_vertex"] = m.displacement, m.displacement_vertex
    row["nu"], row["nu_class"], row["pair_ratio"] = m.nu, m.nu_class, m.ratio
    write_pair(m.nu_witness, row["nu_pair"])
    write_pair(m.ratio_witness, row["pair_ratio_pair"])
    row["clearance_local"], row["clearance_self"] = m.clearances[LOCAL], m.clearances[SELF]
    row["clearance_inter"] = m.clearances[INTER]
    write_pair(m.clearance_witness[LOCAL], row["clearance_local_pair"])
    write_pair(m.clearance_witness[SELF], row["clearance_self_pair"])
    write_pair(m.clearance_witness[INTER], row["clearance_inter_pair"])


@njit(cache=True, nogil=True)
def write_pair(witness: IntArray, pair: IntArray) -> None:
    """Write the vertices a, b, c, d as [[a, b], [c, d]]."""
    pair[0, 0], pair[0, 1] = witness[0], witness[1]
    pair[1, 0], pair[1, 1] = witness[2], witness[3]
