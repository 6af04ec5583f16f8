"""What follows from the measures of a step: its verdict and why, what a certificate is about, and its margins."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.vectors import quotient
from mdtopo.records import Reason, Scope, Verdict
from mdtopo.steprows import OPEN, StepRow, StepRows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

UNRESOLVED, CERTIFIED, CROSSING = int(Verdict.UNRESOLVED), int(Verdict.CERTIFIED), int(Verdict.CROSSING)
NONE, LADDER, BAD_DATA = int(Reason.NONE), int(Reason.LADDER), int(Reason.BAD_DATA)
CELL, IMAGE_JUMP = int(Reason.CELL), int(Reason.IMAGE_JUMP)
STORED, MOTION = int(Scope.STORED), int(Scope.MOTION)


@njit(cache=True, nogil=True)
def conclude_steps(
    rows: StepRows,
    bad: BoolArray,
    times: FloatArray,
    errors: FloatArray,
    ratios: FloatArray,
    limits: FloatArray,
    edges: IntArray,
) -> bool:
    """Write into the row of each step what follows from it; return whether any edge is beyond its stretch limit.

    Parameters
    ----------
    rows : StepRows
        What was measured. Exact arithmetic has written `n_crossings`, and into `reason` why it left pairs open.
    bad : ndarray of bool, shape (n_steps,)
        Whether a step holds an unusable frame.
    times : ndarray, shape (n_steps + 1,)
        Of the frames, ps.
    errors : ndarray, shape (n_steps,)
        How far each of two points may be from where the file, or the rotation, has put it, Å.
    ratios : ndarray, shape (n_steps, n_edges)
        Length of each edge over its reference length; NaN where it is broken, or the reference is unknown.
    limits : ndarray, shape (n_edges,)
        The ratio from which on an edge counts as stretched.
    edges : ndarray of int, shape (n_edges, 2)
    """
    any_beyond = False
    for k in range(len(rows)):
        conclude_step(rows[k], bad[k], times[k + 1] - times[k], errors[k])
        write_greatest_stretch(ratios[k], edges, rows[k])
        for e in range(len(edges)):
            any_beyond |= ratios[k, e] >= limits[e]
    return any_beyond


@njit(cache=True, nogil=True)
def conclude_step(row: StepRow, bad: bool, duration: float, error: float) -> None:
    """Write margins, verdict, scope and reason of one step; see `conclude_steps`."""
    displacement, is_measured = row["displacement_max"], not math.isnan(row["displacement_max"])
    if not is_measured:
        row["rotation_angle"] = np.nan
    elif not row["is_turned"]:
        row["rotation_angle"] = 0.0
    row["nu_ratio"] = quotient(2.0 * displacement, row["nu"])
    row["nu_margin"] = 0.5 * row["nu"] - displacement
    row["certifiable_interval"] = quotient(duration, row["pair_ratio"])
    write_least_clearance(row)
    if row["n_crossings"] > 0:
        row["verdict"] = CROSSING
    elif is_measured and row["rung"] != OPEN:
        row["verdict"], row["scope"] = CERTIFIED, scope_of(row["clearance"], error)
    row["reason"] = reason_of(row, bad)


@njit(cache=True, nogil=True)
def write_least_clearance(row: StepRow) -> None:
    """Write the least of the three clearances and its pair, the first of equals; a class without a pair has none."""
    least, pair = np.inf, row["clearance_local_pair"]
    if row["clearance_local"] < least:
        least = row["clearance_local"]
    if row["clearance_self"] < least:
        least, pair = row["clearance_self"], row["clearance_self_pair"]
    if row["clearance_inter"] < least:
        least, pair = row["clearance_inter"], row["clearance_inter_pair"]
    row["clearance_pair"][:, :] = pair
    if least < np.inf:
        row["clearance"] = least


@njit(cache=True, nogil=True)
def scope_of(clearance: float, error: float) -> int:
    """Return what a certificate is about.

    Guarantee
    ---------
    Proven: each of two points is off by `error` at most; so a clearance above twice that leaves room for what the file
    rounded away. Without a pair there is nothing to hit.
    """
    return MOTION if math.isnan(clearance) or clearance > 2.0 * error else STORED


@njit(cache=True, nogil=True)
def reason_of(row: StepRow, bad: bool) -> int:
    """Return why a step is UNRESOLVED; `reason` still is what exact arithmetic has to say of its open pairs."""
    if bad:
        return BAD_DATA
    if row["jumping_edge"] >= 0:
        return IMAGE_JUMP
    if not row["cell_ok"]:
        return CELL
    if row["verdict"] != UNRESOLVED:
        return NONE
    return LADDER if row["reason"] == NONE else row["reason"]


@njit(cache=True, nogil=True)
def write_greatest_stretch(ratios: FloatArray, edges: IntArray, row: StepRow) -> None:
    """Write the greatest ratio to a reference length, and its edge, the first of equals."""
    greatest, worst = -1.0, 0
    for e in range(len(edges)):
        if ratios[e] > greatest:
            greatest, worst = ratios[e], e
    if 0.0 <= greatest < np.inf:
        row["bond_stretch"], row["bond_stretch_edge"][:] = greatest, edges[worst]
