"""Positions to export: strands whole in their cell, and moments between two frames along the measured motion."""

from collections.abc import Collection

import numpy as np
from scipy.spatial.transform import Rotation

from mdtopo.blocks import WholeFrames, covariances, motion_of, whole_frames
from mdtopo.curves import StepMotion
from mdtopo.errors import InputError
from mdtopo.geometry.rigid import best_rotations
from mdtopo.records import Frame, Strands, Traces
from mdtopo.typing import Cell, Lengths, Points
from mdtopo.vertexclearance import vertex_clearances


def whole_positions(frame: Frame, strands: Strands, broken: Collection[int] = ()) -> Points:
    """Return the positions of a frame with every strand whole, shape (n, 3), Å.

    Parameters
    ----------
    frame : Frame
    strands : Strands
    broken : collection of int
        Edges that are broken, by their index in ``Strands.edges``.

    Raises
    ------
    InputError
        If the frame cannot be used.
    """
    positions: Points = _whole([frame], Traces.of(strands, broken)).positions[0]
    return positions


def in_between(
    frame0: Frame, frame1: Frame, strands: Strands, broken: Collection[int], n: int, *, rigid: bool
) -> list[Points]:
    """Return n + 2 configurations of a step, from its first frame to its last, evenly spaced in time.

    Parameters
    ----------
    frame0, frame1 : Frame
        The step's frames.
    strands, broken
        As for `whole_positions`.
    n : int
        How many moments between the frames.
    rigid : bool
        Whether the step's common rigid motion was taken out.

    Raises
    ------
    InputError
        If a frame cannot be used, or the images of the cell cannot be counted in the step.

    Guarantee
    ---------
    Proven for a certified step, but for the rounding of these positions: what is left when the rigid motion is taken
    out moves on straight lines, as certified, in the images of the step; a rigid motion, which changes no distance, is
    laid over it (an even turn about a centroid that moves evenly). In a periodic box the cell would turn along, so that
    images of other cells are not those of the stored one.
    """
    motion, rotation = _step_motion(frame0, frame1, Traces.of(strands, broken), rigid=rigid)
    turn = rotation if motion.is_turned else np.eye(3)
    centre = motion.x0.mean(axis=0)
    removed = np.array(motion.translation) if rigid else np.zeros(3)
    goal = centre + removed
    vector = Rotation.from_matrix(turn).as_rotvec()
    found = []
    for t in np.linspace(0.0, 1.0, n + 2):
        residual = (1.0 - t) * motion.x0 + t * motion.x1 - centre
        back = Rotation.from_rotvec(-t * vector).as_matrix()
        found.append(residual @ back.T + (1.0 - t) * centre + t * goal)
    return found


def vertex_bounds(
    frame0: Frame, frame1: Frame, strands: Strands, broken: Collection[int], least: float, *, rigid: bool
) -> Lengths:
    """Return how close the edges of each vertex come to any other in a step, at least, Å; see `vertex_clearances`.

    Parameters
    ----------
    frame0, frame1, strands, broken, rigid
        As for `in_between`.
    least : float
        The step's clearance, as it was measured, Å.

    Raises
    ------
    InputError
        If a frame cannot be used, or the images of the cell cannot be counted in the step.
    """
    t = Traces.of(strands, broken)
    motion, _ = _step_motion(frame0, frame1, t, rigid=rigid)
    periodic = frame0.cell is not None
    bounds: Lengths = vertex_clearances(motion, periodic, t.edges, t.following, t.trace, t.local_pairs, least)
    return bounds


def _step_motion(frame0: Frame, frame1: Frame, t: Traces, *, rigid: bool) -> tuple[StepMotion, Cell]:
    """Return the motion of a step as it is measured, and the rotation that was taken out."""
    periodic = frame0.cell is not None
    frames, rotation = _whole([frame0, frame1], t), np.eye(3)
    if rigid:
        groups = t.offsets if periodic else np.array([0, len(t.vertices)], dtype=np.int64)
        measurable = np.ones(1, dtype=np.bool_)
        rotation = best_rotations(*covariances(frames.positions, measurable, t.vertices, groups))[0]
    motion = motion_of(frames, 0, periodic, rigid, rotation, t.vertices, t.offsets)
    if not motion.usable:
        raise InputError(f"The cell changes too much between the frames {frame0.index} and {frame1.index}.")
    return motion, rotation


def _whole(frames: list[Frame], traces: Traces) -> WholeFrames:
    for frame in frames:
        if frame.problem or (frame.cell is None) != (frames[0].cell is None):
            raise InputError(f"Frame {frame.index} cannot be exported: {frame.problem or 'only one frame has a box'}.")
    cells = np.stack([np.zeros((3, 3)) if frame.cell is None else frame.cell for frame in frames])
    usable, positions = np.ones(len(frames), dtype=np.bool_), np.stack([frame.positions for frame in frames])
    periodic, t = frames[0].cell is not None, traces
    return whole_frames(positions, cells, usable, periodic, t.vertices, t.offsets, t.closed, t.edges)
