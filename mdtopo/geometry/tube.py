"""How close a curve comes to itself: doubly normal pairs of Bezier segments, by branch and bound.

A tube of radius r about a curve is embedded while r ≤ 1/κ_max and 2r is at most the least distance of two points whose
joining line is normal to the curve at both (or at the one that is not an end of the curve). Boxes are pairs of pieces
of segments. A box is dropped where no such pair can lie in it, and split otherwise, nearest first: so the distance
bound of the box at hand bounds all that is left.
"""

import heapq

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.bezier import halve
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.hull import direction_bound, least_norm_point

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SELF, STRANDS, ENDS = 0, 1, 2
"""What is searched: doubly normal pairs of one strand; nearest points of two strands; ends and their own strand."""

DEEPEST = 40
"""Halvings of a segment: beyond, its parameter has no digits left."""

MOST_BOXES = 2_000_000
"""Boxes that one search may look at; then the bound of the box at hand stands for all that are left."""

NEWTON_STEPS = 12
"""Newton's method for a doubly normal pair converges in a few steps, or not at all."""


@njit(cache=True, nogil=True)
def _sphere(points: FloatArray) -> tuple[float, float, float, float]:
    """Return the centre of the bounding box of control points, and how far the furthest of them is from it."""
    centre = np.empty(3)
    for axis in range(3):
        low, high = points[0, axis], points[0, axis]
        for i in range(1, len(points)):
            low, high = min(low, points[i, axis]), max(high, points[i, axis])
        centre[axis] = 0.5 * (low + high)
    radius = 0.0
    for i in range(len(points)):
        radius = max(radius, np.sqrt(np.sum((points[i] - centre) ** 2)))
    return centre[0], centre[1], centre[2], radius


@njit(cache=True, nogil=True)
def _hull_gap(p: FloatArray, q: FloatArray) -> float:
    """Return a lower bound of the distance of the hulls of two sets of control points, rounding included."""
    differences = np.empty((len(p) * len(q), 3))
    for i in range(len(p)):
        for j in range(len(q)):
            for axis in range(3):
                differences[i * len(q) + j, axis] = p[i, axis] - q[j, axis]
    return direction_bound(differences, least_norm_point(differences))


@njit(cache=True, nogil=True)
def _turns_less_than_right(p: FloatArray, q: FloatArray, error: float) -> bool:
    """Return whether all tangents of p make an acute angle with all tangents of q; proven, errors included."""
    for i in range(len(p) - 1):
        a = p[i + 1] - p[i]
        size = np.sqrt(np.sum(a * a)) + 2.0 * error
        for j in range(len(q) - 1):
            b = q[j + 1] - q[j]
            other = np.sqrt(np.sum(b * b)) + 2.0 * error
            if not np.sum(a * b) > 2.0 * error * (size + other) + 8.0 * UNIT_ROUNDOFF * size * other:
                return False
    return True


@njit(cache=True, nogil=True)
def _never_normal(p: FloatArray, q: FloatArray, error: float) -> bool:
    """Return whether no line from a point of p to a point of q is normal to p; proven, errors included."""
    positive, negative = True, True
    for k in range(len(p) - 1):
        h = p[k + 1] - p[k]
        size = np.sqrt(np.sum(h * h)) + 2.0 * error
        for i in range(len(p)):
            for j in range(len(q)):
                d = p[i] - q[j]
                along = np.sum(d * h)
                length = np.sqrt(np.sum(d * d)) + 2.0 * error
                slack = 2.0 * error * (size + length) + 8.0 * UNIT_ROUNDOFF * size * length
                positive = positive and along > slack
                negative = negative and along < -slack
                if not (positive or negative):
                    return False
    return True


@njit(cache=True, nogil=True)
def _at(points: FloatArray, u: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return point, first and second derivative of a segment at u."""
    n, row = len(points) - 1, points.copy()
    bend, velocity = np.zeros(3), np.zeros(3)
    for stop in range(n, 0, -1):
        if stop == 2:
            bend = n * (n - 1) * (row[2] - 2.0 * row[1] + row[0])
        if stop == 1:
            velocity = n * (row[1] - row[0])
        for i in range(stop):
            row[i] = (1.0 - u) * row[i] + u * row[i + 1]
    return row[0].copy(), velocity, bend


@njit(cache=True, nogil=True)
def normal_pair(p: FloatArray, q: FloatArray, s: float, t: float, fixed: bool) -> tuple[float, float, float]:
    """Return parameters and distance of a doubly normal pair near (s, t) by Newton's method; distance inf for none.

    With `fixed` only t moves, and the line need be normal to q alone. Heuristic: what is found is right to rounding.
    """
    for _ in range(NEWTON_STEPS):
        a, a1, a2 = _at(p, s)
        b, b1, b2 = _at(q, t)
        d = a - b
        f, g = np.sum(d * a1), np.sum(d * b1)
        fs, ft = np.sum(a1 * a1) + np.sum(d * a2), -np.sum(b1 * a1)
        gs, gt = np.sum(a1 * b1), np.sum(d * b2) - np.sum(b1 * b1)
        size = np.sqrt(np.sum(d * d))
        small_f = abs(f) <= 1e-13 * size * np.sqrt(np.sum(a1 * a1)) or fixed
        if small_f and abs(g) <= 1e-13 * size * np.sqrt(np.sum(b1 * b1)) and size > 0.0:
            return s, t, size
        if fixed:
            if gt == 0.0:
                return s, t, np.inf
            ds, dt = 0.0, -g / gt
        else:
            determinant = fs * gt - ft * gs
            if determinant == 0.0:
                return s, t, np.inf
            ds, dt = (-f * gt + g * ft) / determinant, (-g * fs + f * gs) / determinant
        s, t = s + ds, t + dt
        if not (-0.1 < s < 1.1 and -0.1 < t < 1.1):
            return s, t, np.inf
        s, t = min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
        if abs(ds) + abs(dt) < 1e-15:
            break
    a, a1, _ = _at(p, s)
    b, b1, _ = _at(q, t)
    d = a - b
    size = np.sqrt(np.sum(d * d))
    small_f = fixed or abs(np.sum(d * a1)) <= 1e-9 * size * np.sqrt(np.sum(a1 * a1))
    if small_f and abs(np.sum(d * b1)) <= 1e-9 * size * np.sqrt(np.sum(b1 * b1)) and size > 0.0:
        return s, t, size
    return s, t, np.inf


@njit(cache=True, nogil=True)
def _grown(array: FloatArray) -> FloatArray:
    bigger = np.empty((2 * array.shape[0], *array.shape[1:]))
    bigger[: array.shape[0]] = array
    return bigger


@njit(cache=True, nogil=True)
def search(
    segments: FloatArray,
    strand: IntArray,
    following: IntArray,
    tips: FloatArray,
    tip_segment: IntArray,
    tip_side: IntArray,
    kind: int,
    horizon: float,
    tolerance: float,
) -> tuple[float, float, float, float, bool]:
    """Return bounds of the least critical distance, the pair that was found, and whether the bounds are close enough.

    Parameters
    ----------
    segments : ndarray, shape (m, degree + 1, 3)
        Control points, Å.
    strand, following : ndarray of int, shape (m,)
        The strand of each segment, and the segment that follows it smoothly (-1: none).
    tips : ndarray, shape (k, 3)
        Ends of open strands, for `ENDS`.
    tip_segment, tip_side : ndarray of int, shape (k,)
        The segment that each is an end of, and which end: 0 its first point, 1 its last.
    kind : int
        `SELF`, `STRANDS` or `ENDS`.
    horizon : float
        Nothing further than this is looked at, Å; a lower bound is then at most the horizon.
    tolerance : float
        Relative distance of the bounds at which the search ends.

    Returns
    -------
    lower, upper : float
        Å; `lower` proven, infinite where there is no such pair; `upper` of the pair that was found, inf for none.
    first, second : float
        Its place, segment + u each (`ENDS`: first is the number of the tip).
    settled : bool
    """
    m, width = segments.shape[0], segments.shape[1]
    n_roots = m + len(tips)
    nodes = np.empty((2 * n_roots + 64, width, 3))
    spheres = np.empty((2 * n_roots + 64, 4))
    data = np.empty((2 * n_roots + 64, 4))  # root, start and length of the piece in its segment, depth
    children = np.full(2 * n_roots + 64, -1)
    extent = 0.0
    for k in range(n_roots):
        for i in range(width):
            nodes[k, i] = segments[k, i] if k < m else tips[k - m]
        x, y, z, r = _sphere(nodes[k])
        spheres[k, 0], spheres[k, 1], spheres[k, 2], spheres[k, 3] = x, y, z, r
        data[k, 0], data[k, 1], data[k, 2], data[k, 3] = k, 0.0, 1.0, 0.0
        extent = max(extent, np.max(np.abs(nodes[k])))
    count = n_roots
    per_level = 2.0 * width * UNIT_ROUNDOFF * extent  # of a halving
    heap = [(0.0, 0, 0)]
    heap.pop()
    lower, upper, first, second, settled = np.inf, np.inf, -1.0, -1.0, True
    for a in range(n_roots):
        for b in range(a, m) if a < m else range(m):
            if kind == ENDS:
                wanted = a >= m and strand[tip_segment[a - m]] == strand[b]
            elif kind == SELF:
                wanted = a < m and strand[a] == strand[b]
            else:
                wanted = a < m and strand[a] != strand[b]
            if not wanted:
                continue
            apart = np.sqrt(np.sum((spheres[a, :3] - spheres[b, :3]) ** 2)) - spheres[a, 3] - spheres[b, 3]
            apart -= 64.0 * UNIT_ROUNDOFF * extent
            if apart < horizon:
                heapq.heappush(heap, (max(apart, 0.0), a, b))
            else:
                lower = min(lower, max(horizon, 0.0))
    looked = 0
    while len(heap) > 0:
        gap, a, b = heapq.heappop(heap)
        if gap >= upper * (1.0 - tolerance) or gap >= horizon:
            lower = min(lower, gap)
            break
        looked += 1
        if looked > MOST_BOXES:
            lower, settled = min(lower, gap), False
            break
        root_a, root_b = int(data[a, 0]), int(data[b, 0])
        error = (max(data[a, 3], data[b, 3]) + 1.0) * per_level
        p, q = nodes[a], nodes[b]
        if kind == SELF:
            if a == b:
                if _turns_less_than_right(p, p, error):
                    continue
            else:
                ends_a, ends_b = data[a, 1] + data[a, 2], data[b, 1] + data[b, 2]
                joined = root_a == root_b and (ends_a == data[b, 1] or ends_b == data[a, 1])
                joined = joined or (following[root_a] == root_b and ends_a == 1.0 and data[b, 1] == 0.0)
                joined = joined or (following[root_b] == root_a and ends_b == 1.0 and data[a, 1] == 0.0)
                if joined and _turns_less_than_right(p, q, error) and _turns_less_than_right(q, q, error):
                    continue
                if _never_normal(p, q, error) or _never_normal(q, p, error):
                    continue
        elif kind == ENDS:
            side = tip_side[a - m]
            own = root_b == tip_segment[a - m] and data[b, 1] + side * data[b, 2] == float(side)
            if own and _turns_less_than_right(q, q, error):
                continue
            if _never_normal(q, p, error):
                continue
        if a != b:
            s, t = data[a, 1] + 0.5 * data[a, 2], data[b, 1] + 0.5 * data[b, 2]
            if kind == STRANDS:
                here = np.sqrt(np.sum((_at(segments[root_a], s)[0] - _at(segments[root_b], t)[0]) ** 2))
                if here < upper:
                    upper, first, second = here, root_a + s, root_b + t
            first_curve = segments[root_a] if root_a < m else nodes[root_a]
            s, t, here = normal_pair(first_curve, segments[root_b], s, t, kind == ENDS)
            if here < upper:
                upper, second = here, root_b + t
                first = root_a + s if root_a < m else float(root_a - m)
        # split the one with the larger sphere; a box on the diagonal splits both
        cut = a if spheres[a, 3] > spheres[b, 3] else b
        if data[cut, 3] >= DEEPEST:
            lower, settled = min(lower, gap), False
            continue
        if children[cut] < 0:
            if count + 2 > len(children):
                nodes, spheres, data = _grown(nodes), _grown(spheres), _grown(data)
                children = np.concatenate((children, np.full(len(children), -1)))
            halve(nodes[cut], nodes[count], nodes[count + 1])
            for side in range(2):
                k = count + side
                x, y, z, r = _sphere(nodes[k])
                spheres[k, 0], spheres[k, 1], spheres[k, 2], spheres[k, 3] = x, y, z, r
                data[k, 0], data[k, 2], data[k, 3] = data[cut, 0], 0.5 * data[cut, 2], data[cut, 3] + 1.0
                data[k, 1] = data[cut, 1] + side * 0.5 * data[cut, 2]
            children[cut] = count
            count += 2
        c = children[cut]
        if a == b:
            heapq.heappush(heap, (0.0, c, c))
            heapq.heappush(heap, (0.0, c, c + 1))
            heapq.heappush(heap, (0.0, c + 1, c + 1))
            continue
        for side in range(2):
            x, y = (c + side, b) if cut == a else (a, c + side)
            apart = _hull_gap(nodes[x], nodes[y]) - 2.0 * (max(data[x, 3], data[y, 3]) + 1.0) * per_level
            heapq.heappush(heap, (max(max(apart, gap), 0.0), x, y))
    return lower, upper, first, second, settled
