"""How far must the search of a step look? A few of its pairs tell, where strands are dense.

Before anything is known of a step, its search looks as far as ν, or the least clearance, may be. Among dense strands
most of what it would list there is a little further away than what counts in the end.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.extremes import NU0, NU1, RATIO, Extremes, copy_extremes
from mdtopo.geometry.pairlanes import Workbench
from mdtopo.reach import (
    Search,
    begun_search,
    closer_pads,
    found_pairs,
    narrower_search,
    search_pads,
    some_pairs,
)
from mdtopo.rungs import climb_pairs
from mdtopo.spheres import Spheres

IntArray = NDArray[np.int64]
PairArray = NDArray[np.signedinteger[Any]]

BUNDLES, MEETINGS = 16, 64
"""Bundles, and pairs of bundles, of which the edges are looked at: strands meet themselves along, and others across."""

MET, CROWDED = 8.0, 2.0
"""Bundles that each one meets, and pairs of edges that the search would list across them for each edge: from so many on
it pays to measure a few."""


@njit(cache=True, nogil=True)
def pairs_that_count(
    reach: float,
    motion: StepMotion,
    periodic: bool,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    spheres: Spheres,
    slack: float,
    placing: float,
    first_reach: float,
    bench: Workbench,
    local: Extremes,
    has_self: bool,
    has_inter: bool,
) -> tuple[PairArray, IntArray, bool]:
    """Return the pairs of edges within reach that may change an extreme of a step, their images, and if all were found.

    Parameters
    ----------
    reach : float
        How far to look for clearances and ν, Å.
    local : Extremes
        What the local pairs come to.
    has_self, has_inter : bool
        Whether pairs of these classes exist at all.

    The others are those of `mdtopo.rungs.climb_pairs` and `mdtopo.reach.pairs_in_reach`.
    """
    pads = search_pads(spheres, reach, local.values[RATIO], slack)
    search = begun_search(motion, periodic, edges, trace, spheres, pads)
    lists = search, reach, motion, edges, following, trace
    closer, ratio = closer_reach(*lists, slack, placing, first_reach, bench, local, has_self, has_inter)
    if closer < reach:
        pads = closer_pads(spheres, closer, reach, local.values[RATIO], ratio, slack)
        search = narrower_search(search, motion, edges, pads)
    return found_pairs(search, motion, periodic, edges, trace, spheres, pads)


@njit(cache=True, nogil=True)
def closer_reach(
    search: Search,
    reach: float,
    motion: StepMotion,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    slack: float,
    placing: float,
    first_reach: float,
    bench: Workbench,
    local: Extremes,
    has_self: bool,
    has_inter: bool,
) -> tuple[float, float]:
    """Return how far the search of a step has to look, Å, and the greatest ratio so far; see `closer_pads`.

    Guarantee
    ---------
    Proven: a pair of edges that stays further apart, and has a smaller ratio, changes none of the step's extremes (see
    `mdtopo.rungs`). These are bounded by what a few pairs come to, as they are the least, or the greatest, of all. What
    these few are depends on what the search has begun with; what the step's extremes are does not. Where the cell
    moves, nothing is gained: how images drift counts too.
    """
    ratio = local.values[RATIO]
    if not search.is_bundled or len(search.meetings.near) < MET * len(search.starts) or not is_still(motion):
        return reach, ratio
    pairs, images, n_across = some_pairs(search, motion, trace, BUNDLES, MEETINGS)
    if n_across < CROWDED * len(edges):
        return reach, ratio
    best, is_open = copy_extremes(local), np.zeros(len(pairs), dtype=np.bool_)
    climb_pairs(
        pairs, images, False, motion, edges, following, trace, slack, placing, first_reach, bench, best, is_open
    )
    values, least = best.values, best.least
    closer = max(values[NU0], values[NU1])
    closer = max(closer, max(least[1] if has_self else 0.0, least[2] if has_inter else 0.0))
    return min(reach, closer), values[RATIO]


@njit(cache=True, nogil=True)
def is_still(motion: StepMotion) -> bool:
    """Return whether the cell is the same at both ends, or there is none."""
    for k in range(3):
        for axis in range(3):
            if motion.cell0[k, axis] != motion.cell1[k, axis]:
                return False
    return True
