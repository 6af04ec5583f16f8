"""How far Bezier arcs are from their chords, and whether they run along them."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.geometry.bezier import halve, part
from mdtopo.geometry.distances import UNIT_ROUNDOFF

FloatArray = NDArray[np.float64]

HALVINGS = 4
"""Of each arc: the control points of its sixteenth parts are within 1 % of its distance from the chord."""


@njit(cache=True, nogil=True)
def arc_chords(segments: FloatArray, parameters: FloatArray, slack: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return for each chord an upper bound of its distance from the arc, and whether the arc runs along it.

    Parameters
    ----------
    segments : ndarray, shape (m, degree + 1, 3)
        Control points of one strand, Å.
    parameters : ndarray, shape (n,)
        The ends of the chords, rising: segment + u, from 0 to m.
    slack : float
        Greatest coordinate, Å: rounding is a multiple of it.

    Returns
    -------
    bounds : ndarray, shape (n - 1,)
        No point of the arc is further from its chord (nor of the chord from the arc), Å. Proven: the distance from a
        chord is convex, hence greatest at a control point. The chord is the one between the rounded end points, and the
        rounding of points, 64·n·u·slack for n the degree, is added.
    along : ndarray of bool, shape (n - 1,)
        Whether every tangent of the arc makes an acute angle with the chord; proven.
    """
    width = segments.shape[1]
    bounds, along = np.zeros(len(parameters) - 1), np.ones(len(parameters) - 1, dtype=np.bool_)
    rounding = 64.0 * width * UNIT_ROUNDOFF * slack
    parts = np.empty((2**HALVINGS, width, 3))
    for k in range(len(bounds)):
        a, b = parameters[k], parameters[k + 1]
        start, end = _point(segments, a), _point(segments, b)
        chord = end - start
        squared = np.sum(chord * chord)
        for j in range(int(np.floor(a)), len(segments)):
            low, high = max(a - j, 0.0), min(b - j, 1.0)
            if not high > low:
                if j > a:
                    break
                continue
            parts[0] = part(segments[j], low, high)
            for level in range(HALVINGS):
                for i in range(2**level - 1, -1, -1):
                    piece = parts[i].copy()
                    halve(piece, parts[2 * i], parts[2 * i + 1])
            for i in range(len(parts)):
                for c in range(width):
                    d = parts[i, c] - start
                    share = min(max(np.sum(d * chord) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
                    bounds[k] = max(bounds[k], np.sqrt(np.sum((d - share * chord) ** 2)))
                    if c > 0:
                        step = parts[i, c] - parts[i, c - 1]
                        if not np.sum(step * chord) > 4.0 * rounding * np.sqrt(squared) + 4.0 * rounding * np.sqrt(
                            np.sum(step * step)
                        ):
                            along[k] = False
        bounds[k] += rounding
    return bounds, along


@njit(cache=True, nogil=True)
def _point(segments: FloatArray, t: float) -> FloatArray:
    """Return the point of a strand at segment + u."""
    j = min(int(np.floor(t)), len(segments) - 1)
    row, u = segments[j].copy(), t - j
    for stop in range(len(row) - 1, 0, -1):
        for i in range(stop):
            row[i] = (1.0 - u) * row[i] + u * row[i + 1]
    return row[0].copy()


@njit(cache=True, nogil=True)
def strand_points(segments: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return the points of a strand at parameters segment + u, shape (n, 3)."""
    found = np.empty((len(parameters), 3))
    for k in range(len(parameters)):
        found[k] = _point(segments, parameters[k])
    return found
