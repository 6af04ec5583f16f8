"""How close a curve comes to itself: doubly normal pairs of Bezier segments, by branch and bound.

A tube of radius r about a curve is embedded while r ≤ 1/κ_max and 2r is at most the least distance of two points whose
joining line is normal to the curve at both (or at the one that is not an end of the curve). Boxes are pairs of pieces
of segments. A box is dropped where no such pair can lie in it, and split otherwise, nearest first: so the distance
bound of the box at hand bounds all that is left.
"""

import heapq
from typing import NamedTuple

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


class _Boxes(NamedTuple):
    """The pieces of a search: control points, bounding spheres, first half (-1: not cut), and where each piece lies.

    `data` holds root, start and length of the piece in its segment, depth.
    """

    nodes: FloatArray
    spheres: FloatArray
    data: FloatArray
    children: IntArray


@njit(cache=True, nogil=True)
def _room(boxes: _Boxes, count: int) -> _Boxes:
    """Return the boxes with room for `count`: themselves, or copies of twice the size."""
    size = len(boxes.children)
    if count <= size:
        return boxes
    nodes, spheres = np.empty((2 * size, *boxes.nodes.shape[1:])), np.empty((2 * size, 4))
    data, children = np.empty((2 * size, 4)), np.full(2 * size, -1)
    nodes[:size], spheres[:size], data[:size], children[:size] = boxes.nodes, boxes.spheres, boxes.data, boxes.children
    return _Boxes(nodes, spheres, data, children)


@njit(cache=True, nogil=True)
def _place(boxes: _Boxes, k: int, root: float, start: float, length: float, depth: float) -> None:
    """Write the sphere and the place of a box whose control points are there."""
    x, y, z, r = _sphere(boxes.nodes[k])
    spheres, data = boxes.spheres, boxes.data
    spheres[k, 0], spheres[k, 1], spheres[k, 2], spheres[k, 3] = x, y, z, r
    data[k, 0], data[k, 1], data[k, 2], data[k, 3] = root, start, length, depth


@njit(cache=True, nogil=True)
def _roots(segments: FloatArray, tips: FloatArray) -> tuple[_Boxes, float]:
    """Return the boxes of whole segments, then of the tips, and the greatest coordinate."""
    m, width = segments.shape[0], segments.shape[1]
    n_roots = m + len(tips)
    size = 2 * n_roots + 64
    boxes = _Boxes(np.empty((size, width, 3)), np.empty((size, 4)), np.empty((size, 4)), np.full(size, -1))
    extent = 0.0
    for k in range(n_roots):
        for i in range(width):
            boxes.nodes[k, i] = segments[k, i] if k < m else tips[k - m]
        _place(boxes, k, float(k), 0.0, 1.0, 0.0)
        extent = max(extent, np.max(np.abs(boxes.nodes[k])))
    return boxes, extent


@njit(cache=True, nogil=True)
def _is_wanted(kind: int, a: int, b: int, m: int, strand: IntArray, tip_segment: IntArray) -> bool:
    """Return whether two roots, b a segment, are a pair of the kind that is searched."""
    if kind == ENDS:
        return a >= m and strand[tip_segment[a - m]] == strand[b]
    return a < m and (strand[a] == strand[b]) == (kind == SELF)


@njit(cache=True, nogil=True)
def _are_joined(boxes: _Boxes, a: int, b: int, following: IntArray) -> bool:
    """Return whether two pieces meet end to start."""
    data = boxes.data
    root_a, root_b = int(data[a, 0]), int(data[b, 0])
    end_a, end_b = data[a, 1] + data[a, 2], data[b, 1] + data[b, 2]
    if root_a == root_b and (end_a == data[b, 1] or end_b == data[a, 1]):
        return True
    if following[root_a] == root_b and end_a == 1.0 and data[b, 1] == 0.0:
        return True
    return following[root_b] == root_a and end_b == 1.0 and data[a, 1] == 0.0


@njit(cache=True, nogil=True)
def _holds_none(
    boxes: _Boxes,
    a: int,
    b: int,
    kind: int,
    following: IntArray,
    tip_segment: IntArray,
    tip_side: IntArray,
    m: int,
    error: float,
) -> bool:
    """Return whether two boxes provably hold no critical pair: too straight near a joint, or nowhere normal."""
    p, q = boxes.nodes[a], boxes.nodes[b]
    if kind == SELF:
        if a == b:
            return _turns_less_than_right(p, p, error)
        joined = _are_joined(boxes, a, b, following)
        if joined and _turns_less_than_right(p, q, error) and _turns_less_than_right(q, q, error):
            return True
        return _never_normal(p, q, error) or _never_normal(q, p, error)
    if kind == ENDS:
        side, data = tip_side[a - m], boxes.data
        own = int(data[b, 0]) == tip_segment[a - m] and data[b, 1] + side * data[b, 2] == float(side)
        return (own and _turns_less_than_right(q, q, error)) or _never_normal(q, p, error)
    return False


@njit(cache=True, nogil=True)
def _pair_inside(
    segments: FloatArray, boxes: _Boxes, a: int, b: int, kind: int, upper: float, first: float, second: float
) -> tuple[float, float, float]:
    """Return the nearer one of the pair found before and the pair that a local search in two boxes finds."""
    m, data = segments.shape[0], boxes.data
    root_a, root_b = int(data[a, 0]), int(data[b, 0])
    s, t = data[a, 1] + 0.5 * data[a, 2], data[b, 1] + 0.5 * data[b, 2]
    if kind == STRANDS:
        here = np.sqrt(np.sum((_at(segments[root_a], s)[0] - _at(segments[root_b], t)[0]) ** 2))
        if here < upper:
            upper, first, second = here, root_a + s, root_b + t
    first_curve = segments[root_a] if root_a < m else boxes.nodes[root_a]
    s, t, here = normal_pair(first_curve, segments[root_b], s, t, kind == ENDS)
    if here < upper:
        upper, second = here, root_b + t
        first = root_a + s if root_a < m else float(root_a - m)
    return upper, first, second


@njit(cache=True, nogil=True)
def _halved(boxes: _Boxes, cut: int, count: int) -> tuple[_Boxes, int]:
    """Return the boxes with the two halves of one of them, and how many boxes there are then."""
    if boxes.children[cut] >= 0:
        return boxes, count
    boxes = _room(boxes, count + 2)
    halve(boxes.nodes[cut], boxes.nodes[count], boxes.nodes[count + 1])
    data = boxes.data
    root, start, length, depth = data[cut, 0], data[cut, 1], data[cut, 2], data[cut, 3]
    for side in range(2):
        _place(boxes, count + side, root, start + side * 0.5 * length, 0.5 * length, depth + 1.0)
    boxes.children[cut] = count
    return boxes, count + 2


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
    boxes, extent = _roots(segments, tips)
    count = m + len(tips)
    per_level = 2.0 * width * UNIT_ROUNDOFF * extent  # of a halving
    heap = [(0.0, 0, 0)]
    heap.pop()
    lower, upper, first, second, settled = np.inf, np.inf, -1.0, -1.0, True
    for a in range(count):
        for b in range(a, m) if a < m else range(m):
            if not _is_wanted(kind, a, b, m, strand, tip_segment):
                continue
            p, q = boxes.spheres[a], boxes.spheres[b]
            apart = np.sqrt(np.sum((p[:3] - q[:3]) ** 2)) - p[3] - q[3] - 64.0 * UNIT_ROUNDOFF * extent
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
        error = (max(boxes.data[a, 3], boxes.data[b, 3]) + 1.0) * per_level
        if _holds_none(boxes, a, b, kind, following, tip_segment, tip_side, m, error):
            continue
        if a != b:
            upper, first, second = _pair_inside(segments, boxes, a, b, kind, upper, first, second)
        # split the one with the larger sphere; a box on the diagonal splits both
        cut = a if boxes.spheres[a, 3] > boxes.spheres[b, 3] else b
        if boxes.data[cut, 3] >= DEEPEST:
            lower, settled = min(lower, gap), False
            continue
        boxes, count = _halved(boxes, cut, count)
        c = boxes.children[cut]
        if a == b:
            heapq.heappush(heap, (0.0, c, c))
            heapq.heappush(heap, (0.0, c, c + 1))
            heapq.heappush(heap, (0.0, c + 1, c + 1))
            continue
        for side in range(2):
            x, y = (c + side, b) if cut == a else (a, c + side)
            apart = _hull_gap(boxes.nodes[x], boxes.nodes[y])
            apart -= 2.0 * (max(boxes.data[x, 3], boxes.data[y, 3]) + 1.0) * per_level
            heapq.heappush(heap, (max(max(apart, gap), 0.0), x, y))
    return lower, upper, first, second, settled
