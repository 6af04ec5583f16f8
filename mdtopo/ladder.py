"""The rungs of the certificate ladder over all pairs of edges of one step.

Two moving edges (a, b) and (c, d) stay apart as long as the origin stays outside the convex hull of
V(t) = {a-c, a-d, b-c, b-d}, each of which moves linearly. With d0, d1 the edges' distances at the two ends, and ρ the
greatest motion of a member of V:

====  ================  ==============================================================  =======================
rung  name              settles the pair when                                           clearance
====  ================  ==============================================================  =======================
0     ball              every vertex moves less than ν0/2 (the paper)                   ν0 - 2m
1     two-frame ball    every vertex moves less than (ν0 + ν1)/2                        (ν0 + ν1)/2 - m
2     broad phase       the swept boxes of the edges, or the slabs across the line      the slabs' gap
                        of their centres, are apart
3     relative motion   ρ < d0 + d1                                                     (d0 + d1 - ρ)/2
4     direction         one w in {n0, n1, n0 + n1} has w·v > 0 for all v at both ends   min w·v/|w|
5     hull              the origin is outside conv(V0 ∪ V1)                             d*(V0 ∪ V1)
6     bisection         rung 3 holds in each piece of the step                          least over the pieces
7     exact             the edges pass through each other, or provably never meet       0
====  ================  ==============================================================  =======================

Guarantee: a clearance is a proven lower bound of the pair's distance at every time of the step, rounding included. What
no rung settles stays OPEN here, and goes to exact arithmetic (`mdtopo.passages`).

The numbers of a step (ν, greatest ratio, least clearance of each class) are exact minima and maxima over the pairs in
reach. A pair is measured in full only if a cheap bound does not already show that it cannot change any of them.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.contacts import Found, both_found, decide_open
from mdtopo.curves import StepMotion
from mdtopo.extremes import N_RUNGS, NU0, NU0_PROVEN, NU1, NU1_PROVEN, RATIO, Extremes, copy_extremes, fresh_extremes
from mdtopo.geometry.distances import UNIT_ROUNDOFF
from mdtopo.geometry.pairlanes import fresh_workbench
from mdtopo.localpairs import near_local_pairs
from mdtopo.reach import has_pairs
from mdtopo.records import Rung
from mdtopo.rungs import climb_pairs, meet_end_terms
from mdtopo.sampling import pairs_that_count
from mdtopo.spheres import (
    LEAST_SLACK,
    PLACING_ERROR,
    greatest_coordinate,
    greatest_displacement,
    mean_edge_length,
    spheres_of,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BALL, TWO_FRAME_BALL, BROAD_PHASE = int(Rung.BALL), int(Rung.TWO_FRAME_BALL), int(Rung.BROAD_PHASE)
OPEN = int(Rung.OPEN)

WIDEST_REACH = 4.0
"""The search for a class without any pair in reach stops at this multiple of the mean edge length."""

FIRST_REACH = 1.4
"""The first search looks this much further than the least distance of local pairs, which bounds ν from above."""

SPARE_REACH = 1.1
"""And this much further than the step before had to look, which spares most steps a second search."""


class StepMeasure(NamedTuple):
    """What the ladder finds in one step.

    Attributes
    ----------
    nu, nu_end : float
        ν at the start and the end, Å.
    nu_witness : ndarray of int, shape (4,)
        The closest pair at the start, as vertices a, b, c, d.
    nu_class : int
        Its class.
    displacement, displacement_vertex : float, int
        Greatest displacement of a vertex, and that vertex.
    ratio : float
        Greatest ρ/(d0 + d1) of a pair.
    ratio_witness : ndarray of int, shape (4,)
    clearances : ndarray, shape (3,)
        Local, self, inter; NaN where no such pair exists at all. Never above `reach` for self and inter.
    clearance_witness : ndarray of int, shape (3, 4)
        -1 where no pair lies within reach.
    rung_pairs : ndarray of int, shape (9,)
        Pairs that the broad phase left, by the rung that settles them; the last entry counts open ones.
    rung : int
        The costliest rung needed; OPEN if a pair stayed open.
    needed_reach : float
        How far the search had to go, Å.
    countable : bool
        False where too many periodic images might be met, so that the search was given up; the rung is then OPEN.
    found : Found
        Passages, and pairs that are left to exact arithmetic.
    """

    nu: float
    nu_end: float
    nu_witness: IntArray
    nu_class: int
    displacement: float
    displacement_vertex: int
    ratio: float
    ratio_witness: IntArray
    clearances: FloatArray
    clearance_witness: IntArray
    rung_pairs: IntArray
    rung: int
    needed_reach: float
    countable: bool
    found: Found


@njit(cache=True, nogil=True)
def measure_step(
    motion: StepMotion,
    periodic: bool,
    edges: IntArray,
    following: IntArray,
    trace: IntArray,
    local_pairs: IntArray,
    end_terms: IntArray,
    likely_reach: float,
) -> StepMeasure:
    """Return margins, ratios, clearances and rungs of one step.

    Parameters
    ----------
    motion : StepMotion
        From `mdtopo.curves.step_motion`; it must be usable.
    periodic : bool
        Whether there are images.
    edges, following, trace, local_pairs, end_terms : ndarray of int
        See `mdtopo.records.Traces`.
    likely_reach : float
        How far the search had to go in a step like this one, Å; a good guess saves time and changes nothing else.

    Guarantee
    ---------
    Proven: if the rung is not OPEN and no passage is found, no two edges that do not share a vertex meet at any time of
    the step, in any image; and each passage that is found is one.
    """
    displacement, vertex = greatest_displacement(motion.x0, motion.x1)
    slack = PLACING_ERROR * (greatest_coordinate(motion) + motion.placing) + LEAST_SLACK
    placing = slack if periodic else 0.0  # without a cell, coordinates are as stored, and exact
    spheres, bench = spheres_of(motion, edges), fresh_workbench()
    local, no_images = fresh_extremes(), np.empty((0, 3), dtype=np.int64)
    near = near_local_pairs(local_pairs, motion, edges, following, trace, slack, placing, bench)
    near_open = np.zeros(len(near), dtype=np.bool_)
    climb_pairs(near, no_images, True, motion, edges, following, trace, slack, placing, 0.0, bench, local, near_open)
    local_found = decide_open(near, no_images, near_open, True, motion, edges, trace, placing, local)
    found = local_found
    meet_end_terms(motion, end_terms, placing, local)
    has_self, has_inter = has_pairs(trace, following, periodic)
    edge_length = mean_edge_length(spheres)
    widest = WIDEST_REACH * edge_length
    drift, best = 0.0, local
    first_reach = min(FIRST_REACH * local.values[NU0], edge_length)
    reach = max(first_reach, min(SPARE_REACH * likely_reach, widest))
    wanted, countable = 0.0, True
    while len(edges) > 0:
        pairs, images, countable = pairs_that_count(
            reach,
            motion,
            periodic,
            edges,
            following,
            trace,
            spheres,
            slack,
            placing,
            first_reach,
            bench,
            local,
            has_self,
            has_inter,
        )
        if not countable:
            break
        best = copy_extremes(local)
        is_open = np.zeros(len(pairs), dtype=np.bool_)
        drift = climb_pairs(
            pairs,
            images,
            False,
            motion,
            edges,
            following,
            trace,
            slack,
            placing,
            first_reach,
            bench,
            best,
            is_open,
        )
        others = decide_open(pairs, images, is_open, False, motion, edges, trace, placing, best)
        found = both_found(local_found, others)
        wanted = max(best.least[1] if has_self else 0.0, best.least[2] if has_inter else 0.0)
        if wanted <= reach or reach >= widest:
            break
        reach = min(min(wanted, 2.0 * reach + 0.1 * edge_length), widest)
    needed = min(wanted, reach)
    cap = first_reach if periodic else np.inf
    return conclude(
        best, displacement, vertex, drift, cap, placing, reach, needed, countable, has_self, has_inter, found
    )


@njit(cache=True, nogil=True)
def conclude(
    best: Extremes,
    displacement: float,
    vertex: int,
    drift: float,
    cap: float,
    placing: float,
    reach: float,
    needed: float,
    countable: bool,
    has_self: bool,
    has_inter: bool,
    found: Found,
) -> StepMeasure:
    """Return the step's measure: the ball rungs, the rung of the step, and clearances capped at what was searched.

    What the balls prove holds of images up to `cap`: those beyond it may drift more than `drift`, and stay beyond it.
    """
    counts = best.rung_pairs.copy()
    clearances, witness = best.least.copy(), best.witness.copy()
    moved = displacement * (1.0 + 8.0 * UNIT_ROUNDOFF) + placing
    drift *= 1.0 + 8.0 * UNIT_ROUNDOFF
    ball = min(best.values[NU0_PROVEN] - 2.0 * moved - drift, cap)
    two_frame_ball = min(0.5 * (best.values[NU0_PROVEN] + best.values[NU1_PROVEN] - 2.0 * moved - drift), cap)
    rung = BROAD_PHASE
    for k in range(BROAD_PHASE, N_RUNGS):
        if counts[k] > 0:
            rung = k
    if max(ball, two_frame_ball) > 0.0:
        rung = BALL if ball > 0.0 else TWO_FRAME_BALL
        for kind in range(3):
            clearances[kind] = max(clearances[kind], max(ball, two_frame_ball))
    if not countable:
        rung = OPEN
        clearances[:] = 0.0
    for kind in range(1, 3):
        clearances[kind] = min(clearances[kind], reach)
        if best.least[kind] > reach:  # whether the search met a pair out there is chance
            witness[kind] = -1
    if not has_self:
        clearances[1] = np.nan
    if not has_inter:
        clearances[2] = np.nan
    if clearances[0] == np.inf:
        clearances[0] = np.nan
    return StepMeasure(
        best.values[NU0],
        best.values[NU1],
        best.nu_witness,
        best.nu_class[0],
        displacement,
        vertex,
        max(best.values[RATIO], 0.0),
        best.ratio_witness,
        clearances,
        witness,
        counts,
        rung,
        needed,
        countable,
        found,
    )
