"""Which pairs of moving spheres may meet? A cell grid, with the periodic images as ghosts."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.lattice import (
    Basis,
    Counts,
    basis_of,
    combine,
    floors,
    inverse_heights,
    inverse_of,
    lattice_vector,
    middle_of,
    reduced_basis,
    volume,
)
from mdtopo.geometry.vectors import Vector, add, dot, norm, row, scale, subtract

CELLS_PER_SPHERE = 8
"""The grid is coarsened beyond this many cells per sphere, so that memory follows the number of spheres, not space."""

ORDINARY = 1.3
"""Spheres beyond this multiple of the mean radius are large, and looked up one by one; the cells fit the others."""

SLICES = 4
"""Cells are cut this fine along x, where neighbours lie in a row in memory and a finer range of them costs nothing."""

OVERLAP_GUARD = 1.0 + 1e-12
"""Radii are enlarged by this factor: no pair is lost to rounding of a centre, a radius or a cell index."""

GRID_GUARD = 1.0 + 1e-9
"""Cells are wider than needed by this factor: rounding of an index cannot put a pair one cell further apart."""

MAX_CELL_DRIFT = 0.8
"""Beyond this the linear path between two cells comes near a cell without volume, and images cannot be counted."""

FURTHEST_IMAGE = 6.0
"""Cells. Where spheres could reach further, as when a cell turns far in one step, their images are too many to list."""

IntArray = NDArray[np.signedinteger[Any]]
FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True)
def candidate_pairs(
    mid0: FloatArray,
    mid1: FloatArray,
    radii: FloatArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
) -> tuple[IntArray, IntArray, bool]:
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
    pairs : ndarray of int32, shape (k, 2)
        Sphere indices i ≤ j.
    images : ndarray of int, shape (k, 3), or (0, 3)
        Lattice counts of the second sphere, the first one seen at home; for i = j the first that is not 0 is positive.
        Left out where all are 0, without a cell or in a wide one.
    complete : bool
        False where images further than `FURTHEST_IMAGE` cells away might be met; the lists are then empty.

    Guarantee
    ---------
    Conservative: if complete, no pair, in no image, that overlaps at some time is missing; each appears once. A pair
    of the list need not overlap: each sphere stands for all that it sweeps.
    """
    m = len(radii)
    source, images = np.arange(m), np.zeros((m, 3), dtype=np.int64)
    basis0, basis1 = basis_of(cell0), basis_of(cell1)
    has_images = periodic and images_can_meet(mid0, mid1, radii, basis0, basis1)
    if has_images:
        source, images = with_ghosts(mid0, mid1, radii, basis0, basis1, FURTHEST_IMAGE)
    if len(source) < m:
        return np.empty((0, 2), dtype=np.int32), np.empty((0, 3), dtype=np.int64), False
    spheres = _swept_spheres(source, images, mid0, mid1, radii, basis0, basis1)
    order, starts, shape, low, width = sorted_into_cells(spheres, ORDINARY, False)
    spheres = spheres[order]
    found, count = _scan(order, starts, shape, width, spheres, m)
    found, count = _scan_large(order, starts, shape, low, width, spheres, m, found, count)
    if not has_images:
        return found[:count].astype(np.int32), images[:0], True
    pairs, shifts = np.empty((count, 2), dtype=np.int32), np.empty((count, 3), dtype=np.int64)
    for k in range(count):
        first, second = found[k, 0], found[k, 1]
        i, j = source[first], source[second]
        image = between_images(images, first, second)
        if comes_later(i, j, image):
            i, j, image = j, i, (-image[0], -image[1], -image[2])
        pairs[k, 0], pairs[k, 1] = i, j
        shifts[k, 0], shifts[k, 1], shifts[k, 2] = image
    return pairs, shifts, True


@njit(cache=True, nogil=True, inline="always")
def between_images(images: IntArray, first: int, second: int) -> Counts:
    """Return by how many lattice vectors more one thing is moved than another."""
    return (
        images[second, 0] - images[first, 0],
        images[second, 1] - images[first, 1],
        images[second, 2] - images[first, 2],
    )


@njit(cache=True, nogil=True, inline="always")
def comes_later(i: int, j: int, image: Counts) -> bool:
    """Return whether, of the two descriptions of a pair, (i, j + s) and (j, i - s), this is not the one to be used."""
    return i > j or (i == j and image < (0, 0, 0))


@njit(cache=True, nogil=True)
def images_can_meet(mid0: FloatArray, mid1: FloatArray, radii: FloatArray, basis0: Basis, basis1: Basis) -> bool:
    """Return whether the system is large enough for a sphere to meet an image of another, or of itself.

    All spheres stay within R of one point, so nothing meets where images are shifted by more than 2R. This spares a
    molecule that turns in a wide box all its images.
    """
    centre, n = (0.0, 0.0, 0.0), len(radii)
    for i in range(n):
        centre = add(centre, scale(0.5 / n, add(row(mid0, i), row(mid1, i))))
    radius = 0.0
    for i in range(n):
        away = max(norm(subtract(row(mid0, i), centre)), norm(subtract(row(mid1, i), centre)))
        radius = max(radius, away + radii[i])
    return least_shift(basis0, basis1) <= 2.0 * radius * OVERLAP_GUARD


@njit(cache=True, nogil=True)
def least_shift(basis0: Basis, basis1: Basis) -> float:
    """Return a length, Å, that no image of anything is ever shifted by less, while the cell moves linearly.

    An image s is |s·H(t)| away, and s·H(t) lies within |s·ΔH|/2 of one of its ends, which is at most |s·H0|/2 times the
    norm of H0⁻¹ΔH: so the shortest lattice vector of both ends, so reduced. Negative where the cell changes too much.
    """
    inverse, squared = inverse_of(basis0), 0.0
    for k in range(3):
        turned = combine(inverse[k], subtract_bases(basis1, basis0))
        squared += dot(turned, turned)
    shrunk = 1.0 - 0.5 * np.sqrt(squared)
    a, b, c = reduced_basis(basis0)
    end = reduced_basis(basis1)
    shortest = min(norm(a), min(norm(b), norm(c)))
    return min(shortest, min(norm(end[0]), min(norm(end[1]), norm(end[2])))) * shrunk


@njit(cache=True, nogil=True)
def subtract_bases(basis1: Basis, basis0: Basis) -> Basis:
    """Return the differences of the basis vectors."""
    return subtract(basis1[0], basis0[0]), subtract(basis1[1], basis0[1]), subtract(basis1[2], basis0[2])


@njit(cache=True, nogil=True)
def _swept_sphere(
    mid0: Vector, mid1: Vector, radius: float, counts: Counts, basis0: Basis, basis1: Basis
) -> tuple[Vector, float]:
    """Return the sphere that holds one image of a moving sphere at all times.

    An image moves with its lattice vector, so its sweep is computed from its own two ends.
    """
    start, end = add(mid0, lattice_vector(counts, basis0)), add(mid1, lattice_vector(counts, basis1))
    size = radius + 0.5 * norm(subtract(end, start))
    return scale(0.5, add(start, end)), size * OVERLAP_GUARD


@njit(cache=True, nogil=True)
def _swept_spheres(
    source: IntArray,
    images: IntArray,
    mid0: FloatArray,
    mid1: FloatArray,
    radii: FloatArray,
    basis0: Basis,
    basis1: Basis,
) -> FloatArray:
    """Return what the given images of the given spheres sweep: rows (x, y, z, radius)."""
    swept = np.empty((len(source), 4))
    for k in range(len(source)):
        i = source[k]
        counts = (images[k, 0], images[k, 1], images[k, 2])
        centre, size = _swept_sphere(row(mid0, i), row(mid1, i), radii[i], counts, basis0, basis1)
        swept[k, 0], swept[k, 1], swept[k, 2] = centre
        swept[k, 3] = size
    return swept


@njit(cache=True, nogil=True)
def with_ghosts(
    mid0: FloatArray, mid1: FloatArray, radii: FloatArray, basis0: Basis, basis1: Basis, furthest_image: float
) -> tuple[IntArray, IntArray]:
    """Return source and image of each sphere brought into the home cell, and of the ghosts that can reach one there.

    Nothing is returned where images further than `furthest_image` cells away might be met. Ghosts come from one half
    space of shifts only: of the two descriptions of a pair, (i, j + s) and (j, i - s), one has a lexicographically
    positive shift.

    An image with fractions f + s meets a home sphere only if -reach ≤ f + s ≤ 1 + reach along each axis, reach being
    the two radii over the height of the cell. Its radius has grown by its drift, at most n·drift for max|s| = n, and
    n ≤ 1 + reach + n·drift bounds n where drift < 1.
    """
    m = len(radii)
    inverse = inverse_of(middle_of(basis0, basis1))
    heights = inverse_heights(inverse)
    thin = max(heights[0], heights[1], heights[2])
    home = np.empty((m, 3), dtype=np.int64)
    places = np.empty((m, 4))  # fractions within the home cell, and the radius
    largest = 0.0
    for i in range(m):
        f = combine(scale(0.5, add(row(mid0, i), row(mid1, i))), inverse)
        whole = floors(f)
        home[i, 0], home[i, 1], home[i, 2] = -whole[0], -whole[1], -whole[2]
        counts = (-whole[0], -whole[1], -whole[2])
        _, size = _swept_sphere(row(mid0, i), row(mid1, i), radii[i], counts, basis0, basis1)
        places[i, 0], places[i, 1], places[i, 2] = f[0] - whole[0], f[1] - whole[1], f[2] - whole[2]
        places[i, 3] = size
        largest = max(largest, size)
    drift = cell_drift(basis0, basis1)
    count, capacity = m, 2 * m + 64
    source, images = np.empty(capacity, dtype=np.int64), np.empty((capacity, 3), dtype=np.int64)
    source[:m], images[:m] = np.arange(m), home
    furthest = (1.0 + 2.0 * largest * thin) / (1.0 - drift)
    if not furthest <= furthest_image:
        return source[:0], images[:0]
    blur = furthest * drift + 1e-9  # drift of the image, and rounding of f
    for i in range(m):
        x, y, z, size = places[i, 0], places[i, 1], places[i, 2], places[i, 3] + largest
        reach = (size * heights[0] + blur, size * heights[1] + blur, size * heights[2] + blur)
        for a in range(int(np.floor(1.0 + reach[0] - x)) + 1):
            for b in range(int(np.ceil(-reach[1] - y)), int(np.floor(1.0 + reach[1] - y)) + 1):
                for c in range(int(np.ceil(-reach[2] - z)), int(np.floor(1.0 + reach[2] - z)) + 1):
                    if a == 0 and (b < 0 or (b == 0 and c <= 0)):
                        continue
                    if count == capacity:
                        capacity *= 2
                        source, images = _grown(source, capacity), grown_rows(images, capacity)
                    source[count] = i
                    images[count, 0], images[count, 1] = home[i, 0] + a, home[i, 1] + b
                    images[count, 2] = home[i, 2] + c
                    count += 1
    return source[:count].copy(), images[:count].copy()


@njit(cache=True, nogil=True)
def cell_drift(basis0: Basis, basis1: Basis) -> float:
    """Return how far a neighbouring image drifts in half a step, in units of the least height of the cell.

    The greatest half shift of s·(basis1 - basis0) over |s_k| ≤ 1 stands at a corner of that cube.
    """
    x, y, z = subtract_bases(basis1, basis0)
    greatest = 0.0
    for corner in range(4):
        b, c = 1.0 - 2.0 * (corner & 1), 1.0 - (corner & 2)
        greatest = max(greatest, 0.5 * norm(add(x, add(scale(b, y), scale(c, z)))))
    middle = middle_of(basis0, basis1)
    if greatest == 0.0:
        return 0.0
    if abs(volume(middle)) <= 1e-12 * abs(volume(basis0)):
        return np.inf
    heights = inverse_heights(inverse_of(middle))
    return greatest * max(heights[0], heights[1], heights[2])


@njit(cache=True, nogil=True)
def _grown(values: IntArray, capacity: int) -> IntArray:
    larger = np.empty(capacity, dtype=np.int64)
    larger[: len(values)] = values
    return larger


@njit(cache=True, nogil=True)
def grown_rows(values: IntArray, capacity: int) -> IntArray:
    """Return rows of integers with room for more behind them."""
    larger = np.empty((capacity, values.shape[1]), dtype=values.dtype)
    larger[: len(values)] = values
    return larger


@njit(cache=True, nogil=True)
def sorted_into_cells(
    spheres: FloatArray, ordinary: float, across: bool
) -> tuple[IntArray, IntArray, Counts, Vector, float]:
    """Return the spheres sorted by grid cell (x fastest), the start of each cell, and the grid: shape, origin, width.

    Two spheres of ordinary size, up to so many times the mean radius, that meet lie in the same cell or in adjacent
    ones. Cells go all across the system along y where this is asked for.
    """
    n = len(spheres)
    low, high, largest, total = row(spheres, 0), row(spheres, 0), 0.0, 0.0
    for i in range(n):
        v = row(spheres, i)
        low = (min(low[0], v[0]), min(low[1], v[1]), min(low[2], v[2]))
        high = (max(high[0], v[0]), max(high[1], v[1]), max(high[2], v[2]))
        largest, total = max(largest, spheres[i, 3]), total + spheres[i, 3]
    extent, width = subtract(high, low), max(2.0 * min(largest, ordinary * total / n) * GRID_GUARD, 1e-300)
    limit = CELLS_PER_SPHERE * n + 64
    if across:
        extent = (extent[0], 0.0, extent[2])
    while (extent[0] // (width / SLICES) + 1.0) * (extent[1] // width + 1.0) * (extent[2] // width + 1.0) > limit:
        width *= 1.26  # doubles the volume of a cell
    nx, ny, nz = int(extent[0] // (width / SLICES)) + 1, int(extent[1] // width) + 1, int(extent[2] // width) + 1
    cell_of, starts = np.empty(n, dtype=np.int64), np.zeros(nx * ny * nz + 1, dtype=np.int64)
    for i in range(n):
        a = min(int((spheres[i, 0] - low[0]) / (width / SLICES)), nx - 1)
        b = min(int((spheres[i, 1] - low[1]) / width), ny - 1)
        c = min(int((spheres[i, 2] - low[2]) / width), nz - 1)
        cell_of[i] = (c * ny + b) * nx + a
        starts[cell_of[i] + 1] += 1
    for k in range(1, len(starts)):
        starts[k] += starts[k - 1]
    order, filled = np.empty(n, dtype=np.int64), starts[:-1].copy()
    for i in range(n):
        order[filled[cell_of[i]]] = i
        filled[cell_of[i]] += 1
    return order, starts, (nx, ny, nz), low, width


@njit(cache=True, nogil=True)
def _scan(
    order: IntArray, starts: IntArray, shape: Counts, width: float, spheres: FloatArray, n_real: int
) -> tuple[IntArray, int]:
    """Return the overlapping pairs of ordinary spheres, lower index first, without those of two ghosts.

    Each cell meets the rest of its own row, and those of the rows beside it that come later. The radius of a large
    sphere is written as NaN here, with which it meets nobody.
    """
    nx, ny, nz = shape
    spheres = spheres.copy()
    for p in range(len(spheres)):
        if 2.0 * spheres[p, 3] > width:
            spheres[p, 3] = np.nan
    found, count = np.empty((8 * len(order) + 64, 2), dtype=np.int64), 0
    for cell in range(nx * ny * nz):
        begin, end = starts[cell], starts[cell + 1]
        if begin == end:
            continue
        a, b, c = cell % nx, (cell // nx) % ny, cell // (nx * ny)
        left, right = max(a - SLICES, 0), min(a + SLICES + 1, nx)
        for other_c in range(c, min(c + 2, nz)):
            for other_b in range(b if other_c == c else max(b - 1, 0), min(b + 2, ny)):
                first_cell = (other_c * ny + other_b) * nx
                own_row = other_b == b and other_c == c
                lower, upper = starts[first_cell + left], starts[first_cell + right]
                if count + (end - begin) * (upper - lower) > len(found):
                    found = grown_rows(found, 2 * len(found) + (end - begin) * (upper - lower))
                for p in range(begin, end):
                    x, y, z, size, i = spheres[p, 0], spheres[p, 1], spheres[p, 2], spheres[p, 3], order[p]
                    for q in range(p + 1 if own_row else lower, upper):
                        u, v, w = spheres[q, 0] - x, spheres[q, 1] - y, spheres[q, 2] - z
                        reach = size + spheres[q, 3]
                        if u * u + v * v + w * w <= reach * reach:
                            j = order[q]
                            found[count, 0], found[count, 1] = min(i, j), max(i, j)
                            count += min(i, j) < n_real
    return found, count


@njit(cache=True, nogil=True)
def _scan_large(
    order: IntArray,
    starts: IntArray,
    shape: Counts,
    low: Vector,
    width: float,
    spheres: FloatArray,
    n_real: int,
    found: IntArray,
    count: int,
) -> tuple[IntArray, int]:
    """Add the pairs of which one sphere is large: each looks as far as it can reach, and of two the later one looks."""
    nx, ny, nz = shape
    largest = 0.0
    for p in range(len(spheres)):
        largest = max(largest, spheres[p, 3])
    for p in range(len(spheres)):
        x, y, z, size, i = spheres[p, 0], spheres[p, 1], spheres[p, 2], spheres[p, 3], order[p]
        if not 2.0 * size > width:
            continue
        far = (size + largest) * GRID_GUARD
        left, right = cells_between(x - low[0], far, width / SLICES, nx)
        first_b, last_b = cells_between(y - low[1], far, width, ny)
        first_c, last_c = cells_between(z - low[2], far, width, nz)
        for c in range(first_c, last_c + 1):
            for b in range(first_b, last_b + 1):
                first_cell = (c * ny + b) * nx
                lower, upper = starts[first_cell + left], starts[first_cell + right + 1]
                if count + upper - lower > len(found):
                    found = grown_rows(found, 2 * len(found) + upper - lower)
                for q in range(lower, upper):
                    if q >= p and 2.0 * spheres[q, 3] > width:
                        continue
                    u, v, w = spheres[q, 0] - x, spheres[q, 1] - y, spheres[q, 2] - z
                    reach = size + spheres[q, 3]
                    if u * u + v * v + w * w <= reach * reach:
                        j = order[q]
                        found[count, 0], found[count, 1] = min(i, j), max(i, j)
                        count += min(i, j) < n_real
    return found, count


@njit(cache=True, nogil=True)
def cells_between(place: float, far: float, width: float, n: int) -> tuple[int, int]:
    """Return the first and the last cell along an axis that hold points within `far` of a place."""
    first = int(min(max(np.floor((place - far) / width), 0.0), n - 1.0))
    last = int(min(max(np.floor((place + far) / width), 0.0), n - 1.0))
    return first, last


@njit(cache=True, nogil=True)
def all_pairs(
    mid0: FloatArray,
    mid1: FloatArray,
    radii: FloatArray,
    cell0: FloatArray,
    cell1: FloatArray,
    periodic: bool,
    span: int,
) -> tuple[IntArray, IntArray]:
    """Return what `candidate_pairs` returns, by trying every pair in every image up to `span` cells away.

    The slow twin, kept beside the fast one so that each can be read, and checked, against the other.
    """
    pairs, images = [(0, 0)], [(0, 0, 0)]
    basis0, basis1 = basis_of(cell0), basis_of(cell1)
    reach = span if periodic else 0
    for i in range(len(radii)):
        first, r = _swept_sphere(row(mid0, i), row(mid1, i), radii[i], (0, 0, 0), basis0, basis1)
        for j in range(i, len(radii)):
            for a in range(-reach, reach + 1):
                for b in range(-reach, reach + 1):
                    for c in range(-reach, reach + 1):
                        if i == j and (a, b, c) <= (0, 0, 0):
                            continue
                        second, s = _swept_sphere(row(mid0, j), row(mid1, j), radii[j], (a, b, c), basis0, basis1)
                        apart = subtract(first, second)
                        if dot(apart, apart) <= (r + s) * (r + s):
                            pairs.append((i, j))
                            images.append((a, b, c))
    return np.array(pairs)[1:], np.array(images)[1:]
