"""From frames to strands in space: whole strands in any cell, and the motion of one step.

Making strands whole is a function of one frame. A step then places the strands of its second frame next to those of its
first by lattice vectors, and takes one common rigid motion out. Nothing is carried from step to step.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import MAX_CELL_DRIFT, cell_drift
from mdtopo.geometry.lattice import (
    fractions,
    lattice_vector,
    nearest_image,
    reduced_cell,
    whole_counts,
)
from mdtopo.geometry.rigid import best_rotation, covariance, rotation_angle
from mdtopo.geometry.vectors import Vector, norm, row, subtract

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class StepMotion(NamedTuple):
    """The linear motion that one step certifies.

    Attributes
    ----------
    x0, x1 : ndarray, shape (n, 3)
        Whole strands at both ends, the common rigid motion removed from the second.
    cell0, cell1 : ndarray, shape (3, 3)
        Reduced lattice vectors at both ends, the second rotated along. Image s of a vertex moves from x0 + s·cell0 to
        x1 + s·cell1. Zeros where there is no cell.
    rotation : float
        Angle that was removed, degrees.
    translation : ndarray, shape (3,)
        Motion of the centroid that was removed, Å.
    usable : bool
        Whether images can be counted on the path between the two cells.
    """

    x0: FloatArray
    x1: FloatArray
    cell0: FloatArray
    cell1: FloatArray
    rotation: float
    translation: FloatArray
    usable: bool


@njit(cache=True, nogil=True)
def whole_strands(
    x: FloatArray, cell: FloatArray, vertices: IntArray, offsets: IntArray, closed: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the positions with every trace whole, the reduced cell, and the winding of each trace.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions as stored, finite, Å.
    cell : ndarray, shape (3, 3)
        Lattice vectors.
    vertices, offsets, closed : ndarray
        The traces, see `mdtopo.records.Traces`.

    Returns
    -------
    whole : ndarray, shape (n, 3)
        x + counts · cell for integer counts, each trace's centroid in the home cell: the image in which the file holds a
        strand leaves no mark.
    basis : ndarray, shape (3, 3)
        The reduced cell.
    winding : ndarray of int, shape (n_traces, 3)
        Nonzero where a closed trace closes through the boundary, so that it cannot be made whole.
    """
    basis, _ = reduced_cell(cell)
    inverse = np.linalg.inv(basis)
    counts, winding = whole_counts(x, basis, vertices, offsets, closed)
    whole = np.empty_like(x)
    for g in range(len(closed)):
        trace = vertices[offsets[g] : offsets[g + 1]]
        centre = (0.0, 0.0, 0.0)
        for i in trace:
            v = lattice_vector((counts[i, 0], counts[i, 1], counts[i, 2]), basis)
            centre = (centre[0] + x[i, 0] + v[0], centre[1] + x[i, 1] + v[1], centre[2] + x[i, 2] + v[2])
        n = len(trace)
        f = fractions((centre[0] / n, centre[1] / n, centre[2] / n), inverse)
        home = (int(np.floor(f[0])), int(np.floor(f[1])), int(np.floor(f[2])))
        for i in trace:
            total = (counts[i, 0] - home[0], counts[i, 1] - home[1], counts[i, 2] - home[2])
            v = lattice_vector(total, basis)
            whole[i, 0], whole[i, 1], whole[i, 2] = x[i, 0] + v[0], x[i, 1] + v[1], x[i, 2] + v[2]
    return whole, basis, winding


@njit(cache=True, nogil=True)
def matching_basis(basis0: FloatArray, cell1: FloatArray) -> FloatArray:
    """Return the basis of the second frame's lattice that lies closest to the first frame's basis.

    Its rows are the same integer combinations as before, also where an engine has flipped a triclinic cell to an
    equivalent one. If no unimodular match exists (the cell jumped), the nearest lattice vectors cannot be told apart and
    the given basis stands.
    """
    counts = np.rint(basis0 @ np.linalg.inv(cell1))
    if abs(abs(np.linalg.det(counts)) - 1.0) > 1e-6:
        return cell1.copy()
    return counts @ cell1


@njit(cache=True, nogil=True)
def step_motion(
    x0: FloatArray,
    x1: FloatArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
    rigid: bool,
    vertices: IntArray,
    offsets: IntArray,
) -> StepMotion:
    """Return the motion of one step: strands of the second frame placed next to the first's, one rigid motion removed.

    Parameters
    ----------
    x0, x1 : ndarray, shape (n, 3)
        Whole strands.
    cell0, cell1 : ndarray, shape (3, 3)
        Reduced cells; ignored unless periodic.
    periodic, rigid : bool
        Whether there is a cell; whether a rigid motion is taken out (else the stored coordinates stand, images aside).
    vertices, offsets : ndarray of int
        The traces.
    """
    rotation = np.eye(3)
    if rigid:
        whole_system = np.array([0, len(vertices)])
        rotation = best_rotation(covariance(x0, x1, vertices, offsets if periodic else whole_system))
    basis1 = matching_basis(cell0, cell1) if periodic else np.zeros((3, 3))
    if periodic and rigid and cell_drift(cell0, basis1 @ rotation.T) >= MAX_CELL_DRIFT:
        rotation = np.eye(3)  # the cell cannot turn so far on a straight path
    turned_cell = basis1 @ rotation.T
    turned = x1 @ rotation.T if rigid else x1.copy()
    usable = True
    if periodic:
        usable = cell_drift(cell0, turned_cell) < MAX_CELL_DRIFT
        _place_beside(x0, turned, turned_cell, vertices, offsets)
    translation = np.zeros(3)
    if rigid:
        before, after = np.empty(3), np.empty(3)
        for axis in range(3):
            before[axis], after[axis] = x0[:, axis].mean(), turned[:, axis].mean()
        turned -= after - before
        translation = after @ rotation - before
    return StepMotion(x0, turned, cell0, turned_cell, rotation_angle(rotation), translation, usable)


@njit(cache=True, nogil=True)
def _place_beside(
    x0: FloatArray, x1: FloatArray, cell1: FloatArray, vertices: IntArray, offsets: IntArray
) -> None:
    """Shift each trace of x1, in place, by the lattice vector that brings it next to where it was.

    The motion that most vertices share is found first, as a circular mean of fractions: a file that was centred anew
    moves every strand by the same half cell, and must not tear some of them away from the others.
    """
    basis, _ = reduced_cell(cell1)
    inverse = np.linalg.inv(basis)
    n_traces = len(offsets) - 1
    moves = np.empty((n_traces, 3))
    common = np.zeros((3, 2))
    for g in range(n_traces):
        trace = vertices[offsets[g] : offsets[g + 1]]
        for axis in range(3):
            total = 0.0
            for i in trace:
                total += x1[i, axis] - x0[i, axis]
            moves[g, axis] = total / len(trace)
        f = fractions(row(moves, g), inverse)
        for axis in range(3):
            common[axis, 0] += len(trace) * np.cos(2.0 * np.pi * f[axis])
            common[axis, 1] += len(trace) * np.sin(2.0 * np.pi * f[axis])
    shared = np.empty(3)
    for axis in range(3):
        shared[axis] = np.arctan2(common[axis, 1], common[axis, 0]) / (2.0 * np.pi)
    shared_move = shared @ basis
    for g in range(n_traces):
        own: Vector = (
            moves[g, 0] - shared_move[0],
            moves[g, 1] - shared_move[1],
            moves[g, 2] - shared_move[2],
        )
        counts, _ = nearest_image(own, basis, inverse)
        v = lattice_vector(counts, basis)
        for i in vertices[offsets[g] : offsets[g + 1]]:
            for axis in range(3):
                x1[i, axis] += v[axis]


@njit(cache=True, nogil=True)
def edge_lengths(x: FloatArray, edges: IntArray) -> FloatArray:
    """Return the length of each edge, Å, shape (m,)."""
    lengths = np.empty(len(edges))
    for k in range(len(edges)):
        lengths[k] = norm(subtract(row(x, edges[k, 1]), row(x, edges[k, 0])))
    return lengths
