"""Which step of each window is looked at vertex by vertex, and what is found there."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.blocks import WholeFrames, motion_of
from mdtopo.planning import BlockPlan, Stretch
from mdtopo.records import MonitorConfig, Profile
from mdtopo.records.profile import rounded_down
from mdtopo.steprows import StepRows
from mdtopo.typing import Flags, PointSeries
from mdtopo.vertexclearance import vertex_clearances

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def part_profile(
    plan: BlockPlan, part: Stretch, rows: StepRows, rotations: PointSeries, config: MonitorConfig
) -> Profile:
    """Return the profile of the steps of one part of a block, which have been measured.

    Parameters
    ----------
    plan, part
        The block, and the part of it.
    rows : StepRows
        What was measured of the part's steps.
    rotations : ndarray, shape (k, 3, 3)
        What was taken out of each.
    config : MonitorConfig
        Says whether anything was, and how many steps a window has, one at least.

    Guarantee
    ---------
    Proven, see `Profile`. Windows begin at fixed frames of the trajectory, so it does not matter where blocks, parts of
    a run and shards are cut.
    """
    n_vertices = plan.block.positions.shape[1]
    able, least = _able(rows), rows["clearance"]
    if not able.any():
        return Profile.none(n_vertices)
    frames = plan.block.frames[part.steps.start : part.steps.stop]
    length = config.profile_steps * int(plan.block.frames[1] - plan.block.frames[0])
    windows = frames // length
    chosen = closest_steps(windows, able, least)
    t, periodic, rigid = part.traces, plan.block.cells is not None, config.motion == "rigid"
    values = clearances_of_steps(
        part.frames, chosen, least[chosen], periodic, rigid, rotations, t.vertices, t.offsets, t.edges, t.following,
        t.trace, t.local_pairs,
    )  # fmt: skip
    step = plan.block.first_step + part.steps.start + chosen
    return Profile(length, windows[chosen], step, least[chosen], rounded_down(values))


@njit(cache=True, nogil=True)
def closest_steps(windows: IntArray, able: BoolArray, least: FloatArray) -> IntArray:
    """Return the step of least clearance of each window, the first of equals; of a window without one, none.

    `windows` says which window each step belongs to, in rising order; `able` which steps have a clearance.
    """
    chosen, count = np.empty(len(windows), dtype=np.int64), 0
    for k in range(len(windows)):
        if not able[k]:
            continue
        if count == 0 or windows[chosen[count - 1]] < windows[k]:
            chosen[count] = k
            count += 1
        elif least[k] < least[chosen[count - 1]]:
            chosen[count - 1] = k
    return chosen[:count]


@njit(cache=True, nogil=True)
def clearances_of_steps(
    frames: WholeFrames,
    steps: IntArray,
    least: FloatArray,
    periodic: bool,
    rigid: bool,
    rotations: FloatArray,
    vertices: IntArray,
    offsets: IntArray,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    local_pairs: IntArray,
) -> FloatArray:
    """Return what `vertex_clearances` says of some steps of a block, shape (n_steps, n_vertices).

    `least` is the clearance of each of these steps.
    """
    values = np.empty((len(steps), len(frames.positions[0])))
    for position, k in enumerate(steps):
        motion = motion_of(frames, k, periodic, rigid, rotations[k], vertices, offsets)
        values[position] = vertex_clearances(motion, periodic, edges, following, trace, local_pairs, least[position])
    return values


def _able(rows: StepRows) -> Flags:
    """Return which steps have a clearance to speak of: not one in which images cannot be told apart."""
    known: Flags = ~np.isnan(rows["displacement_max"]) & np.isfinite(rows["clearance"])
    known &= rows["cell_ok"] & (rows["jumping_edge"] < 0)
    return known
