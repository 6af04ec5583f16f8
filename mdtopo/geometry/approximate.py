"""Where the vertices of a curvature-adaptive polyline lie.

From a vertex at t the next one lies at t + h with ∫(t..t+h) |c''(u)| (t+h-u) du = ε. By Taylor's formula this bounds
the distance of c(t+h) from the tangent line at t (Jordan et al. 2008, section 6). |c''| is known as a polynomial on
each of many panels, so that every integral is one of a polynomial, and no difference of great numbers is taken.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

N_NODES = 8
"""Values of |c''| per panel; its polynomial has degree 7."""

NODES = np.polynomial.legendre.leggauss(N_NODES)[0]
"""Where on a panel, in [-1, 1]."""

TO_POWERS = np.linalg.inv(np.vander(NODES, N_NODES, increasing=True))
"""From values at the nodes to coefficients of 1, x, x², …; its condition number is below 100."""

MOMENT_NODES, MOMENT_WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Five points integrate degree 9 exactly; a moment of a panel's polynomial has degree 8."""

PANEL_ERROR = 1e-12
"""Error of ∫|c''| over a panel that is accepted, as a share of the whole; a chord's ε is then right to N·1e-12."""

DEEPEST = 40
"""Halvings of a panel: where |c''| has a corner (c'' = 0, or jumps) the panel ends as narrow as 1e-12 of itself."""

MOST_VERTICES = 1_000_000
"""More would fill the memory before they helped anybody."""

SLIVER = 1e-9
"""A last step shorter than this share of the step before it is rounding, and is not taken."""

MOST_NEWTON_STEPS = 60
"""Newton's method on a convex rising function from the right needs a handful."""


class Panels(NamedTuple):
    """|c''| on [0, 1]: on panel k between edges k and k + 1 the polynomial Σ coefficients[k, i]·xⁱ, x in [-1, 1]."""

    edges: FloatArray
    coefficients: FloatArray


def bend_panels(bend_length: Callable[[FloatArray], FloatArray], edges: FloatArray) -> Panels:
    """Return |c''| as polynomials on panels that are halved until they tell it well enough.

    Parameters
    ----------
    bend_length : callable
        |c''| at each of an array of parameters.
    edges : ndarray, shape (n + 1,)
        Where to start: parameters in rising order, with every place where c'' jumps.

    Guarantee
    ---------
    Heuristic: what lies between the places that are looked at is not seen.
    """
    left, right = edges[:-1], edges[1:]
    values = _at_nodes(bend_length, left, right)
    total = float(np.sum(values.mean(axis=1) * (right - left)))
    done_left, done_values = [], []
    for _ in range(DEEPEST):
        middle = 0.5 * (left + right)
        halves_left, halves_right = np.stack([left, middle], 1).ravel(), np.stack([middle, right], 1).ravel()
        halves = _at_nodes(bend_length, halves_left, halves_right)
        told = _polynomial_at_half_nodes(values @ TO_POWERS.T)
        error = np.abs(told - halves.reshape(told.shape)).max(axis=1) * (right - left)
        fine = np.repeat(error <= PANEL_ERROR * total, 2)
        done_left.append(halves_left[fine])
        done_values.append(halves[fine])
        left, right, values = halves_left[~fine], halves_right[~fine], halves[~fine]
        if len(left) == 0:
            break
    starts, found = np.concatenate([*done_left, left]), np.concatenate([*done_values, values])
    order = np.argsort(starts)
    return Panels(np.append(starts[order], edges[-1]), found[order] @ TO_POWERS.T)


def _at_nodes(bend_length: Callable[[FloatArray], FloatArray], left: FloatArray, right: FloatArray) -> FloatArray:
    where = 0.5 * (left + right)[:, None] + 0.5 * (right - left)[:, None] * NODES
    return bend_length(where.ravel()).reshape(where.shape)


def _polynomial_at_half_nodes(coefficients: FloatArray) -> FloatArray:
    """Return a panel's polynomial at the nodes of its two halves, shape (n, 2 * N_NODES)."""
    x = np.concatenate([0.5 * NODES - 0.5, 0.5 * NODES + 0.5])
    return coefficients @ np.vander(x, N_NODES, increasing=True).T


def expected_chords(panels: Panels, epsilon: float) -> float:
    """Return (1/√(2ε)) ∫√|c''|, to which the number of chords tends for small ε; an estimate."""
    x = panels.coefficients @ np.vander(NODES, N_NODES, increasing=True).T
    roots = np.sqrt(np.maximum(x, 0.0)).mean(axis=1)
    return float(np.sum(roots * np.diff(panels.edges)) / np.sqrt(2.0 * epsilon))


@njit(cache=True, nogil=True)
def _moments(coefficients: FloatArray, left: float, right: float, a: float, b: float) -> tuple[float, float]:
    """Return ∫|c''| and ∫|c''|(b - u) over [a, b], a part of the panel [left, right]."""
    zeroth, first = 0.0, 0.0
    half = 0.5 * (b - a)
    for k in range(len(MOMENT_NODES)):
        u = 0.5 * (a + b) + half * MOMENT_NODES[k]
        x = (2.0 * u - left - right) / (right - left)
        value = 0.0
        for i in range(N_NODES - 1, -1, -1):
            value = value * x + coefficients[i]
        zeroth += MOMENT_WEIGHTS[k] * value
        first += MOMENT_WEIGHTS[k] * value * half * (1.0 - MOMENT_NODES[k])
    return half * zeroth, half * first


@njit(cache=True, nogil=True)
def _next_vertex(
    edges: FloatArray, coefficients: FloatArray, panel: int, t: float, epsilon: float
) -> tuple[float, int]:
    """Return the vertex after t, and its panel; the last edge where the integral stays below ε."""
    q, f, s = 0.0, 0.0, t  # q(s) = ∫(t..s) |c''|(s - u) du, f = q' = ∫(t..s) |c''|
    for j in range(panel, len(coefficients)):
        left, right = edges[j], edges[j + 1]
        zeroth, first = _moments(coefficients[j], left, right, s, right)
        there = q + f * (right - s) + first
        if there >= epsilon:
            x, slope = right, f + zeroth
            for _ in range(
                MOST_NEWTON_STEPS
            ):  # q is convex and rises: from the right every step stays right of the root
                nearer = max(x - (there - epsilon) / slope, s)
                if not nearer < x:
                    break
                x = nearer
                zeroth, first = _moments(coefficients[j], left, right, s, x)
                there, slope = q + f * (x - s) + first, f + zeroth
                if there <= epsilon:
                    break
            return x, j
        q, f, s = there, f + zeroth, right
    return edges[-1], len(coefficients)


@njit(cache=True, nogil=True)
def place_vertices(edges: FloatArray, coefficients: FloatArray, epsilon: float) -> FloatArray:
    """Return the parameters of the vertices, from the first edge to the last.

    Parameters
    ----------
    edges, coefficients : ndarray
        |c''|, see `Panels`.
    epsilon : float
        Greater than 0, Å.

    Returns
    -------
    ndarray, shape (n,)
        Rising; of every step but the last the integral is ε. Empty where there would be more than MOST_VERTICES.
    """
    found, count = np.empty(1024), 1
    found[0], panel, end = edges[0], 0, edges[-1]
    while found[count - 1] < end:
        t = found[count - 1]
        after, panel = _next_vertex(edges, coefficients, panel, t, epsilon)
        if not after > t:  # a step too small for the digits of t
            return np.empty(0)
        if end - after < SLIVER * (after - t):
            after = end
        if count == len(found):
            if count >= MOST_VERTICES:
                return np.empty(0)
            found = np.concatenate((found, np.empty(count)))
        found[count] = after
        count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def chord_bounds(edges: FloatArray, coefficients: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return for each chord a bound of its distance from the curve that |c''| allows, Å, shape (n - 1,).

    |c(u) - chord(u)| ≤ ∫ |c''(v)| (v - a)(b - v)/(b - a) dv over the chord [a, b]: Green's function of linear
    interpolation at its greatest. Since v - a ≤ b - a, it is below the ε of the chord; for constant |c''| it is ε/3,
    and the distance ε/4.
    """
    bounds, panel = np.zeros(len(parameters) - 1), 0
    for k in range(len(bounds)):
        a, b = parameters[k], parameters[k + 1]
        while panel > 0 and edges[panel] > a:
            panel -= 1
        while edges[panel + 1] <= a:
            panel += 1
        s, total = a, 0.0
        while s < b:
            left, right = edges[panel], edges[panel + 1]
            stop = min(right, b)
            half = 0.5 * (stop - s)
            for i in range(len(MOMENT_NODES)):
                v = 0.5 * (s + stop) + half * MOMENT_NODES[i]
                x, value = (2.0 * v - left - right) / (right - left), 0.0
                for power in range(N_NODES - 1, -1, -1):
                    value = value * x + coefficients[panel, power]
                total += half * MOMENT_WEIGHTS[i] * value * (v - a) * (b - v) / (b - a)
            s = stop
            if s < b:
                panel += 1
        bounds[k] = total
    return bounds
