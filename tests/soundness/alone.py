"""What each pair of edges comes to by itself: what a search, and a batch, are held against."""

import numpy as np
from numba import njit
from numpy.typing import NDArray
from soundness.families import Points

from mdtopo.curves import StepMotion
from mdtopo.extremes import fresh_extremes
from mdtopo.geometry.pairlanes import fresh_workbench
from mdtopo.rungs import climb_pairs

Whole = NDArray[np.int64]
Flags = NDArray[np.bool_]
NO_IMAGES = np.empty((0, 3), dtype=np.int64)


@njit
def climbed(
    pairs: Whole,
    images: Whole,
    motion: StepMotion,
    edges: Whole,
    following: Whole,
    trace: Whole,
    slack: float,
    placing: float,
    first_reach: float,
) -> tuple[Points, Flags, Whole]:
    """Return ν0, ν1, ratio and clearance by each pair alone, so that none is passed over for what another one said.

    And which pairs stay open, and how many each rung settles.
    """
    table, is_open, rungs = np.empty((len(pairs), 4)), np.zeros(len(pairs), np.bool_), np.zeros(9, np.int64)
    bench = fresh_workbench()
    for k in range(len(pairs)):
        best = fresh_extremes()
        climb_pairs(
            pairs[k : k + 1],
            images[k : k + 1],
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
            is_open[k : k + 1],
        )
        table[k, 0], table[k, 1], table[k, 2] = best.values[0], best.values[1], best.values[4]
        table[k, 3] = min(best.least[1], best.least[2])
        rungs += best.rung_pairs
    return table, is_open, rungs
