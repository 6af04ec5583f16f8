"""The distance of two edges, and what of it is proved.

A closest-point computation yields an upper bound of the distance: any pair of points does. A certificate needs the
other side, and takes it from the direction that the closest points give: for any w, every difference v of a point of
one edge and a point of the other satisfies |v| ≥ w·v/|w|, and w·v is least at a pair of end points.
"""

import numpy as np
from numba import njit

from mdtopo.geometry.vectors import Vector, add, dot, norm, quotient, scale, subtract

UNIT_ROUNDOFF = 2.0**-53

DUAL_ERROR = 16.0 * UNIT_ROUNDOFF
"""Rounding of min w·v/|w|, as a multiple of max|v|.

Each difference v is rounded once per component (u·|v|). Then |fl(w·v) - w·v| ≤ 3u·|w||v|, |w| carries 2u and the
quotient 1u: together less than 8u·|v|. Sixteen leaves a factor of two.
"""

LEAST_SQUARE = 1e-280
"""Squared lengths below this have lost digits to underflow, or soon would; nothing is concluded from them."""


@njit(cache=True, nogil=True)
def clamp(value: float) -> float:
    """Return the value moved into [0, 1]."""
    return min(max(value, 0.0), 1.0)


@njit(cache=True, nogil=True, forceinline=True)
def closest_points(p0: Vector, p1: Vector, q0: Vector, q1: Vector) -> tuple[float, float, Vector]:
    """Return where the edges (p0, p1) and (q0, q1) are closest.

    Parameters
    ----------
    p0, p1, q0, q1 : tuple of 3 floats
        Ends of the two edges, Å. An edge may have length 0.

    Returns
    -------
    s, t : float
        Parameters in [0, 1] on the first and second edge.
    w : tuple of 3 floats
        From the point on the second edge to the point on the first; its length is an *upper* bound of the distance,
        exact up to rounding except for nearly parallel edges.

    Notes
    -----
    Ericson, Real-Time Collision Detection (2005), 5.1.9: minimise over the infinite lines, clamp s, minimise over t,
    clamp t, minimise over s again.
    """
    d, e, r = subtract(p1, p0), subtract(q1, q0), subtract(p0, q0)
    dd, ee, de = dot(d, d), dot(e, e), dot(d, e)
    dr, er = dot(d, r), dot(e, r)
    determinant = dd * ee - de * de
    # below that the lines are parallel in rounding: any s will do
    s = clamp(quotient(de * er - dr * ee, determinant)) if determinant > 1e-14 * dd * ee else 0.0
    t = clamp(quotient(de * s + er, ee)) if ee > 0.0 else 0.0
    s = clamp(quotient(de * t - dr, dd)) if dd > 0.0 else s
    w = subtract(add(r, scale(s, d)), scale(t, e))
    return s, t, w


@njit(cache=True, nogil=True, forceinline=True)
def dual_bound(w: Vector, p0: Vector, p1: Vector, q0: Vector, q1: Vector) -> float:
    """Return a lower bound of the distance of the edges (p0, p1) and (q0, q1), from the direction w.

    Guarantee
    ---------
    Proven, rounding included: no two points of the edges are closer, whatever w is. A bad w costs sharpness (the bound
    may be negative), never truth.
    """
    a, b = subtract(p0, q0), subtract(p0, q1)
    c, d = subtract(p1, q0), subtract(p1, q1)
    squared = dot(w, w)
    least = min(min(dot(w, a), dot(w, b)), min(dot(w, c), dot(w, d)))
    greatest = max(max(dot(a, a), dot(b, b)), max(dot(c, c), dot(d, d)))
    return quotient(least, np.sqrt(squared)) - DUAL_ERROR * np.sqrt(greatest) if squared > LEAST_SQUARE else 0.0


@njit(cache=True, nogil=True)
def edge_distance(p0: Vector, p1: Vector, q0: Vector, q1: Vector) -> float:
    """Return the distance of the edges (p0, p1) and (q0, q1), Å; conservative in neither direction."""
    _, _, w = closest_points(p0, p1, q0, q1)
    return norm(w)
