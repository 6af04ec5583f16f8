"""Rung 6: split the step until every piece is short against the distance that the edges keep in it."""

import numpy as np
from numba import njit

from mdtopo.geometry.distances import UNIT_ROUNDOFF, closest_points, dual_bound
from mdtopo.geometry.passage import MovingPair, differences_at
from mdtopo.geometry.vectors import add

DEEPEST = 48
"""Halvings of [0, 1]: beyond, time itself has no digits left."""

MOST_LOOKS = 400
"""Times at which the distance may be measured. A clear gap takes a handful, a narrow one a few for each halving."""

SHARP = 0.5
"""A piece is split further while it proves less than this share of the distances at its ends …"""

SHARP_DEPTH = 5
"""… and is longer than 1/32 of the step; after that any clearance will do."""


@njit(cache=True, nogil=True)
def distance_bound(pair: MovingPair, t: float) -> float:
    """Return a lower bound of the distance of two moving edges at a time, Å.

    Guarantee
    ---------
    Proven: the four differences of end points are sums of at most three of u, v, w, each with its error.
    """
    u, v, w = differences_at(pair, t)
    a, d = (0.0, 0.0, 0.0), add(w, v)
    _, _, n = closest_points(a, u, w, d)
    return dual_bound(n, a, u, w, d) - 3.0 * pair.error - 32.0 * UNIT_ROUNDOFF * max(pair.u, max(pair.v, pair.w))


@njit(cache=True, nogil=True)
def bisected_clearance(pair: MovingPair, rho: float, enough: float) -> float:
    """Return a clearance that pieces of the step prove one by one, Å; 0 where they do not.

    Parameters
    ----------
    pair : MovingPair
        The two edges.
    rho : float
        Greatest relative motion of their end points, an upper bound, Å.
    enough : float
        A piece that proves more than this is not split to prove yet more, Å.

    Guarantee
    ---------
    Proven: within a piece of length h the distance is at least half of (d0 + d1 - h·ρ), as on rung 3.
    """
    pieces = np.empty((DEEPEST + 2, 3))  # those that wait: where each ends, how far apart the edges are then, its depth
    t, here, waiting = 0.0, distance_bound(pair, 0.0), 1
    pieces[0, 0], pieces[0, 1], pieces[0, 2] = 1.0, distance_bound(pair, 1.0), 0.0
    least = np.inf
    for _ in range(MOST_LOOKS):
        if waiting == 0:
            return least
        end, there, depth = pieces[waiting - 1, 0], pieces[waiting - 1, 1], pieces[waiting - 1, 2]
        if not (here > 0.0 and there > 0.0):
            return 0.0
        clearance = 0.5 * (here + there - (end - t) * rho * (1.0 + 8.0 * UNIT_ROUNDOFF))
        is_sharp = clearance > SHARP * min(here, there) or depth >= SHARP_DEPTH or clearance > enough
        if clearance > 0.0 and is_sharp:
            least = min(least, clearance)
            t, here, waiting = end, there, waiting - 1
            continue
        if depth == DEEPEST:
            return 0.0
        pieces[waiting - 1, 2] = depth + 1.0
        middle = 0.5 * (t + end)
        pieces[waiting, 0], pieces[waiting, 1], pieces[waiting, 2] = middle, distance_bound(pair, middle), depth + 1.0
        waiting += 1
    return 0.0
