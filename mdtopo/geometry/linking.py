"""How closed polygons wind around each other and around themselves in one frame: linking number and writhe.

Computed from the positions of a single frame, without any motion, so that the crossings found between two frames can
be audited: a signed passage changes the linking number by its sign and the writhe by twice its sign. This module
shares no code with the search for passages. Validation happens in the public functions, which tests and users call
with bare arrays; the kernels trust their input.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.errors import InputError
from mdtopo.geometry.polygons import checked_polygon, unit_scale
from mdtopo.geometry.vectors import Vector, cross, dot, norm, row, subtract
from mdtopo.typing import Points

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
    value, _, _ = _gauss_integral(checked_polygon(p, "p", 3), checked_polygon(q, "q", 3))
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
    first, second = checked_polygon(p, "p", 3), checked_polygon(q, "q", 3)
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
    vertices = checked_polygon(p, "p", 3 if closed else 2)
    return float(_own_angle(vertices * unit_scale(vertices), closed) / (2.0 * np.pi))


def _gauss_integral(p: Points, q: Points) -> tuple[float, int, int]:
    """Return the linking integral and a pair of edges, one of p and one of q, that touch: -1, -1 if none does."""
    unit = unit_scale(np.concatenate([p, q]))
    angle, i, j = _linked_angle(p * unit, q * unit)
    return float(angle / (4.0 * np.pi)), int(i), int(j)


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
