"""The tube about a curve that is known by its functions only: from samples, refined by Newton's method; heuristic."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from mdtopo.errors import InputError
from mdtopo.records import ParametricCurve, Tube, TubeLimit, TubeTerm

N_SAMPLES = 721
"""Places at which the curve is looked at first."""

NEAREST = 12
"""Candidates, nearest first, that are refined: more only repeat them."""

STEPS = 40
"""Newton steps; where pairs form a family (a circle's diameters) the least step is taken."""

NORMAL = 1e-9
"""Cosine below which a line counts as normal to the curve, after refinement."""

FloatArray = NDArray[np.float64]


def sampled_tube(curve: ParametricCurve) -> Tube:
    """Return the tube of a parametric curve, from samples.

    Guarantee
    ---------
    Heuristic: right to about 1e-9 where the samples show every narrow bend and every near pair.

    Raises
    ------
    InputError
        No first derivative was given, or it vanishes (a cusp).
    """
    t = np.linspace(0.0, 1.0, N_SAMPLES)
    points, velocities = curve.points(t), np.stack([curve.velocity(float(u)) for u in t])
    speeds = np.linalg.norm(velocities, axis=1)
    if not speeds.min() > 1e-9 * speeds.max():
        raise InputError(f"The curve has a cusp near t = {t[int(speeds.argmin())]:.6g} (c' = 0); it has no tube.")
    terms = [_curvature_term(curve, t), _self_term(curve, t, points, velocities)]
    if not curve.closed:
        terms.append(_end_body_term(curve, t, points, velocities))
        apart = float(np.linalg.norm(points[-1] - points[0]))
        terms.append(TubeTerm(TubeLimit.END_END, 0.5 * apart, apart, apart, (0.0, 1.0)))
    return Tube(tuple(terms), is_proven=False)


def _curvature_term(curve: ParametricCurve, t: FloatArray) -> TubeTerm:
    def straightness(u: float) -> float:
        """Return the curvature with its sign changed, to be made least."""
        velocity = curve.velocity(u)
        return -float(np.linalg.norm(np.cross(velocity, curve.bend(u))) / np.linalg.norm(velocity) ** 3)

    values = np.array([straightness(float(u)) for u in t])
    best = int(values.argmin())
    low, high = t[max(best - 1, 0)], t[min(best + 1, len(t) - 1)]
    refined = minimize_scalar(straightness, bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    where, kappa = float(t[best]), -float(values[best])
    if -refined.fun > kappa:
        where, kappa = float(refined.x), -float(refined.fun)
    radius = 1.0 / kappa if kappa > 0.0 else np.inf
    return TubeTerm(TubeLimit.CURVATURE, radius, radius, radius, (where,))


def _self_term(curve: ParametricCurve, t: FloatArray, points: FloatArray, velocities: FloatArray) -> TubeTerm:
    """Return the least distance of a doubly normal pair: cells of (s, t) in which both conditions change their sign."""
    apart = points[:, None] - points[None]
    normal = np.einsum("ijk,ik->ij", apart, velocities)
    rows, columns = np.nonzero(_changes_sign(normal) & _changes_sign(normal.T).T)
    beyond = columns - rows > 2  # neighbours share the sign change of the diagonal
    if curve.closed:
        beyond &= rows + len(t) - 1 - columns > 2
    rows, columns = rows[beyond], columns[beyond]
    distances = np.linalg.norm(points[rows] - points[columns], axis=1)

    def conditions(x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return what vanishes where a chord is normal to the curve at both its ends, its slope, and the distance."""
        d = curve.point(x[0]) - curve.point(x[1])
        v, w = curve.velocity(x[0]), curve.velocity(x[1])
        f = np.array([d @ v, d @ w])
        slope = np.array([[v @ v + d @ curve.bend(x[0]), -(v @ w)], [v @ w, d @ curve.bend(x[1]) - w @ w]])
        return f / [np.linalg.norm(v), np.linalg.norm(w)], _scaled(slope, v, w), float(np.linalg.norm(d))

    half_cell = 0.5 / (len(t) - 1)
    starts = [np.array([t[rows[k]] + half_cell, t[columns[k]] + half_cell]) for k in np.argsort(distances)[:NEAREST]]
    return _least(TubeLimit.SELF, conditions, starts, curve.closed)


def _scaled(slope: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
    scaled: FloatArray = slope / np.array([[np.linalg.norm(v)], [np.linalg.norm(w)]])
    return scaled


def _changes_sign(values: FloatArray) -> NDArray[np.bool_]:
    """Return for each cell of a grid whether its four corners differ in sign."""
    corners = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
    changes: NDArray[np.bool_] = (corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0)
    return changes


def _end_body_term(curve: ParametricCurve, t: FloatArray, points: FloatArray, velocities: FloatArray) -> TubeTerm:
    terms = []
    for end, tip in ((0.0, points[0]), (1.0, points[-1])):
        along = np.einsum("ij,ij->i", points - tip, velocities)
        cells = np.flatnonzero((along[:-1] * along[1:] <= 0.0) & (along[:-1] != 0.0) & (along[1:] != 0.0))

        def conditions(x: FloatArray, tip: FloatArray = tip) -> tuple[FloatArray, FloatArray, float]:
            """Return what vanishes where the way to the tip is normal to the curve, its slope, and the distance."""
            d, w = curve.point(x[0]) - tip, curve.velocity(x[0])
            speed = float(np.linalg.norm(w))
            slope = np.array([[(w @ w + d @ curve.bend(x[0])) / speed]])
            return np.array([d @ w / speed]), slope, float(np.linalg.norm(d))

        starts = [np.array([0.5 * (t[k] + t[k + 1])]) for k in cells]
        found = _least(TubeLimit.END_BODY, conditions, starts, closed=False)
        terms.append(TubeTerm(found.limit, found.radius, found.least, found.found, (end, *found.where)))
    return min(terms, key=lambda term: term.radius)


def _least(
    limit: TubeLimit,
    conditions: Callable[[FloatArray], tuple[FloatArray, FloatArray, float]],
    starts: list[FloatArray],
    closed: bool,
) -> TubeTerm:
    """Return the term of the least distance at which the conditions vanish, from the given starts."""
    least = np.inf
    where: tuple[float, ...] = ()
    for x in starts:
        for _ in range(STEPS):
            f, slope, distance = conditions(x)
            step = np.linalg.lstsq(slope, f, rcond=1e-9)[0]
            x = x - step
            x = x % 1.0 if closed else np.clip(x, 0.0, 1.0)
            if np.abs(step).max() < 1e-14:
                break
        f, _, distance = conditions(x)
        if np.abs(f).max() <= NORMAL * distance and 0.0 < distance < least:
            least, where = distance, tuple(float(u) for u in x)
    return TubeTerm(limit, 0.5 * least, least, least, where)
