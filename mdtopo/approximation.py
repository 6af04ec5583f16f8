"""A polyline for a smooth curve: as many vertices as the curvature asks for, with the error checked afterwards."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mdtopo.arcs import Arc, BezierArc, SampledArc
from mdtopo.errors import InputError
from mdtopo.geometry.approximate import (
    MOST_VERTICES,
    Panels,
    bend_panels,
    chord_bounds,
    expected_chords,
    place_vertices,
)
from mdtopo.records import Approximation, CompositeBezier, Isotopy, ParametricCurve
from mdtopo.tubes import radius_bounds
from mdtopo.typing import Flags, Lengths

EPSILON_PER_TOLERANCE = 4.0
"""The distance of a short chord from its curve tends to a quarter of ε."""

MOST_ROUNDS = 50
"""Rounds in which chords beyond the tolerance are halved: each makes a chord's error four times smaller."""

CONTRADICTION = 1e-6
"""By how much of itself and of ε a measured error may pass what c'' allows before c'' is refused."""

ROUNDING = 1e-12
"""The same for the rounding of the points, as a multiple of the greatest coordinate."""


class _Chords(NamedTuple):
    """The chords of one strand: ends, distance from the curve (found or proven, and by |c''|), and their direction."""

    parameters: NDArray[np.float64]
    errors: Lengths
    bounds: Lengths
    along: Flags


def approximate(
    curve: CompositeBezier | ParametricCurve, tolerance: float | None = None, *, epsilon: float | None = None
) -> Approximation:
    """Return a polyline on a curve, with vertices where its second derivative asks for them.

    From a vertex at t the next one lies at t + h with ∫(t..t+h) |c''(u)| (t+h-u) du = ε. So N·√ε → (1/√2)∫√|c''| for
    small ε.

    Parameters
    ----------
    curve : CompositeBezier or ParametricCurve
        Smooth strands of Bezier segments, or any C² curve on [0, 1]. Where segments meet in a corner, a vertex is set.
    tolerance : float, optional
        How far the curve may be from its chords, Å. Then ε is four times that, the distance is checked afterwards, and
        chords beyond it are halved.
    epsilon : float, optional
        ε itself, Å; the vertices are then those of the rule and no others. Give one of the two.

    Guarantee
    ---------
    For a `CompositeBezier`, proven: `chord_error` bounds the distance of curve and polyline, and `isotopy` is `TUBE`
    only where the polyline is ambient isotopic to the curve. Heuristic for a `ParametricCurve`, which is known at
    sampled places only: `chord_bound` follows from |c''| there, `chord_error` is measured, `isotopy` is at best
    `TUBE_SAMPLED`.

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
    arcs: list[Arc]
    if isinstance(curve, CompositeBezier):
        arcs = [BezierArc.of(curve, strand) for strand in range(len(curve.closed))]
    else:
        arcs = [SampledArc(curve)]
    chords = [_within(arc, limit, step) for arc in arcs]
    errors = np.concatenate([one.errors for one in chords])
    isotopy, reason = _isotopy(curve, float(errors.max()), np.concatenate([one.along for one in chords]))
    return Approximation(
        parameters=np.concatenate([one.parameters / arc.edges[-1] for one, arc in zip(chords, arcs, strict=True)]),
        points=np.concatenate([arc.points(one.parameters) for one, arc in zip(chords, arcs, strict=True)]),
        offsets=np.cumsum([0, *(len(one.parameters) for one in chords)]).astype(np.int64),
        epsilon=step,
        chord_error=float(errors.max()),
        chord_bound=max(float(one.bounds.max()) for one in chords),
        isotopy=isotopy,
        reason=reason,
    )


def _limits(tolerance: float | None, epsilon: float | None) -> tuple[float, float]:
    """Return how far chords may be from the curve, and ε; validated."""
    if (tolerance is None) == (epsilon is None):
        raise InputError("approximate needs either a tolerance or an epsilon, and not both.")
    value, name = (tolerance, "tolerance") if epsilon is None else (epsilon, "epsilon")
    if value is None or not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name} must be a length greater than 0, in Å; got {value!r}.")
    return (value, EPSILON_PER_TOLERANCE * value) if epsilon is None else (np.inf, value)


def _placed(arc: Arc, panels: Panels, epsilon: float) -> NDArray[np.float64]:
    """Return the vertices by the rule, from corner to corner."""
    ends = np.concatenate([arc.edges[:1], arc.corners, arc.edges[-1:]])
    found = [ends[:1]]
    for start, end in pairwise(ends):
        first, last = np.searchsorted(panels.edges, [start, end])
        few = expected_chords(panels, epsilon) < MOST_VERTICES
        placed = (
            place_vertices(panels.edges[first : last + 1], panels.coefficients[first:last], epsilon)
            if few
            else ends[:0]
        )
        if len(placed) == 0:
            raise InputError(
                f"ε = {epsilon:g} Å would need more than {MOST_VERTICES:,} vertices, or steps below the digits of the "
                "parameter; choose a greater one."
            )
        found.append(placed[1:])
    return np.concatenate(found)


def _within(arc: Arc, limit: float, epsilon: float) -> _Chords:
    """Return the chords of the rule, with those halved that are beyond the limit."""
    panels = bend_panels(arc.bend_lengths, arc.edges)
    parameters = _placed(arc, panels, epsilon)
    for _ in range(MOST_ROUNDS):
        errors, along = arc.chords(parameters)
        bounds = chord_bounds(panels.edges, panels.coefficients, parameters)
        if isinstance(arc, SampledArc):
            slack = CONTRADICTION * (errors + epsilon) + ROUNDING * float(np.abs(arc.points(parameters)).max())
            _check_agreement(parameters, errors, bounds, slack)
        wide = errors > limit
        if not wide.any():
            return _Chords(parameters, errors, bounds, along)
        middles = 0.5 * (parameters[:-1] + parameters[1:])[wide]
        parameters = np.sort(np.concatenate([parameters, middles]))
    raise InputError(
        f"No polyline was found within {limit:g} Å of the curve; the tolerance is below its rounding error."
    )


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


def _isotopy(curve: CompositeBezier | ParametricCurve, error: float, along: Flags) -> tuple[Isotopy, str]:
    """Return whether the polyline has the curve's type by the tube, and why.

    A point of a chord is at most `error` from the nearest point of its arc, which is no end of it, because the arc's
    end tangents make acute angles with the chord: so it lies in that point's normal disk. If error < r, these disks are
    disjoint and fill the tube. Along the chord the disk moves forward only, because all tangents of the arc make acute
    angles with the chord. So every disk meets the polyline in one point, which is moved to the centre within the disk.
    """
    if isinstance(curve, ParametricCurve) and curve.first_derivative is None:
        return Isotopy.NOT_KNOWN, "the tube of a ParametricCurve needs its first derivative"
    try:
        least, most = radius_bounds(curve, error)
    except InputError as problem:
        return Isotopy.NOT_KNOWN, f"the curve has no tube: {problem}"
    if not error < least:
        words = f"has the radius {most:.6g} Å" if error >= most else f"is proved to have the radius {least:.6g} Å only"
        return Isotopy.NOT_KNOWN, f"the polyline is {error:.6g} Å from the curve, whose tube {words}"
    if not along.all():
        return (
            Isotopy.NOT_KNOWN,
            f"{int((~along).sum())} chords are not seen to run along their arc; ask for shorter ones",
        )
    words = (
        f"the polyline lies in the tube (within {error:.6g} Å of the curve, radius {least:.6g} Å or more) "
        "and runs along it"
    )
    return (Isotopy.TUBE if isinstance(curve, CompositeBezier) else Isotopy.TUBE_SAMPLED), words
