"""Which step of each window is looked at vertex by vertex, and what is found there."""

import numpy as np

from mdtopo.blocks import motion_of
from mdtopo.planning import BlockPlan, Stretch
from mdtopo.records import MonitorConfig, Profile
from mdtopo.records.profile import rounded_down
from mdtopo.steprows import StepRows
from mdtopo.typing import Flags, PointSeries
from mdtopo.vertexclearance import vertex_clearances


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
    order = np.lexsort((np.arange(len(frames)), np.where(able, least, np.inf), windows))
    found, first = np.unique(windows[order], return_index=True)
    chosen = order[first]
    found, chosen = found[able[chosen]], chosen[able[chosen]]
    t, periodic, rigid = part.traces, plan.block.cells is not None, config.motion == "rigid"
    values = np.empty((len(chosen), n_vertices))
    for position, k in enumerate(chosen.tolist()):
        motion = motion_of(part.frames, k, periodic, rigid, rotations[k], t.vertices, t.offsets)
        values[position] = vertex_clearances(
            motion, periodic, t.edges, t.following, t.trace, t.local_pairs, float(least[k])
        )
    step = plan.block.first_step + part.steps.start + chosen
    return Profile(length, found, step, least[chosen], rounded_down(values))


def _able(rows: StepRows) -> Flags:
    """Return which steps have a clearance to speak of: not one in which images cannot be told apart."""
    known: Flags = ~np.isnan(rows["displacement_max"]) & np.isfinite(rows["clearance"])
    known &= rows["cell_ok"] & (rows["jumping_edge"] < 0)
    return known
