"""Periodic cells: short bases, nearest images, whole strands. Images are counted in integers, never in lengths."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.vectors import Vector, add, dot, row, scale, subtract


@njit(cache=True, nogil=True)
def lattice_vector(counts: tuple[int, int, int], cell: NDArray[np.float64]) -> Vector:
    """Return counts · cell, the vector of so many steps along each row of the cell."""
    x = counts[0] * cell[0, 0] + counts[1] * cell[1, 0] + counts[2] * cell[2, 0]
    y = counts[0] * cell[0, 1] + counts[1] * cell[1, 1] + counts[2] * cell[2, 1]
    z = counts[0] * cell[0, 2] + counts[1] * cell[1, 2] + counts[2] * cell[2, 2]
    return x, y, z


@njit(cache=True, nogil=True)
def fractions(v: Vector, inverse: NDArray[np.float64]) -> Vector:
    """Return v in units of the cell's rows; `inverse` is the inverse of the cell."""
    x = v[0] * inverse[0, 0] + v[1] * inverse[1, 0] + v[2] * inverse[2, 0]
    y = v[0] * inverse[0, 1] + v[1] * inverse[1, 1] + v[2] * inverse[2, 1]
    z = v[0] * inverse[0, 2] + v[1] * inverse[1, 2] + v[2] * inverse[2, 2]
    return x, y, z


@njit(cache=True, nogil=True)
def reduced_cell(cell: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the Minkowski-reduced basis of a lattice: its shortest vectors, whatever the shape of the cell.

    Parameters
    ----------
    cell : ndarray, shape (3, 3)
        Any basis, rows.

    Returns
    -------
    basis : ndarray, shape (3, 3)
        Rows, shortest first; ``basis = change @ cell``.
    change : ndarray of int, shape (3, 3)
        The unimodular change of basis.

    Notes
    -----
    Semaev, *A 3-dimensional lattice reduction algorithm* (2001): reduce the two shorter vectors as Gauss does, shorten
    the third by the nearest vector of their plane, sort, repeat.
    """
    basis, change = cell.copy(), np.eye(3, dtype=np.int64)
    for _ in range(1000):
        order = np.argsort(np.array([dot(row(basis, k), row(basis, k)) for k in range(3)]))
        basis, change = basis[order], change[order]
        factor = round(dot(row(basis, 1), row(basis, 0)) / dot(row(basis, 0), row(basis, 0)))
        if factor != 0:
            basis[1] -= factor * basis[0]
            change[1] -= int(factor) * change[0]
            continue
        m, n = _plane_counts(basis)
        if m == 0 and n == 0:
            break
        basis[2] += m * basis[0] + n * basis[1]
        change[2] += m * change[0] + n * change[1]
    return basis, change


@njit(cache=True, nogil=True)
def _plane_counts(basis: NDArray[np.float64]) -> tuple[int, int]:
    """Return the counts (m, n) that shorten the third vector most, as v + m·a + n·b; (0, 0) if nothing does."""
    a, b, v = row(basis, 0), row(basis, 1), row(basis, 2)
    aa, bb, ab, av, bv = dot(a, a), dot(b, b), dot(a, b), dot(a, v), dot(b, v)
    determinant = aa * bb - ab * ab
    m0 = int(round(-(av * bb - bv * ab) / determinant))
    n0 = int(round(-(bv * aa - av * ab) / determinant))
    best, least = (0, 0), dot(v, v) * (1.0 - 1e-12)  # a tie must not swing for ever
    for m in range(m0 - 1, m0 + 2):
        for n in range(n0 - 1, n0 + 2):
            w = add(v, add(scale(float(m), a), scale(float(n), b)))
            if dot(w, w) < least:
                best, least = (m, n), dot(w, w)
    return best


@njit(cache=True, nogil=True)
def nearest_image(
    v: Vector, basis: NDArray[np.float64], inverse: NDArray[np.float64]
) -> tuple[tuple[int, int, int], Vector]:
    """Return the lattice counts that make v shortest, and v so shifted.

    Parameters
    ----------
    v : tuple of 3 floats
        A difference of two positions, Å.
    basis : ndarray, shape (3, 3)
        A *reduced* basis; of its vectors shifted by -1, 0 or 1 from the rounded fractions one is the nearest image.
    inverse : ndarray, shape (3, 3)
        Its inverse.
    """
    f = fractions(v, inverse)
    counts = (-int(round(f[0])), -int(round(f[1])), -int(round(f[2])))
    best = add(v, lattice_vector(counts, basis))
    shortest = dot(row(basis, 0), row(basis, 0))
    if 4.0 * dot(best, best) < shortest:  # within half the shortest lattice vector nothing can be nearer
        return counts, best
    rounded, least = counts, dot(best, best)
    for i in range(-1, 2):
        for j in range(-1, 2):
            for k in range(-1, 2):
                trial = (rounded[0] + i, rounded[1] + j, rounded[2] + k)
                w = add(v, lattice_vector(trial, basis))
                if dot(w, w) < least:
                    counts, best, least = trial, w, dot(w, w)
    return counts, best


@njit(cache=True, nogil=True)
def whole_counts(
    x: NDArray[np.float64],
    basis: NDArray[np.float64],
    vertices: NDArray[np.int64],
    offsets: NDArray[np.int64],
    closed: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return by how many lattice vectors each vertex moves when its strand is made whole along the trace.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions as stored.
    basis : ndarray, shape (3, 3)
        A reduced basis.
    vertices, offsets, closed : ndarray
        Trace g visits ``vertices[offsets[g]:offsets[g + 1]]`` in this order, and returns if closed.

    Returns
    -------
    counts : ndarray of int, shape (n, 3)
        The first vertex of each trace stays; the others follow by nearest images of consecutive vertices.
    winding : ndarray of int, shape (n_traces, 3)
        What is left over when a closed trace has come round: nonzero where it closes through the boundary.
    """
    inverse = np.linalg.inv(basis)
    counts = np.zeros(x.shape, dtype=np.int64)
    winding = np.zeros((len(closed), 3), dtype=np.int64)
    for trace in range(len(closed)):
        start, stop = offsets[trace], offsets[trace + 1]
        total = (0, 0, 0)
        for k in range(start, stop):
            here = vertices[k]
            counts[here, 0], counts[here, 1], counts[here, 2] = total
            if k + 1 == stop and not closed[trace]:
                break
            after = vertices[k + 1] if k + 1 < stop else vertices[start]
            move, _ = nearest_image(subtract(row(x, after), row(x, here)), basis, inverse)
            total = (total[0] + move[0], total[1] + move[1], total[2] + move[2])
        if closed[trace]:
            winding[trace, 0], winding[trace, 1], winding[trace, 2] = total
    return counts, winding
