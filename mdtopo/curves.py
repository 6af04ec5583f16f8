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
    Basis,
    basis_of,
    combine,
    inverse_of,
    lattice_vector,
    nearest_image,
    nearest_integers,
    reduced_basis,
    store_basis,
    total_length,
    volume,
    whole_counts,
)
from mdtopo.geometry.vectors import Vector, add, dot, norm, row, scale, subtract

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


MAGNITUDE = np.int64(0x7FFF_FFFF_FFFF_FFFF)
"""The bits of a float64 that are not its sign."""

LONG_EDGE = 0.35
"""An edge longer than this share of the shortest lattice vector may be taken for an image of itself."""


class StepMotion(NamedTuple):
    """The linear motion that one step certifies.

    Attributes
    ----------
    x0, x1 : ndarray, shape (n, 3)
        Whole strands at both ends, the common rigid motion removed from the second.
    cell0, cell1 : ndarray, shape (3, 3)
        Reduced lattice vectors at both ends, the second rotated along. Image s of a vertex moves from x0 + s·cell0 to
        x1 + s·cell1. Zeros where there is no cell.
    is_turned : bool
        Whether the rotation was taken out; not in a periodic box that would turn too far with it.
    translation : tuple of 3 floats
        Motion of the centroid that was removed, Å.
    usable : bool
        Whether images can be counted on the path between the two cells.
    placing : float
        The greatest length that was rounded when vertices were placed in the cell, Å: of stored coordinates, and of
        stored cell vectors times the counts that were applied. 0 without a cell.
    """

    x0: FloatArray
    x1: FloatArray
    cell0: FloatArray
    cell1: FloatArray
    is_turned: bool
    translation: Vector
    usable: bool
    placing: float


@njit(cache=True, nogil=True)
def whole_strands(
    x: FloatArray, cell: FloatArray, vertices: IntArray, offsets: IntArray, closed: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, IntArray, IntArray, float]:
    """Return the positions with every trace whole, the reduced cell, the windings, the counts, and what was rounded.

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
        x + counts · cell for integer counts. The first trace stays where its first vertex is; the others take the image
        whose centroid is nearest to its centroid. So the image in which the file holds a strand leaves no mark, and a
        complex smaller than half the cell lies together.
    basis : ndarray, shape (3, 3)
        The reduced cell.
    winding : ndarray of int, shape (n_traces, 3)
        Nonzero where a closed trace closes through the boundary, so that it cannot be made whole.
    counts : ndarray of int, shape (n, 3)
        By how many vectors of the reduced cell each vertex was moved, its trace's common move left out.
    placing : float
        See `StepMotion`.
    """
    basis = reduced_basis(basis_of(cell))
    inverse = inverse_of(basis)
    counts, winding = whole_counts(x, basis, vertices, offsets, closed)
    whole, reduced = np.empty_like(x), np.empty((3, 3))
    store_basis(basis, reduced)
    anchor, stored, applied = (0.0, 0.0, 0.0), 0.0, 0
    for g in range(len(closed)):
        centre = (0.0, 0.0, 0.0)
        for k in range(offsets[g], offsets[g + 1]):
            i = vertices[k]
            placed, count = row(x, i), (counts[i, 0], counts[i, 1], counts[i, 2])
            if count != (0, 0, 0):
                placed = add(placed, lattice_vector(count, basis))
            whole[i, 0], whole[i, 1], whole[i, 2] = placed
            centre = add(centre, placed)
        centre = scale(1.0 / (offsets[g + 1] - offsets[g]), centre)
        if g == 0:
            anchor = centre
        move = nearest_image(subtract(centre, anchor), basis, inverse)
        for k in range(offsets[g], offsets[g + 1]):
            i = vertices[k]
            total = (counts[i, 0] + move[0], counts[i, 1] + move[1], counts[i, 2] + move[2])
            applied = max(applied, abs(total[0]), abs(total[1]), abs(total[2]))
            stored = max(stored, abs(x[i, 0]), abs(x[i, 1]), abs(x[i, 2]))
            if move != (0, 0, 0):
                whole[i, 0], whole[i, 1], whole[i, 2] = add(row(x, i), lattice_vector(total, basis))
    return whole, reduced, winding, counts, stored + (1 + applied) * total_length(basis_of(cell))


@njit(cache=True, nogil=True)
def lies_whole(x: FloatArray, basis: Basis, longest: float, vertices: IntArray, offsets: IntArray) -> bool:
    """Return whether a frame is stored as `whole_strands` would return it, for certain: then nothing has to be moved.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions as stored, finite, Å.
    basis : Basis
        The reduced cell.
    longest : float
        The square of the longest edge as stored, Å².
    vertices, offsets : ndarray
        The traces.

    Guarantee
    ---------
    Proven where True: each stored edge is within half the shortest lattice vector, so that no image of it is shorter,
    and so is each trace's centroid in its image that is nearest to the first one's. Then `whole_strands` returns the
    positions, bit for bit, with counts and windings of zero.
    """
    if not 4.0 * longest < dot(basis[0], basis[0]):
        return False
    anchor = trace_centroid(x, vertices, offsets, 0) if len(offsets) > 2 else (0.0, 0.0, 0.0)
    inverse = inverse_of(basis)
    for g in range(1, len(offsets) - 1):
        centre = trace_centroid(x, vertices, offsets, g)
        if nearest_image(subtract(centre, anchor), basis, inverse) != (0, 0, 0):
            return False
    return True


@njit(cache=True, nogil=True)
def trace_centroid(x: FloatArray, vertices: IntArray, offsets: IntArray, g: int) -> Vector:
    """Return the mean of the vertices of trace g."""
    total = (0.0, 0.0, 0.0)
    for k in range(offsets[g], offsets[g + 1]):
        total = add(total, row(x, vertices[k]))
    return scale(1.0 / (offsets[g + 1] - offsets[g]), total)


@njit(cache=True, nogil=True)
def matching_basis(basis0: Basis, basis1: Basis) -> Basis:
    """Return the basis of the second frame's lattice that lies closest to the first frame's basis.

    Its vectors are the same integer combinations as before, also where an engine has flipped a triclinic cell to an
    equivalent one. If no unimodular match exists (the cell jumped), the given basis stands.
    """
    inverse = inverse_of(basis1)
    a = lattice_vector(nearest_integers(combine(basis0[0], inverse)), basis1)
    b = lattice_vector(nearest_integers(combine(basis0[1], inverse)), basis1)
    c = lattice_vector(nearest_integers(combine(basis0[2], inverse)), basis1)
    ratio = volume((a, b, c)) / volume(basis1)
    return (a, b, c) if abs(abs(ratio) - 1.0) < 1e-6 else basis1


@njit(cache=True, nogil=True)
def step_motion(
    x0: FloatArray,
    x1: FloatArray,
    cell0: FloatArray,
    cell1: FloatArray,
    placing: float,
    periodic: bool,
    rigid: bool,
    rotation: FloatArray,
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
    placing : float
        The greater one of the two frames, see `StepMotion`.
    periodic, rigid : bool
        Whether there is a cell; whether a rigid motion is taken out (else the stored coordinates stand, images aside).
    rotation : ndarray, shape (3, 3)
        The rotation that all strands have in common, from `mdtopo.geometry.rigid`.
    vertices, offsets : ndarray of int
        The traces.
    """
    turn = basis_of(rotation.T)  # as rows times a matrix
    turned, turned_cell = x1, np.zeros((3, 3))
    if periodic or rigid:
        turned = x1.copy()
    usable, is_turned = True, rigid
    if periodic:
        basis0, basis1 = basis_of(cell0), matching_basis(basis_of(cell0), basis_of(cell1))
        along = (combine(basis1[0], turn), combine(basis1[1], turn), combine(basis1[2], turn))
        # on a straight path the cell cannot turn far: then no rotation is taken out
        is_turned = rigid and cell_drift(basis0, along) < MAX_CELL_DRIFT
        if is_turned:
            basis1 = along
        usable = cell_drift(basis0, basis1) < MAX_CELL_DRIFT
        store_basis(basis1, turned_cell)
    if is_turned:
        rotate_rows(turned, turn)
    if periodic:
        _place_beside(x0, turned, basis_of(turned_cell), vertices, offsets)
    translation = (0.0, 0.0, 0.0)
    if rigid:
        before, after = centroid(x0), centroid(turned)
        shift = subtract(after, before)
        for i in range(len(turned)):
            turned[i, 0], turned[i, 1], turned[i, 2] = subtract(row(turned, i), shift)
        translation = subtract(combine(after, basis_of(rotation)), before) if is_turned else shift
    return StepMotion(x0, turned, cell0, turned_cell, is_turned, translation, usable, placing)


@njit(cache=True, nogil=True)
def rotate_rows(x: FloatArray, turn: Basis) -> None:
    """Multiply each row of x, in place, by the matrix `turn` (the transpose of the rotation)."""
    for i in range(len(x)):
        x[i, 0], x[i, 1], x[i, 2] = combine(row(x, i), turn)


@njit(cache=True, nogil=True)
def centroid(x: FloatArray) -> Vector:
    """Return the mean of the rows of x."""
    even, odd = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # two sums that do not wait for each other
    for i in range(0, len(x) - 1, 2):
        even, odd = add(even, row(x, i)), add(odd, row(x, i + 1))
    if len(x) % 2 == 1:
        even = add(even, row(x, len(x) - 1))
    total = add(even, odd)
    return total[0] / len(x), total[1] / len(x), total[2] / len(x)


@njit(cache=True, nogil=True)
def _place_beside(x0: FloatArray, x1: FloatArray, cell1: Basis, vertices: IntArray, offsets: IntArray) -> None:
    """Shift each trace of x1, in place, by the lattice vector that brings it next to where it was.

    The motion that most vertices share is found first, as a circular mean of fractions: a file that was centred anew
    moves every strand by the same half cell, and must not tear some of them away from the others.
    """
    basis = reduced_basis(cell1)
    inverse = inverse_of(basis)
    n_traces = len(offsets) - 1
    moves, circle = np.empty((n_traces, 3)), np.zeros((3, 2))
    for g in range(n_traces):
        total, size = (0.0, 0.0, 0.0), offsets[g + 1] - offsets[g]
        for k in range(offsets[g], offsets[g + 1]):
            total = add(total, subtract(row(x1, vertices[k]), row(x0, vertices[k])))
        mean = scale(1.0 / size, total)
        moves[g, 0], moves[g, 1], moves[g, 2] = mean
        f = combine(mean, inverse)
        for axis in range(3):
            circle[axis, 0] += size * np.cos(2.0 * np.pi * f[axis])
            circle[axis, 1] += size * np.sin(2.0 * np.pi * f[axis])
    turns = np.arctan2(circle[:, 1], circle[:, 0]) / (2.0 * np.pi)
    shared = combine((turns[0], turns[1], turns[2]), basis)
    for g in range(n_traces):
        counts = nearest_image(subtract(row(moves, g), shared), basis, inverse)
        if counts != (0, 0, 0):
            v = lattice_vector(counts, basis)
            for k in range(offsets[g], offsets[g + 1]):
                i = vertices[k]
                x1[i, 0], x1[i, 1], x1[i, 2] = add(row(x1, i), v)


@njit(cache=True, nogil=True)
def image_jumps(before: IntArray, after: IntArray, cell0: FloatArray, cell1: FloatArray, edges: IntArray) -> int:
    """Return how many edges have a stored vector that jumps by a lattice vector from one frame to the next.

    Parameters
    ----------
    before, after : ndarray of int, shape (n, 3)
        By how many vectors of the reduced cell each vertex was moved to make its strand whole.
    cell0, cell1 : ndarray, shape (3, 3)
        Reduced cells.
    edges : ndarray of int, shape (m, 2)
    """
    basis0, basis1 = basis_of(cell0), basis_of(cell1)
    matched = matching_basis(basis0, basis1)
    inverse, same, jumps = inverse_of(matched), matched == basis1, 0
    for k in range(len(edges)):
        a, b = edges[k, 0], edges[k, 1]
        old = (before[b, 0] - before[a, 0], before[b, 1] - before[a, 1], before[b, 2] - before[a, 2])
        new = (after[b, 0] - after[a, 0], after[b, 1] - after[a, 1], after[b, 2] - after[a, 2])
        if not same:
            new = nearest_integers(combine(lattice_vector(new, basis1), inverse))
        jumps += old != new
    return jumps


@njit(cache=True, nogil=True)
def may_jump(motion: StepMotion, longest: float) -> bool:
    """Return whether an edge is so long that it may jump within the step; `longest` is the greatest square, Å²."""
    return not longest * (1.0 + 1e-9) < (LONG_EDGE * norm(basis_of(motion.cell0)[0])) ** 2


@njit(cache=True, nogil=True)
def jumping_edge(motion: StepMotion, edges: IntArray) -> int:
    """Return the first edge whose vector jumps by a lattice vector within the step, -1 where none does.

    It does where both images of the edge are about half a cell long, so that the nearest one is taken now on this side
    and now on the other: the strand behind the edge then jumps with it.
    """
    basis = basis_of(motion.cell0)
    inverse, long = inverse_of(basis), (LONG_EDGE * norm(basis[0])) ** 2
    for k in range(len(edges)):
        e0 = subtract(row(motion.x0, edges[k, 1]), row(motion.x0, edges[k, 0]))
        e1 = subtract(row(motion.x1, edges[k, 1]), row(motion.x1, edges[k, 0]))
        if max(dot(e0, e0), dot(e1, e1)) < long:
            continue
        turn = subtract(e1, e0)
        counts = nearest_image(turn, basis, inverse)
        if counts != (0, 0, 0) and norm(add(turn, lattice_vector(counts, basis))) < 0.5 * norm(turn):
            return k
    return -1


@njit(cache=True, nogil=True)
def edge_lengths(x: FloatArray, edges: IntArray) -> FloatArray:
    """Return the length of each edge, Å, shape (m,)."""
    lengths = np.empty(len(edges))
    write_edge_lengths(x, edges, lengths)
    return lengths


@njit(cache=True, nogil=True)
def write_edge_lengths(x: FloatArray, edges: IntArray, lengths: FloatArray) -> float:
    """Write the length of each edge, Å, and return the square of the greatest one, Å²; 0 without edges."""
    greatest = 0.0
    for k in range(len(edges)):
        bond = subtract(row(x, edges[k, 1]), row(x, edges[k, 0]))
        squared = dot(bond, bond)
        greatest = max(greatest, squared)
        lengths[k] = squared
    for k in range(len(lengths)):  # on their own, so that the compiler takes several roots at a time
        lengths[k] = np.sqrt(lengths[k])
    return greatest


@njit(cache=True, nogil=True)
def greatest_magnitudes(frames: FloatArray) -> FloatArray:
    """Return `greatest_magnitude` of each of several arrays, shape (k,)."""
    found = np.empty(len(frames))
    for k in range(len(frames)):
        found[k] = greatest_magnitude(frames[k])
    return found


@njit(cache=True, nogil=True)
def greatest_magnitude(x: FloatArray) -> float:
    """Return the greatest absolute value in an array in one piece of memory; 0 where it is empty, NaN where it has one.

    Positive floats have the order of their bits, with NaN above infinity, and integers are compared several at a time
    where floats are not.
    """
    bits = x.view(np.int64).reshape(-1)
    greatest = np.int64(0)
    for k in range(len(bits)):
        magnitude = bits[k] & MAGNITUDE
        greatest = magnitude if magnitude > greatest else greatest
    return np.array([greatest]).view(np.float64)[0]
