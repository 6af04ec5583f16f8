"""Periodic cells: short bases, nearest images, whole strands. Images are counted in integers, never in lengths.

A `Basis` is three row vectors as tuples, which the compiler keeps in registers; `basis_of` makes one of an array.
"""

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.vectors import Vector, add, cross, dot, norm, row, scale, subtract

Basis: TypeAlias = tuple[Vector, Vector, Vector]
Counts: TypeAlias = tuple[int, int, int]


@njit(cache=True, nogil=True)
def basis_of(cell: NDArray[np.float64]) -> Basis:
    """Return the rows of a cell, shape (3, 3), as tuples."""
    return row(cell, 0), row(cell, 1), row(cell, 2)


@njit(cache=True, nogil=True)
def store_basis(basis: Basis, cell: NDArray[np.float64]) -> None:
    """Write a basis into an array of shape (3, 3)."""
    cell[0, 0], cell[0, 1], cell[0, 2] = basis[0]
    cell[1, 0], cell[1, 1], cell[1, 2] = basis[1]
    cell[2, 0], cell[2, 1], cell[2, 2] = basis[2]


@njit(cache=True, nogil=True)
def combine(factors: Vector, basis: Basis) -> Vector:
    """Return the sum of the basis vectors, each times its factor: a row vector times a matrix."""
    x = factors[0] * basis[0][0] + factors[1] * basis[1][0] + factors[2] * basis[2][0]
    y = factors[0] * basis[0][1] + factors[1] * basis[1][1] + factors[2] * basis[2][1]
    z = factors[0] * basis[0][2] + factors[1] * basis[1][2] + factors[2] * basis[2][2]
    return x, y, z


@njit(cache=True, nogil=True)
def lattice_vector(counts: Counts, basis: Basis) -> Vector:
    """Return the vector of so many steps along each basis vector."""
    return combine((float(counts[0]), float(counts[1]), float(counts[2])), basis)


@njit(cache=True, nogil=True)
def volume(basis: Basis) -> float:
    """Return the signed volume of the cell, Å³."""
    return dot(basis[0], cross(basis[1], basis[2]))


@njit(cache=True, nogil=True)
def inverse_of(basis: Basis) -> Basis:
    """Return the rows of the inverse of a cell that has a volume; ``combine(v, inverse)`` are the fractions of v."""
    a, b, c = cross(basis[1], basis[2]), cross(basis[2], basis[0]), cross(basis[0], basis[1])
    factor = 1.0 / dot(basis[0], a)
    return (
        scale(factor, (a[0], b[0], c[0])),
        scale(factor, (a[1], b[1], c[1])),
        scale(factor, (a[2], b[2], c[2])),
    )


@njit(cache=True, nogil=True)
def inverse_heights(inverse: Basis) -> Vector:
    """Return one over the distance of the two faces of the cell that lie across each axis."""
    x, y, z = inverse
    return (
        np.sqrt(x[0] * x[0] + y[0] * y[0] + z[0] * z[0]),
        np.sqrt(x[1] * x[1] + y[1] * y[1] + z[1] * z[1]),
        np.sqrt(x[2] * x[2] + y[2] * y[2] + z[2] * z[2]),
    )


@njit(cache=True, nogil=True)
def total_length(basis: Basis) -> float:
    """Return the summed lengths of the basis vectors; counts up to n give no combination longer than n times that."""
    return norm(basis[0]) + norm(basis[1]) + norm(basis[2])


@njit(cache=True, nogil=True)
def middle_of(basis0: Basis, basis1: Basis) -> Basis:
    """Return the mean of two bases: the cell at half time."""
    return (
        scale(0.5, add(basis0[0], basis1[0])),
        scale(0.5, add(basis0[1], basis1[1])),
        scale(0.5, add(basis0[2], basis1[2])),
    )


@njit(cache=True, nogil=True)
def nearest_integers(v: Vector) -> Counts:
    """Return the components rounded to integers."""
    return round(v[0]), round(v[1]), round(v[2])


@njit(cache=True, nogil=True)
def floors(v: Vector) -> Counts:
    """Return the components rounded down to integers."""
    return int(np.floor(v[0])), int(np.floor(v[1])), int(np.floor(v[2]))


@njit(cache=True, nogil=True)
def reduced_basis(basis: Basis) -> Basis:
    """Return the Minkowski-reduced basis of a lattice: its shortest vectors, whatever the shape of the cell.

    Notes
    -----
    Semaev, *A 3-dimensional lattice reduction algorithm* (2001): reduce the two shorter vectors as Gauss does, shorten
    the third by the nearest vector of their plane, sort, repeat.
    """
    a, b, c = basis
    for _ in range(1000):
        if dot(b, b) < dot(a, a):
            a, b = b, a
        if dot(c, c) < dot(b, b):
            b, c = c, b
        if dot(b, b) < dot(a, a):
            a, b = b, a
        factor = round(dot(b, a) / dot(a, a))
        if factor != 0:
            b = subtract(b, scale(float(factor), a))
            continue
        shorter = _shortened(a, b, c)
        if shorter == c:
            break
        c = shorter
    return a, b, c


@njit(cache=True, nogil=True)
def _shortened(a: Vector, b: Vector, v: Vector) -> Vector:
    """Return v + m·a + n·b for the integers that make it shortest; v itself where nothing is gained."""
    aa, bb, ab, av, bv = dot(a, a), dot(b, b), dot(a, b), dot(a, v), dot(b, v)
    determinant = aa * bb - ab * ab
    m0, n0 = round(-(av * bb - bv * ab) / determinant), round(-(bv * aa - av * ab) / determinant)
    best, least = v, dot(v, v) * (1.0 - 1e-12)  # a tie must not swing for ever
    for i in range(-1, 2):
        for j in range(-1, 2):
            w = add(v, add(scale(float(m0 + i), a), scale(float(n0 + j), b)))
            if dot(w, w) < least:
                best, least = w, dot(w, w)
    return best


@njit(cache=True, nogil=True)
def nearest_image(v: Vector, basis: Basis, inverse: Basis) -> Counts:
    """Return the lattice counts that make v, a difference of two positions, shortest.

    Parameters
    ----------
    v : tuple of 3 floats
        Å.
    basis : Basis
        A *reduced* basis; of its vectors shifted by -1, 0 or 1 from the rounded fractions one is the nearest image.
    inverse : Basis
        Its inverse.
    """
    if 4.0 * dot(v, v) < dot(basis[0], basis[0]):  # within half the shortest vector nothing can be nearer
        return 0, 0, 0
    f = nearest_integers(combine(v, inverse))
    rounded = (-f[0], -f[1], -f[2])
    best = add(v, lattice_vector(rounded, basis))
    if 4.0 * dot(best, best) < dot(basis[0], basis[0]):
        return rounded
    counts, least = rounded, dot(best, best)
    for i in range(-1, 2):
        for j in range(-1, 2):
            for k in range(-1, 2):
                trial = (rounded[0] + i, rounded[1] + j, rounded[2] + k)
                w = add(v, lattice_vector(trial, basis))
                if dot(w, w) < least:
                    counts, least = trial, dot(w, w)
    return counts


@njit(cache=True, nogil=True)
def whole_counts(
    x: NDArray[np.float64],
    basis: Basis,
    vertices: NDArray[np.int64],
    offsets: NDArray[np.int64],
    closed: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return by how many lattice vectors each vertex moves when its strand is made whole along the trace.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions as stored.
    basis : Basis
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
    inverse, shortest = inverse_of(basis), dot(basis[0], basis[0])
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
            v = subtract(row(x, after), row(x, here))
            if not 4.0 * dot(v, v) < shortest:  # else `nearest_image` would say so, at twice the cost
                move = nearest_image(v, basis, inverse)
                total = (total[0] + move[0], total[1] + move[1], total[2] + move[2])
        if closed[trace]:
            winding[trace, 0], winding[trace, 1], winding[trace, 2] = total
    return counts, winding
