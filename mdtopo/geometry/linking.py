"""Which topology closed polygons have in one frame: linking number, writhe, knot determinant.

Computed from the positions of a single frame, without any motion, so that the crossings found between two frames can
be audited: a signed passage changes the linking number by its sign and the writhe by twice its sign. This module
shares no code with the search for passages. Validation happens in the public functions, which tests and users call
with bare arrays; the kernels trust their input.
"""

from math import isqrt, prod

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.errors import AuditError, InputError
from mdtopo.geometry.vectors import Vector, cross, dot, norm, row, subtract
from mdtopo.typing import Flags, Indices, Points

INTEGER_TOLERANCE = 1e-3
"""How far the Gauss integral of two closed polygons may be from an integer. Rounding makes some 1e-10 of 10^7 pairs of
edges, and at most this of one pair that all but touches."""

FLAT = 1e-12
"""A pair of edges counts as coplanar where its determinant is below this fraction of the lengths it is compared with.

The denominators of the solid angle are wrong by some 10u ≈ 1e-15 of those lengths, so a determinant above this limit
has its angle right to 1e-3 even where the edges all but touch. A pair below it loses an angle of that size, or touches.
"""

TOUCHING = 1e-9
"""Edges in one plane touch where a denominator of the solid angle falls below this fraction of its lengths: it is
positive where the triangle leaves out the origin, 0 on the triangle's rim, negative inside."""

DETERMINANT_ERROR = 2.0**-49
"""Rounding of det(e, f, r) as a multiple of |e||f||r|: each factor carries u, the products less than 10u; u = 2^-53."""

POSITION_ERROR = 1e-14
"""Error of a turned coordinate as a multiple of the polygon's extent: one difference and three products, below 16u."""

N_DIRECTIONS = 24
"""Projections tried. A direction fails by chance with a probability near n²·1e-12, so only contacts exhaust them."""

LARGEST_PRIME = 2**31 - 1
"""Residues below 2^31 have products below 2^62, which int64 holds."""


def boxes_apart(p: Points, q: Points) -> bool:
    """Return whether the bounding boxes of two sets of points are disjoint; exact.

    Parameters
    ----------
    p, q : ndarray, shape (n, 3) and (m, 3)
        Positions, Å.
    """
    return bool(np.any(p.min(axis=0) > q.max(axis=0)) or np.any(q.min(axis=0) > p.max(axis=0)))


def gauss_linking(p: Points, q: Points) -> float:
    """Return the Gauss linking integral of two closed polygons.

    Lk = (1/4π) ∮∮ (dr₁ × dr₂)·(r₁ - r₂) / |r₁ - r₂|³ with r₁ on p and r₂ on q, as the sum over all pairs of edges of
    the solid angle of the parallelogram of their differences. It rises by 1 where an edge (a, b) of p passes through
    an edge (c, d) of q and det(a - c, b - a, d - c) rises through zero.

    Parameters
    ----------
    p, q : ndarray, shape (n, 3) and (m, 3)
        Vertices in order, Å; the last is joined to the first.

    Returns
    -------
    float
        An integer but for rounding where the polygons do not touch. Edges that meet inside contribute the mean of
        both sides, which puts the sum half-way between two integers.

    Raises
    ------
    InputError
        An array has the wrong shape, too few vertices or values that are not finite.

    Notes
    -----
    Banchoff, Indiana Univ. Math. J. 25 (1976) 1171; the solid angle of a triangle: van Oosterom and Strackee, IEEE
    Trans. Biomed. Eng. 30 (1983) 125. The time is O(nm).
    """
    value, _, _ = _gauss_integral(_polygon(p, "p", 3), _polygon(q, "q", 3))
    return value


def linking_number(p: Points, q: Points) -> int:
    """Return the linking number of two closed polygons; see `gauss_linking` for its sign.

    Parameters
    ----------
    p, q : ndarray, shape (n, 3) and (m, 3)
        Vertices in order, Å; the last is joined to the first.

    Guarantee
    ---------
    Conservative: where two edges touch, or come so close (some 1e-12 of their lengths) that rounding hides on which
    side they lie, it raises; otherwise rounding cannot reach another integer.

    Raises
    ------
    InputError
        The polygons touch, so that they have no linking number, or an array cannot be used.

    Examples
    --------
    A square around the z axis and one in the xz plane, through its middle and around its side:

    >>> import numpy as np
    >>> p = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    >>> q = np.array([[0.0, 0, 1], [0, 0, -1], [3, 0, -1], [3, 0, 1]])
    >>> linking_number(p, q), linking_number(p, q[::-1])
    (-1, 1)
    """
    first, second = _polygon(p, "p", 3), _polygon(q, "q", 3)
    if boxes_apart(first, second):
        return 0
    value, i, j = _gauss_integral(first, second)
    if i >= 0:
        raise InputError(
            f"Edge {i} of p and edge {j} of q touch, to rounding; polygons that touch have no linking number. Use a "
            "frame in which they are apart."
        )
    if not abs(value - round(value)) <= INTEGER_TOLERANCE:
        raise InputError(
            f"The Gauss linking integral of p and q is {value:.6g}; two closed polygons have an integer. "
            "Check that they do not touch or come within rounding of each other."
        )
    return round(value)


def writhe(p: Points, closed: bool = True) -> float:
    """Return the writhe of a polygon, its Gauss integral with itself.

    Wr = (1/4π) ∫∫ (dr₁ × dr₂)·(r₁ - r₂) / |r₁ - r₂|³ over all ordered pairs of edges; adjacent edges are coplanar and
    contribute 0. It rises by 2 where one edge passes through another and their determinant, as in `gauss_linking`,
    rises through zero; otherwise it is continuous.

    Parameters
    ----------
    p : ndarray, shape (n, 3)
        Vertices in order, Å.
    closed : bool
        Whether the last vertex is joined to the first.

    Returns
    -------
    float
        0 for a planar polygon; of opposite sign for the mirror image; the same for the reversed polygon. Right to
        some 1e-12 times the number of pairs that are close to each other; edges that touch count as the mean of both
        sides.

    Raises
    ------
    InputError
        The array has the wrong shape, too few vertices or values that are not finite.

    Notes
    -----
    Klenin and Langowski, Biopolymers 54 (2000) 307, method 1a. The time is O(n²).
    """
    vertices = _polygon(p, "p", 3 if closed else 2)
    return float(_own_angle(vertices * _unit(vertices), closed) / (2.0 * np.pi))


def knot_determinant(p: Points, most_crossings: int | None = None) -> int:
    """Return the knot determinant |Δ(-1)| of a closed polygon: 1 for the unknot, 3 for the trefoil, 5 for 4₁.

    The polygon is projected along a fixed sequence of directions until one gives a diagram in which every crossing,
    what lies over what, and the order along each edge are beyond rounding. Reidemeister moves that remove one or two
    crossings are applied where the Gauss code shows them. The determinant of the colouring matrix without one row and
    column is computed modulo as many primes as Hadamard's bound asks for.

    Parameters
    ----------
    p : ndarray, shape (n, 3)
        Vertices in order, Å; the last is joined to the first.
    most_crossings : int, optional
        Give up where the diagram keeps more crossings than this: the time grows with their third power at worst.

    Returns
    -------
    int
        Odd and positive. Two polygons with different determinants are different knots; the converse does not hold.

    Guarantee
    ---------
    Proven for the stored coordinates: no decision within rounding is taken, and the determinant is exact.

    Raises
    ------
    InputError
        The polygon touches itself, to rounding, the array cannot be used, or there are too many crossings.
    AuditError
        The determinant came out even, which no knot has: a bug.

    Notes
    -----
    Livingston, Knot Theory (1993), chapter 3. Virtual equivalence (Goussarov, Polyak and Viro, Topology 39 (2000) 1045)
    makes the moves on the Gauss code right without a look at the plane.
    """
    vertices = _polygon(p, "p", 3)
    vertices = vertices[np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)]
    if len(vertices) < 3:
        raise InputError("p has fewer than 3 distinct vertices in a row; such a polygon has no knot type.")
    vertices = (vertices - vertices[0]) * _unit(vertices - vertices[0])
    for k in range(N_DIRECTIONS):
        code = _gauss_code(vertices @ _rotation(k))
        if code is not None:
            n_crossings = len(code[0]) // 2
            if most_crossings is not None and n_crossings > most_crossings:
                raise InputError(
                    f"The diagram of p keeps {n_crossings} crossings, more than most_crossings = {most_crossings}; "
                    "allow more, and time for it."
                )
            value = abs(_exact_determinant(_colouring_minor(*code)))
            if value % 2 == 0:
                raise AuditError(
                    f"The knot determinant of a polygon of {len(p)} vertices came out as {value}, not odd."
                )
            return value
    raise InputError(
        f"p has no clear projection in {N_DIRECTIONS} directions; a polygon that touches itself, to rounding, has no "
        "knot type. Check for vertices that coincide and for edges that meet."
    )


def _polygon(p: Points, name: str, n_least: int) -> Points:
    """Return p as a C-contiguous float64 array, or raise InputError that says what is wrong with it."""
    try:
        vertices = np.ascontiguousarray(p, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is not an array of numbers ({error}); pass the vertices, shape (n, 3).") from error
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < n_least:
        raise InputError(f"{name} has shape {np.shape(p)}; a polygon needs (n, 3) with n ≥ {n_least} vertices.")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise InputError(f"{name} is not finite at vertex {bad[0]}: {vertices[bad[0]]}; remove or repair the frame.")
    return vertices


def _gauss_integral(p: Points, q: Points) -> tuple[float, int, int]:
    """Return the linking integral and a pair of edges, one of p and one of q, that touch: -1, -1 if none does."""
    unit = _unit(np.concatenate([p, q]))
    angle, i, j = _linked_angle(p * unit, q * unit)
    return float(angle / (4.0 * np.pi)), int(i), int(j)


def _unit(vertices: Points) -> float:
    """Return the power of two that brings the extent into [1, 2): it changes no digit and keeps products in range."""
    extent = float(np.max(np.ptp(vertices, axis=0)))
    return float(2.0 ** -np.floor(np.log2(extent))) if extent > 0.0 else 1.0


@njit(cache=True, nogil=True)
def _pair_angle(p0: Vector, p1: Vector, q0: Vector, q1: Vector) -> tuple[float, bool]:
    """Return half the signed solid angle of the differences of two edges, in (-π, π), and whether the edges touch.

    The angle is 0 where they are coplanar.

    The differences form a parallelogram with the corners a, b, c, d. Its two triangles (a, b, c) and (a, c, d) lie on
    one plane and have one determinant, and tan(Ω/2) = det / (|a||b||c| + (a·b)|c| + (b·c)|a| + (c·a)|b|). The half
    angles are added as arguments of complex numbers, which saves an arc tangent; their sum stays below π.
    """
    e, f = subtract(p1, p0), subtract(q1, q0)
    a, b, c, d = subtract(p0, q0), subtract(p1, q0), subtract(p1, q1), subtract(p0, q1)
    la, lb, lc, ld = norm(a), norm(b), norm(c), norm(d)
    r, least = a, la  # the nearest corner has the smallest rounding
    if lb < least:
        r, least = b, lb
    if lc < least:
        r, least = c, lc
    if ld < least:
        r, least = d, ld
    determinant = dot(cross(e, f), r)
    ac = dot(a, c)
    scale1, scale2 = la * lb * lc, la * lc * ld
    under1 = scale1 + dot(a, b) * lc + dot(b, c) * la + ac * lb
    under2 = scale2 + ac * ld + dot(c, d) * la + dot(d, a) * lc
    size = abs(determinant)
    rounding = DETERMINANT_ERROR * (norm(e) * norm(f) * least)
    if not size > max(FLAT * max(scale1, scale2), rounding):
        near = least <= FLAT * max(max(la, lb), max(lc, ld))
        return 0.0, near or under1 <= TOUCHING * scale1 or under2 <= TOUCHING * scale2
    # a sum of half angles near π may come out just beyond it: its sine is not negative
    angle = np.arctan2(abs(size * (under1 + under2)), under1 * under2 - size * size)
    return (angle if determinant > 0.0 else -angle), False


@njit(cache=True, nogil=True)
def _linked_angle(p: NDArray[np.float64], q: NDArray[np.float64]) -> tuple[float, int, int]:
    """Return the solid angle of all pairs of an edge of p and one of q, and the last pair that touches, else -1, -1."""
    total, touching_p, touching_q = 0.0, -1, -1
    for i in range(len(p)):
        p0, p1 = row(p, i), row(p, (i + 1) % len(p))
        part = 0.0  # one sum per edge keeps the rounding that of a short sum
        for j in range(len(q)):
            angle, touches = _pair_angle(p0, p1, row(q, j), row(q, (j + 1) % len(q)))
            part += angle
            if touches:
                touching_p, touching_q = i, j
        total += part
    return 2.0 * total, touching_p, touching_q


@njit(cache=True, nogil=True)
def _own_angle(p: NDArray[np.float64], closed: bool) -> float:
    """Return the solid angle of all unordered pairs of edges that are not adjacent."""
    n = len(p)
    n_edges = n if closed else n - 1
    total = 0.0
    for i in range(n_edges):
        p0, p1 = row(p, i), row(p, (i + 1) % n)
        stop = n_edges - 1 if closed and i == 0 else n_edges
        part = 0.0
        for j in range(i + 2, stop):
            part += _pair_angle(p0, p1, row(p, j), row(p, (j + 1) % n))[0]
        total += part
    return 2.0 * total


def _rotation(k: int) -> Points:
    """Return the k-th of a fixed sequence of generic rotations, from a quaternion of irrational phases."""
    w, x, y, z = np.cos(np.arange(1.0, 5.0) + k * np.sqrt([2.0, 3.0, 5.0, 7.0]))
    matrix = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.array(matrix) / (w * w + x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def _size(e: Vector) -> float:
    """Return the sum of the components' sizes, a cheap upper bound of the length."""
    return abs(e[0]) + abs(e[1]) + abs(e[2])


@njit(cache=True, nogil=True)
def _turn(e: Vector, r: Vector) -> tuple[float, float]:
    """Return the z component of e x r and a bound of its error, for differences of coordinates wrong by η each."""
    error = POSITION_ERROR * (4.0 * (_size(e) + _size(r)) + 16.0 * POSITION_ERROR)
    return e[0] * r[1] - e[1] * r[0], error


@njit(cache=True, nogil=True)
def _meeting(a: Vector, b: Vector, c: Vector, d: Vector) -> tuple[int, float, float, float, float, float]:
    """Return whether and where the edges (a, b) and (c, d) cross seen along z, and what lies over what.

    Returns
    -------
    state : int
        0 they do not cross, 1 they cross, -1 rounding does not say.
    s, t : float
        Parameters of the crossing on the first and the second edge.
    error : float
        Bound of the errors of s and t.
    sign : float
        Sign of det(e, f, a - c), the sign of the crossing.
    height : float
        Sign of the height of the first edge over the second.
    """
    e, f, r = subtract(b, a), subtract(d, c), subtract(a, c)
    none = (0, 0.0, 0.0, 0.0, 0.0, 0.0)
    at_c, error_c = _turn(e, subtract(c, a))
    at_d, error_d = _turn(e, subtract(d, a))
    if (at_c > error_c and at_d > error_d) or (at_c < -error_c and at_d < -error_d):
        return none
    at_a, error_a = _turn(f, r)
    at_b, error_b = _turn(f, subtract(b, c))
    if (at_a > error_a and at_b > error_b) or (at_a < -error_a and at_b < -error_b):
        return none
    determinant = dot(cross(e, f), r)
    rounding = 4.0 * POSITION_ERROR * (_size(e) * _size(f) + _size(f) * _size(r) + _size(r) * _size(e))
    sure = abs(at_c) > error_c and abs(at_d) > error_d and abs(at_a) > error_a and abs(at_b) > error_b
    if not (sure and abs(determinant) > rounding):
        return -1, 0.0, 0.0, 0.0, 0.0, 0.0
    s, t = at_a / (at_a - at_b), at_c / (at_c - at_d)
    error = 2.0 * max((error_a + error_b) / abs(at_a - at_b), (error_c + error_d) / abs(at_c - at_d))
    sign = 1.0 if determinant > 0.0 else -1.0
    # a + s·e - c - t·f = (0, 0, h) gives det(e, f, a - c) = h·(e × f)_z, and (e × f)_z has the sign of at_d
    return 1, s, t, error, sign, sign if at_d > 0.0 else -sign


@njit(cache=True, nogil=True)
def _boxes_meet(a: Vector, b: Vector, c: Vector, d: Vector) -> bool:
    """Return whether the boxes around two edges, seen along z, may overlap."""
    margin = 4.0 * POSITION_ERROR
    for k in range(2):
        if min(a[k], b[k]) > max(c[k], d[k]) + margin or min(c[k], d[k]) > max(a[k], b[k]) + margin:
            return False
    return True


@njit(cache=True, nogil=True)
def _folds(a: Vector, b: Vector, c: Vector) -> bool:
    """Return whether the edge (b, c) may run back over (a, b), seen along z."""
    e, f = subtract(b, a), subtract(c, b)
    turn, error = _turn(e, f)
    return abs(turn) <= error and e[0] * f[0] + e[1] * f[1] <= error


@njit(cache=True, nogil=True)
def _find_crossings(x: NDArray[np.float64], edges: NDArray[np.int64], places: NDArray[np.float64]) -> int:
    """Return the number of crossings of a closed polygon seen along z, or -1 where rounding leaves one open.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Turned positions of extent at most 4; no two in a row are equal.
    edges : ndarray, shape (room, 2)
        Filled with the two edges of each crossing, as far as there is room.
    places : ndarray, shape (room, 5)
        Filled with s, t, their error, the sign and the height, as in `_meeting`.
    """
    n, count = len(x), 0
    for i in range(n):
        a, b = row(x, i), row(x, (i + 1) % n)
        if _folds(a, b, row(x, (i + 2) % n)):
            return -1
        for j in range(i + 2, n - 1 if i == 0 else n):
            c, d = row(x, j), row(x, (j + 1) % n)
            if not _boxes_meet(a, b, c, d):
                continue
            state, s, t, error, sign, height = _meeting(a, b, c, d)
            if state < 0:
                return -1
            if state > 0:
                if count < len(edges):
                    edges[count, 0], edges[count, 1] = i, j
                    places[count, 0], places[count, 1], places[count, 2] = s, t, error
                    places[count, 3], places[count, 4] = sign, height
                count += 1
    return count


def _gauss_code(x: Points) -> tuple[Indices, Flags] | None:
    """Return the crossings in the order in which the polygon runs through them, or None where rounding leaves it open.

    Returns
    -------
    crossing : ndarray, shape (2 k,)
        Number of the crossing at each passage, 0 to k - 1, each twice.
    over : ndarray of bool, shape (2 k,)
        Whether the passage is the upper one.
    """
    room = 4 * len(x)
    while True:
        edges, places = np.empty((room, 2), np.int64), np.empty((room, 5))
        count = _find_crossings(x, edges, places)
        if count <= room:
            break
        room = count
    if count < 0:
        return None
    edges, places = edges[:count], places[:count]
    edge, place = edges.T.ravel(), places[:, :2].T.ravel()  # first the passages on edges i, then those on edges j
    error = np.tile(places[:, 2], 2)
    order = np.lexsort((place, edge))
    same = edge[order][1:] == edge[order][:-1]
    if np.any(same & (np.diff(place[order]) <= error[order][1:] + error[order][:-1])):
        return None
    crossing = np.tile(np.arange(count), 2)[order]
    over = np.concatenate([places[:, 4] > 0.0, places[:, 4] < 0.0])[order]
    kept = _reduce_code(crossing, over, places[:, 3] > 0.0)
    return np.unique(crossing[kept], return_inverse=True)[1].astype(np.int64), over[kept]


@njit(cache=True, nogil=True)
def _reduce_code(crossing: NDArray[np.int64], over: NDArray[np.bool_], positive: NDArray[np.bool_]) -> Flags:
    """Return which passages remain after all moves that remove one or two crossings (Reidemeister I and II).

    I: both passages of a crossing follow each other. II: two crossings of opposite sign follow each other above and
    follow each other, in either order, below.
    """
    n = len(crossing)
    alive = np.ones(n, np.bool_)
    partner, seen = np.empty(n, np.int64), np.full(n, -1)
    after, before = np.empty(n, np.int64), np.empty(n, np.int64)
    for k in range(n):
        after[k], before[k] = (k + 1) % n, (k - 1) % n
        first = seen[crossing[k]]
        if first >= 0:
            partner[k], partner[first] = first, k
        seen[crossing[k]] = k
    n_left, n_idle, k = n, 0, 0
    while n_left > 0 and n_idle <= n_left:
        m = after[k]
        is_loop = partner[k] == m
        is_lens = not is_loop and over[k] == over[m] and positive[crossing[k]] != positive[crossing[m]]
        if is_lens:
            is_lens = after[partner[k]] == partner[m] or after[partner[m]] == partner[k]
        if not (is_loop or is_lens):
            k, n_idle = m, n_idle + 1
            continue
        for gone in (k, m, partner[k], partner[m]):
            if alive[gone]:
                alive[gone] = False
                after[before[gone]], before[after[gone]] = after[gone], before[gone]
                n_left -= 1
        n_idle = 0
        while n_left > 0 and not alive[k]:
            k = before[k]
    return alive


def _colouring_minor(crossing: Indices, over: Flags) -> Indices:
    """Return the colouring matrix without its last row and column.

    An arc runs from one lower passage to the next. The row of a crossing holds 2 for the arc above and -1 for each of
    the two that end below it.
    """
    n = len(crossing) // 2
    if n < 2:
        return np.empty((0, 0), np.int64)
    under = np.logical_not(over)
    arc: Indices = (np.cumsum(under) - under) % n  # the arc that arrives at a passage
    matrix = np.zeros((n, n), np.int64)
    np.add.at(matrix, (crossing[over], arc[over]), 2)
    np.add.at(matrix, (crossing[under], arc[under]), -1)
    np.add.at(matrix, (crossing[under], (arc[under] + 1) % n), -1)
    return matrix[:-1, :-1].copy()


def _exact_determinant(matrix: Indices) -> int:
    """Return the determinant of a sparse integer matrix of small entries, exactly.

    Residues modulo primes below 2^31 are put together by the Chinese remainder theorem until the modulus exceeds twice
    Hadamard's bound Π|row|.
    """
    if len(matrix) == 0:
        return 1
    bound = 2 * (isqrt(prod(int(s) for s in (matrix * matrix).sum(axis=1))) + 1)
    value, modulus, prime = 0, 1, LARGEST_PRIME + 2
    while modulus <= bound:
        prime = _prime_below(prime)
        residue = int(_determinant_modulo(matrix % prime, prime))
        value += modulus * ((residue - value) * pow(modulus, -1, prime) % prime)
        modulus *= prime
    return value if 2 * value < modulus else value - modulus


@njit(cache=True, nogil=True)
def _prime_below(odd: int) -> int:
    """Return the greatest prime below an odd number > 5, by trial division."""
    candidate = odd - 2
    divisor = 3
    while divisor * divisor <= candidate:
        if candidate % divisor == 0:
            candidate, divisor = candidate - 2, 3
        else:
            divisor += 2
    return candidate


@njit(cache=True, nogil=True)
def _inverse_modulo(value: int, prime: int) -> int:
    """Return 1 / value modulo a prime, by Euclid's algorithm."""
    r0, r1, s0, s1 = prime, value, 0, 1
    while r1 != 0:
        quotient = r0 // r1
        r0, r1 = r1, r0 - quotient * r1
        s0, s1 = s1, s0 - quotient * s1
    return s0 % prime


@njit(cache=True, nogil=True)
def _is_odd(order: NDArray[np.int64]) -> bool:
    """Return whether a permutation is odd; it is destroyed."""
    odd = False
    for i in range(len(order)):
        while order[i] != i:
            j = order[i]
            order[i], order[j] = order[j], j
            odd = not odd
    return odd


@njit(cache=True, nogil=True)
def _determinant_modulo(matrix: NDArray[np.int64], prime: int) -> int:
    """Return the determinant modulo a prime below 2^31; the matrix, of residues, is destroyed.

    Each pivot lies in the row with the fewest entries and there in the column with the fewest: a knot diagram is a
    planar graph, and so ordered its elimination stays sparse. The work outside the filled part is O(n²).
    """
    n = len(matrix)
    in_row, in_column = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i in range(n):
        for j in range(n):
            if matrix[i, j] != 0:
                in_row[i] += 1
                in_column[j] += 1
    open_rows = np.ones(n, np.bool_)
    row_order, column_order, columns = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    value = 1
    for step in range(n):
        pivot = -1
        for i in range(n):
            if open_rows[i] and (pivot < 0 or in_row[i] < in_row[pivot]):
                pivot = i
        n_columns, best = 0, -1
        for j in range(n):
            if matrix[pivot, j] != 0:
                columns[n_columns] = j
                n_columns += 1
                if best < 0 or in_column[j] < in_column[best]:
                    best = j
        if best < 0:
            return 0
        row_order[step], column_order[step], open_rows[pivot] = pivot, best, False
        value = value * matrix[pivot, best] % prime
        inverse = _inverse_modulo(matrix[pivot, best], prime)
        for k in range(n_columns):
            in_column[columns[k]] -= 1
        for i in range(n):
            if not open_rows[i] or matrix[i, best] == 0:
                continue
            factor = prime - matrix[i, best] * inverse % prime
            for k in range(n_columns):
                j = columns[k]
                old = matrix[i, j]
                new = (old + factor * matrix[pivot, j]) % prime
                matrix[i, j] = new
                change = (1 if new != 0 else 0) - (1 if old != 0 else 0)
                in_row[i] += change
                in_column[j] += change
    if _is_odd(row_order) != _is_odd(column_order):
        value = (prime - value) % prime
    return value
