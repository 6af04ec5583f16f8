"""A polyline for a smooth curve: as many vertices as the curvature asks for, and the error checked afterwards."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import InputError
from mdtopo.geometry.approximate import (
    MOST_VERTICES,
    Panels,
    bend_panels,
    chord_bounds,
    expected_chords,
    place_vertices,
)
from mdtopo.records import Approximation, ParametricCurve
from mdtopo.typing import Lengths, Points

FIRST_PANELS = 16
"""Panels to begin with; they are halved where |c''| needs it."""

CHORD_PARTS = 8
"""Parts of a chord at whose ends the distance of the curve is measured."""

EPSILON_PER_TOLERANCE = 4.0
"""The distance of a short chord from its curve tends to a quarter of ε."""

MOST_ROUNDS = 50
"""Rounds in which chords beyond the tolerance are halved: each makes a chord's error four times smaller."""

CONTRADICTION = 1e-6
"""By how much of itself and of ε a measured error may pass what c'' allows before c'' is refused."""

ROUNDING = 1e-12
"""The same for the rounding of the points, as a multiple of the greatest coordinate."""


def approximate(
    curve: ParametricCurve, tolerance: float | None = None, *, epsilon: float | None = None
) -> Approximation:
    """Return a polyline on a curve, with vertices where its second derivative asks for them.

    From a vertex at t the next one lies at t + h with ∫(t..t+h) |c''(u)| (t+h-u) du = ε. So N·√ε → (1/√2)∫√|c''| for
    small ε.

    Parameters
    ----------
    curve : ParametricCurve
        Any C² curve on [0, 1].
    tolerance : float, optional
        How far the curve may be from its chords, Å. Then ε is four times that, the distance is measured afterwards, and
        chords beyond it are halved.
    epsilon : float, optional
        ε itself, Å; the vertices are then those of the rule and no others. Give one of the two.

    Guarantee
    ---------
    Heuristic: the curve is known at sampled places only. `chord_bound` follows from |c''| between them, `chord_error`
    is measured.

    Raises
    ------
    InputError
        Neither or both of tolerance and epsilon are given, or not positive, or so small that a million vertices would
        be needed; a function of the curve is not finite; c'' is not the second derivative of the position.

    Notes
    -----
    Jordan et al. (2008), section 6. ε bounds the distance of the next vertex from the tangent line; the distance of the
    chord from the curve is at most ε, and tends to ε/4.

    Examples
    --------
    A parabola with |c''| = 2: each step has h² = ε.

    >>> parabola = ParametricCurve(lambda t: (t, t * t), lambda t: (0.0, 2.0))
    >>> found = approximate(parabola, epsilon=1 / 16)
    >>> found.parameters.round(12).tolist(), round(found.chord_error, 4)
    ([0.0, 0.25, 0.5, 0.75, 1.0], 0.0152)
    """
    limit, step = _limits(tolerance, epsilon)
    panels = bend_panels(_bend_lengths(curve), np.linspace(0.0, 1.0, FIRST_PANELS + 1))
    parameters = np.empty(0)
    if expected_chords(panels, step) < MOST_VERTICES:
        parameters = place_vertices(panels.edges, panels.coefficients, step)
    if len(parameters) == 0:
        raise InputError(
            f"ε = {step:g} Å would need more than {MOST_VERTICES:,} vertices, or steps below the digits of the "
            "parameter; ask for less."
        )
    parameters, errors, bounds = _within(curve, panels, parameters, limit, step)
    return Approximation(parameters, curve.points(parameters), step, float(errors.max()), float(bounds.max()))


def _limits(tolerance: float | None, epsilon: float | None) -> tuple[float, float]:
    """Return how far chords may be from the curve, and ε; validated."""
    if (tolerance is None) == (epsilon is None):
        raise InputError("approximate needs either a tolerance or an epsilon, and not both.")
    value, name = (tolerance, "tolerance") if epsilon is None else (epsilon, "epsilon")
    if value is None or not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name} must be a length greater than 0, in Å; got {value!r}.")
    return (value, EPSILON_PER_TOLERANCE * value) if epsilon is None else (np.inf, value)


def _bend_lengths(curve: ParametricCurve) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    def bend_lengths(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([np.linalg.norm(curve.bend(float(u))) for u in t])

    return bend_lengths


def _within(
    curve: ParametricCurve, panels: Panels, parameters: NDArray[np.float64], limit: float, epsilon: float
) -> tuple[NDArray[np.float64], Lengths, Lengths]:
    """Return parameters, errors and bounds of chords, after those beyond the limit were halved."""
    for _ in range(MOST_ROUNDS):
        errors = chord_errors(curve, parameters)
        bounds = chord_bounds(panels.edges, panels.coefficients, parameters)
        slack = CONTRADICTION * (errors + epsilon) + ROUNDING * float(np.abs(curve.points(parameters)).max())
        _check_agreement(parameters, errors, bounds, slack)
        wide = errors > limit
        if not wide.any():
            return parameters, errors, bounds
        middles = 0.5 * (parameters[:-1] + parameters[1:])[wide]
        parameters = np.sort(np.concatenate([parameters, middles]))
    raise InputError(
        f"No polyline was found within {limit:g} Å of the curve; the tolerance is below its rounding error."
    )


def chord_errors(curve: ParametricCurve, parameters: NDArray[np.float64]) -> Lengths:
    """Return how far the curve is from each of its chords where it was looked at, Å, shape (n - 1,)."""
    a, b = curve.points(parameters[:-1]), curve.points(parameters[1:])
    greatest = np.zeros(len(a))
    for part in range(1, CHORD_PARTS):
        share = part / CHORD_PARTS
        there = curve.points((1.0 - share) * parameters[:-1] + share * parameters[1:])
        greatest = np.maximum(greatest, _distances(there, a, b))
    return greatest


def _distances(p: Points, a: Points, b: Points) -> Lengths:
    """Return the distance of each point from the straight piece (a, b), Å."""
    along = b - a
    squared = np.einsum("ij,ij->i", along, along)
    where = np.einsum("ij,ij->i", p - a, along) / np.where(squared > 0.0, squared, 1.0)
    apart: Lengths = np.linalg.norm(p - a - np.clip(where, 0.0, 1.0)[:, None] * along, axis=1)
    return apart


def _check_agreement(parameters: NDArray[np.float64], errors: Lengths, bounds: Lengths, slack: Lengths) -> None:
    """Raise where a chord is further from the curve than its second derivative allows."""
    beyond = errors - bounds - slack
    worst = int(beyond.argmax())
    if beyond[worst] > 0.0:
        raise InputError(
            f"second_derivative is not that of position: between t = {parameters[worst]:.6g} and "
            f"{parameters[worst + 1]:.6g} the curve is {errors[worst]:.6g} Å from its chord, and c'' allows "
            f"{bounds[worst]:.6g} Å. Check the derivative (with respect to t in [0, 1]), or the curve is not C²."
        )
