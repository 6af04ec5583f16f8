"""What follows from the measures of a step: its verdict and why, what a certificate is about, and its margins."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.blocks import OPEN, Columns
from mdtopo.records import Reason, Scope, Verdict

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
CodeArray = NDArray[np.int8]
BoolArray = NDArray[np.bool_]

UNRESOLVED, CERTIFIED, CROSSING = int(Verdict.UNRESOLVED), int(Verdict.CERTIFIED), int(Verdict.CROSSING)
NONE, LADDER, BAD_DATA = int(Reason.NONE), int(Reason.LADDER), int(Reason.BAD_DATA)
CELL, IMAGE_JUMP = int(Reason.CELL), int(Reason.IMAGE_JUMP)
NOTHING, STORED, MOTION = int(Scope.NONE), int(Scope.STORED), int(Scope.MOTION)


class Outcomes(NamedTuple):
    """Columns that follow from those of the kernel, one row per step; named like those of `StepTable`.

    Exact arithmetic writes `n_crossings`, and into `reason` why it left pairs open, before the rest is concluded.
    """

    rotation_angle: FloatArray
    nu_ratio: FloatArray
    nu_margin: FloatArray
    clearance: FloatArray
    clearance_witness: IntArray
    bond_stretch: FloatArray
    bond_stretch_edge: IntArray
    certifiable_interval: FloatArray
    verdict: CodeArray
    scope: CodeArray
    reason: CodeArray
    n_crossings: IntArray

    @classmethod
    def unknown(cls, n: int) -> "Outcomes":
        """Return rows of n steps, of which nothing is known."""
        return cls._make([column.copy() for column in _unknown(n)])


@lru_cache(maxsize=8)
def _unknown(n: int) -> Outcomes:
    number, index, code = np.full(n, np.nan), np.full((n, 4), -1, dtype=np.int64), np.zeros(n, dtype=np.int8)
    return Outcomes(
        rotation_angle=number,
        nu_ratio=number,
        nu_margin=number,
        clearance=number,
        clearance_witness=index,
        bond_stretch=number,
        bond_stretch_edge=index[:, :2].copy(),
        certifiable_interval=number,
        verdict=code + np.int8(UNRESOLVED),
        scope=code + np.int8(NOTHING),
        reason=code + np.int8(NONE),
        n_crossings=np.zeros(n, dtype=np.int64),
    )


@njit(cache=True, nogil=True)
def conclude_steps(
    columns: Columns,
    bad: BoolArray,
    times: FloatArray,
    errors: FloatArray,
    ratios: FloatArray,
    limits: FloatArray,
    edges: IntArray,
    out: Outcomes,
) -> bool:
    """Write what follows from the row of each step; return whether any edge is beyond its stretch limit.

    Parameters
    ----------
    columns : Columns
        What was measured.
    bad : ndarray of bool, shape (n_steps,)
        Whether a step holds an unusable frame.
    times : ndarray, shape (n_steps + 1,)
        Of the frames, ps.
    errors : ndarray, shape (n_steps,)
        How far each of two points may be from where the file, or the rotation, has put it, Å.
    ratios, limits, edges : ndarray
        See `greatest_stretches`.
    out : Outcomes
    """
    for k in range(len(bad)):
        is_measured = not math.isnan(columns.displacement[k])
        if is_measured:
            out.rotation_angle[k] = columns.angle[k] if columns.is_turned[k] else 0.0
        out.nu_ratio[k] = quotient(2.0 * columns.displacement[k], columns.nu[k])
        out.nu_margin[k] = 0.5 * columns.nu[k] - columns.displacement[k]
        out.certifiable_interval[k] = quotient(times[k + 1] - times[k], columns.ratio[k])
        kind = least_clearance(columns.clearances[k])
        if columns.clearances[k, kind] < np.inf:
            out.clearance[k] = columns.clearances[k, kind]
        out.clearance_witness[k, :] = columns.clearance_witness[k, kind]
        if out.n_crossings[k] > 0:
            out.verdict[k] = CROSSING
        elif is_measured and columns.rung[k] != OPEN:
            out.verdict[k] = CERTIFIED
            out.scope[k] = scope_of(out.clearance[k], errors[k])
        out.reason[k] = reason_of(columns, k, bad[k], out.verdict[k], out.reason[k])
    return greatest_stretches(ratios, limits, edges, out.bond_stretch, out.bond_stretch_edge)


@njit(cache=True, nogil=True)
def quotient(a: float, b: float) -> float:
    """Return a/b, b not negative; infinite where only b is 0."""
    return a * np.inf if b == 0.0 else a / b


@njit(cache=True, nogil=True)
def least_clearance(clearances: FloatArray) -> int:
    """Return which class has the least clearance, the first of equals; classes without a pair (NaN) have none."""
    least, kind = np.inf, 0
    for c in range(len(clearances)):
        if clearances[c] < least:
            least, kind = clearances[c], c
    return kind


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
def reason_of(columns: Columns, k: int, bad: bool, verdict: int, found: int) -> int:
    """Return why step k is UNRESOLVED; `found` is what exact arithmetic has to say of its open pairs."""
    if bad:
        return BAD_DATA
    if columns.jump[k] >= 0:
        return IMAGE_JUMP
    if not columns.cell_ok[k]:
        return CELL
    if verdict != UNRESOLVED:
        return NONE
    return LADDER if found == NONE else found


@njit(cache=True, nogil=True)
def greatest_stretches(
    ratios: FloatArray, limits: FloatArray, edges: IntArray, stretch: FloatArray, stretch_edge: IntArray
) -> bool:
    """Write the edge that is stretched most in each step; return whether any is beyond its limit.

    Parameters
    ----------
    ratios : ndarray, shape (n_steps, n_edges)
        Length over reference length; NaN of edges that are broken, and where it is unknown.
    limits : ndarray, shape (n_edges,)
        The ratio from which on an edge counts as stretched.
    edges : ndarray of int, shape (n_edges, 2)
    stretch, stretch_edge : ndarray, shape (n_steps,) and (n_steps, 2)
        Are written to where a ratio is known, and finite.
    """
    any_beyond = False
    for k in range(len(ratios)):
        greatest, worst = -1.0, 0
        for e in range(len(edges)):
            if ratios[k, e] > greatest:
                greatest, worst = ratios[k, e], e
        for e in range(len(edges)):  # a loop of its own: it has no branch, and takes several edges at once
            any_beyond |= ratios[k, e] >= limits[e]
        if 0.0 <= greatest < np.inf:
            stretch[k], stretch_edge[k, :] = greatest, edges[worst]
    return any_beyond
