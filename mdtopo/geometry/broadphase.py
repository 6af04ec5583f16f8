"""Which pairs of moving spheres may meet? A cell grid, with the periodic images as ghosts."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.lattice import fractions, lattice_vector
from mdtopo.geometry.vectors import Vector, add, dot, norm, row, scale, subtract

CELLS_PER_SPHERE = 4
"""The grid is coarsened beyond this many cells per sphere, so that memory follows the number of spheres, not space."""

OVERLAP_GUARD = 1.0 + 1e-12
"""Radii are enlarged by this factor: no pair is lost to rounding of a centre, a radius or a cell index."""

MAX_CELL_DRIFT = 0.8
"""Beyond this the linear path between two cells comes near a cell without volume, and images cannot be counted."""

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True)
def candidate_pairs(
    mid0: FloatArray, mid1: FloatArray, radii: FloatArray, cell0: FloatArray, cell1: FloatArray, periodic: bool
) -> tuple[IntArray, IntArray]:
    """Return every pair of linearly moving spheres that may overlap during the step, periodic images included.

    Parameters
    ----------
    mid0, mid1 : ndarray, shape (m, 3)
        Centres at the start and the end of the step, Å.
    radii : ndarray, shape (m,)
        Radii, constant during the step, Å.
    cell0, cell1 : ndarray, shape (3, 3)
        Lattice vectors at the start and the end; they move linearly too. Ignored unless periodic.
    periodic : bool
        Whether there are images. `cell_drift` must then be below `MAX_CELL_DRIFT`.

    Returns
    -------
    pairs : ndarray of int, shape (k, 2)
        Sphere indices, the first one in the home image.
    images : ndarray of int, shape (k, 3)
        Lattice counts of the second sphere; all 0 without a cell.

    Guarantee
    ---------
    Conservative: no pair, in no image, that overlaps at some time is missing; each appears once. A pair of the list
    need not overlap: each sphere stands for all that it sweeps.
    """
    source, images, home, centres, sizes = _sweep(mid0, mid1, radii, cell0, cell1, periodic)
    order, starts, shape = _bin(centres, 2.0 * sizes.max())
    found, count = _scan(order, starts, shape, centres, sizes, len(radii))
    pairs = np.empty((count, 2), dtype=np.int64)
    shifts = np.zeros((count, 3), dtype=np.int64)
    for k in range(count):
        first, second = found[k, 0], found[k, 1]
        pairs[k, 0], pairs[k, 1] = source[first], source[second]
        if periodic:
            for axis in range(3):
                shifts[k, axis] = images[second, axis] - home[source[first], axis]
    return pairs, shifts


@njit(cache=True, nogil=True)
def _sweep(
    mid0: FloatArray, mid1: FloatArray, radii: FloatArray, cell0: FloatArray, cell1: FloatArray, periodic: bool
) -> tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]:
    """Return swept spheres: the real ones first, then their ghosts; with source, image, centre and radius of each.

    An image moves with its lattice vector, so its sweep is computed from its own two ends.
    """
    m = len(radii)
    source, centres, sizes = np.arange(m), np.empty((m, 3)), np.empty(m)
    home = np.zeros((m, 3), dtype=np.int64)
    if periodic:
        inverse = np.linalg.inv(0.5 * (cell0 + cell1))
        for i in range(m):
            f = fractions(scale(0.5, add(row(mid0, i), row(mid1, i))), inverse)
            for axis in range(3):
                home[i, axis] = -int(np.floor(f[axis]))
    for i in range(m):
        counts = (home[i, 0], home[i, 1], home[i, 2])
        centre, size = _swept_sphere(row(mid0, i), row(mid1, i), radii[i], counts, cell0, cell1, periodic)
        centres[i, 0], centres[i, 1], centres[i, 2] = centre
        sizes[i] = size
    if not periodic:
        return source, home, home, centres, sizes
    ghost_source, ghost_images = _ghosts(centres, sizes, cell0, cell1, home)
    total = m + len(ghost_source)
    all_centres, all_sizes = np.empty((total, 3)), np.empty(total)
    all_centres[:m], all_sizes[:m] = centres, sizes
    for k in range(m, total):
        i, image = ghost_source[k - m], ghost_images[k - m]
        counts = (image[0], image[1], image[2])
        centre, size = _swept_sphere(row(mid0, i), row(mid1, i), radii[i], counts, cell0, cell1, True)
        all_centres[k, 0], all_centres[k, 1], all_centres[k, 2] = centre
        all_sizes[k] = size
    return (
        np.concatenate((source, ghost_source)),
        np.concatenate((home, ghost_images)),
        home,
        all_centres,
        all_sizes,
    )


@njit(cache=True, nogil=True)
def _swept_sphere(
    mid0: Vector,
    mid1: Vector,
    radius: float,
    counts: tuple[int, int, int],
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
) -> tuple[Vector, float]:
    """Return the sphere that holds one image of a moving sphere at all times."""
    start, end = mid0, mid1
    if periodic:
        start, end = add(start, lattice_vector(counts, cell0)), add(end, lattice_vector(counts, cell1))
    size = radius + 0.5 * norm(subtract(end, start))
    return scale(0.5, add(start, end)), size * OVERLAP_GUARD


@njit(cache=True, nogil=True)
def cell_drift(cell0: FloatArray, cell1: FloatArray) -> float:
    """Return how far a neighbouring image drifts in half a step, in units of the least height of the cell.

    The greatest half shift of s·(cell1 - cell0) over |s_k| ≤ 1 stands at a corner of that cube.
    """
    move, inverse = cell1 - cell0, np.linalg.inv(0.5 * (cell0 + cell1))
    greatest = 0.0
    for b in (-1.0, 1.0):
        for c in (-1.0, 1.0):
            corner = add(row(move, 0), add(scale(b, row(move, 1)), scale(c, row(move, 2))))
            greatest = max(greatest, 0.5 * norm(corner))
    return greatest * np.sqrt((inverse * inverse).sum(axis=0).max())


@njit(cache=True, nogil=True)
def _ghosts(
    centres: FloatArray, sizes: FloatArray, cell0: FloatArray, cell1: FloatArray, home: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the images, one half space of shifts only, that can reach a sphere centred in the home cell.

    Of the two descriptions of a pair, (i, j + s) and (j, i - s), one has a lexicographically positive shift.

    An image with fractions f + s meets a home sphere only if -reach ≤ f + s ≤ 1 + reach along each axis, reach being
    the two radii over the height of the cell. Its radius has grown by its drift, at most n·drift for max|s| = n, and
    n ≤ 1 + reach + n·drift bounds n where drift < 1.
    """
    inverse = np.linalg.inv(0.5 * (cell0 + cell1))
    heights = np.sqrt((inverse * inverse).sum(axis=0))  # one over the distance of opposite faces
    largest, drift = sizes.max(), cell_drift(cell0, cell1)
    furthest = (1.0 + 2.0 * largest * heights.max()) / (1.0 - drift)
    capacity, count = len(sizes) + 64, 0
    source, images = np.empty(capacity, dtype=np.int64), np.empty((capacity, 3), dtype=np.int64)
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for i in range(len(sizes)):
        f = fractions(row(centres, i), inverse)
        for axis in range(3):
            reach = (sizes[i] + largest) * heights[axis] + furthest * drift + 1e-9  # rounding of f
            low[axis] = int(np.ceil(-reach - f[axis]))
            high[axis] = int(np.floor(1.0 + reach - f[axis]))
        for a in range(max(low[0], 0), high[0] + 1):
            for b in range(low[1], high[1] + 1):
                for c in range(low[2], high[2] + 1):
                    if a == 0 and (b < 0 or (b == 0 and c <= 0)):
                        continue
                    if count == capacity:
                        capacity *= 2
                        source, images = _grown(source, capacity), _grown_rows(images, capacity)
                    source[count] = i
                    images[count, 0] = home[i, 0] + a
                    images[count, 1] = home[i, 1] + b
                    images[count, 2] = home[i, 2] + c
                    count += 1
    return source[:count].copy(), images[:count].copy()


@njit(cache=True, nogil=True)
def _grown(values: IntArray, capacity: int) -> IntArray:
    larger = np.empty(capacity, dtype=np.int64)
    larger[: len(values)] = values
    return larger


@njit(cache=True, nogil=True)
def _grown_rows(values: IntArray, capacity: int) -> IntArray:
    larger = np.empty((capacity, values.shape[1]), dtype=np.int64)
    larger[: len(values)] = values
    return larger


@njit(cache=True, nogil=True)
def _bin(centres: FloatArray, width: float) -> tuple[IntArray, IntArray, IntArray]:
    """Return spheres sorted by grid cell (x fastest), the start of each cell in that order, and the grid's shape."""
    n = len(centres)
    lowest, extent = np.empty(3), np.empty(3)
    for axis in range(3):
        lowest[axis] = centres[:, axis].min()
        extent[axis] = centres[:, axis].max() - lowest[axis]
    limit = CELLS_PER_SPHERE * n + 64
    width = max(width, 1e-300)
    while np.prod(np.floor(extent / width) + 1.0) > limit:
        width *= 1.26  # doubles the volume of a cell
    shape = np.empty(3, dtype=np.int64)
    for axis in range(3):
        shape[axis] = int(np.floor(extent[axis] / width)) + 1
    cell_of = np.empty(n, dtype=np.int64)
    starts = np.zeros(shape[0] * shape[1] * shape[2] + 1, dtype=np.int64)
    for i in range(n):
        a = min(int((centres[i, 0] - lowest[0]) / width), shape[0] - 1)
        b = min(int((centres[i, 1] - lowest[1]) / width), shape[1] - 1)
        c = min(int((centres[i, 2] - lowest[2]) / width), shape[2] - 1)
        cell_of[i] = (c * shape[1] + b) * shape[0] + a
        starts[cell_of[i] + 1] += 1
    for k in range(1, len(starts)):
        starts[k] += starts[k - 1]
    order, filled = np.empty(n, dtype=np.int64), starts[:-1].copy()
    for i in range(n):
        order[filled[cell_of[i]]] = i
        filled[cell_of[i]] += 1
    return order, starts, shape


@njit(cache=True, nogil=True)
def _scan(
    order: IntArray, starts: IntArray, shape: IntArray, centres: FloatArray, sizes: FloatArray, n_real: int
) -> tuple[IntArray, int]:
    """Return the overlapping pairs (as sphere indices, the real one first), not counting two ghosts."""
    sorted_centres, sorted_sizes = centres[order], sizes[order]
    found, count = np.empty((8 * len(order) + 64, 2), dtype=np.int64), 0
    for c in range(shape[2]):
        for b in range(shape[1]):
            for a in range(shape[0]):
                cell = (c * shape[1] + b) * shape[0] + a
                begin, end = starts[cell], starts[cell + 1]
                if begin == end:
                    continue
                beside = starts[min(cell + 2, (c * shape[1] + b + 1) * shape[0])]
                for neighbour in range(5):  # this row from here on, then the four rows that come later
                    if neighbour == 0:
                        lower, upper = begin, beside
                    else:
                        lower, upper = _later_row(neighbour, a, b, c, shape, starts)
                    if lower == upper:
                        continue
                    for p in range(begin, end):
                        centre, size = row(sorted_centres, p), sorted_sizes[p]
                        if count + upper - lower > len(found):
                            found = _grown_rows(found, 2 * len(found) + upper - lower)
                        for q in range(max(lower, p + 1) if neighbour == 0 else lower, upper):
                            apart = subtract(row(sorted_centres, q), centre)
                            reach = size + sorted_sizes[q]
                            if dot(apart, apart) <= reach * reach:
                                first, second = min(order[p], order[q]), max(order[p], order[q])
                                if first < n_real:
                                    found[count, 0], found[count, 1] = first, second
                                    count += 1
    return found, count


@njit(cache=True, nogil=True)
def _later_row(
    neighbour: int, a: int, b: int, c: int, shape: IntArray, starts: IntArray
) -> tuple[int, int]:
    """Return the range of sorted spheres in cells a-1 … a+1 of one of the four neighbouring rows that come later."""
    if neighbour == 1:
        b, c = b + 1, c
    else:
        b, c = b + neighbour - 3, c + 1
    if b < 0 or b >= shape[1] or c >= shape[2]:
        return 0, 0
    first_cell = (c * shape[1] + b) * shape[0]
    return starts[first_cell + max(a - 1, 0)], starts[first_cell + min(a + 2, shape[0])]


@njit(cache=True, nogil=True)
def all_pairs(
    mid0: FloatArray, mid1: FloatArray, radii: FloatArray, cell0: FloatArray, cell1: FloatArray, periodic: bool, reach: int
) -> tuple[IntArray, IntArray]:
    """Return what `candidate_pairs` returns, by trying every pair in every image up to `reach` cells away.

    The slow twin, kept beside the fast one so that each can be read, and checked, against the other.
    """
    pairs, images = [(0, 0)], [(0, 0, 0)]
    span = reach if periodic else 0
    for i in range(len(radii)):
        for j in range(len(radii)):
            for a in range(-span, span + 1):
                for b in range(-span, span + 1):
                    for c in range(-span, span + 1):
                        if i > j or (i == j and (a, b, c) <= (0, 0, 0)):
                            continue
                        first, r = _swept_sphere(row(mid0, i), row(mid1, i), radii[i], (0, 0, 0), cell0, cell1, False)
                        second, s = _swept_sphere(
                            row(mid0, j), row(mid1, j), radii[j], (a, b, c), cell0, cell1, periodic
                        )
                        if norm(subtract(first, second)) <= r + s:
                            pairs.append((i, j))
                            images.append((a, b, c))
    return np.array(pairs)[1:], np.array(images)[1:]
