"""The tube about a smooth curve: curvature, self distance, and the ends of open strands."""

import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import InputError
from mdtopo.geometry.curvature import HIGHEST_DEGREE, greatest_curvature
from mdtopo.geometry.tube import ENDS, SELF, STRANDS, search
from mdtopo.records import CompositeBezier, ParametricCurve, Tube, TubeLimit, TubeTerm
from mdtopo.sampledtubes import sampled_tube

TOLERANCE = 1e-8
"""How close the bounds of a value are brought together, relatively."""

STAGES = (1e-2, 1e-4, 1e-6, TOLERANCE)
"""Tolerances that are tried in turn where it is only asked whether the radius is greater than a length: a circle's
diameters all have one length, so that the last digits of it take a hundred times as long as the first ones."""

SMOOTH = 1e-9
"""Segments that follow each other smoothly have tangents within this angle: more than rounding, less than a corner."""

FIRST_HORIZON = 4.0
"""Pairs within so many mean segment lengths are looked at first; then twice as far, until nothing can be missed."""


def tube(curve: CompositeBezier | ParametricCurve, *, tolerance: float = TOLERANCE) -> Tube:
    """Return the greatest radius at which the tube about a curve does not meet itself, and what rules it.

    r = min(1/κ_max, d/2), d the least distance of a doubly normal pair; for open strands also half the distance of an
    end to the body and of the two ends, for several strands half their distance.

    Parameters
    ----------
    curve : CompositeBezier or ParametricCurve
        A smooth curve. Of a `ParametricCurve` the first derivative is needed.
    tolerance : float
        Relative distance of the two bounds of each value at which the search for it ends.

    Guarantee
    ---------
    Proven for a `CompositeBezier`, rounding included: κ_max comes from the polynomials (Bernstein form), pairs from a
    search that drops a pair of pieces only where no such pair of points can lie in it. Joints whose tangents turn by
    less than 1e-9 are taken for smooth, and the control points for exact. Heuristic for a
    `ParametricCurve`: it is sampled.

    Raises
    ------
    InputError
        The curve has a cusp, a corner, or a segment of one point; a degree above 60.

    Notes
    -----
    Jordan et al. (2008), Eq. (1), is for closed curves only; the terms of open ones are those of Maekawa, Patrikalakis,
    Sakkalis and Yu (1998). Why these terms suffice: two points far apart along the curve that are nearest to each other
    are joined by a line that is normal to the curve, except at ends.

    Examples
    --------
    A parabola, y = x²: its curvature is 2 at the vertex, and no two normals face each other.

    >>> import numpy as np
    >>> found = tube(CompositeBezier.from_control_points(np.array([[-1.0, 1], [0, -1], [1, 1]])))
    >>> round(found.radius, 6), found.ruling.limit.name
    (0.5, 'CURVATURE')
    """
    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise InputError(f"The tolerance of a tube must be greater than 0; got {tolerance!r}.")
    if isinstance(curve, ParametricCurve):
        return sampled_tube(curve)
    if curve.degree > HIGHEST_DEGREE:
        raise InputError(f"The tube of a segment of degree {curve.degree} is not computed; at most {HIGHEST_DEGREE}.")
    _check_smooth(curve)
    bends = greatest_curvature(curve.control_points, tolerance)
    if not np.isfinite(bends.upper):
        raise InputError(
            f"The curve has a cusp, or comes too near to one to tell, in segment {bends.segment} near "
            f"u = {bends.u:.6g}: its curvature has no bound there, and it has no tube."
        )
    least, found = _inverse(bends.upper), _inverse(bends.lower)
    terms = [TubeTerm(TubeLimit.CURVATURE, least, least, found, (bends.segment + bends.u,))]
    terms.append(_searched(curve, SELF, TubeLimit.SELF, tolerance))
    if len(curve.closed) > 1:
        terms.append(_searched(curve, STRANDS, TubeLimit.STRANDS, tolerance))
    if not curve.closed.all():
        terms.append(_searched(curve, ENDS, TubeLimit.END_BODY, tolerance))
        terms.append(_end_to_end(curve))
    return Tube(tuple(terms), is_proven=True)


def radius_bounds(curve: CompositeBezier | ParametricCurve, distance: float) -> tuple[float, float]:
    """Return two bounds of the radius of the tube, Å, as close as is needed to compare it with a distance.

    Guarantee
    ---------
    As of `tube`: for a `CompositeBezier` the lower one is proven. The distance lies between the two only where it does
    for those of `tube` itself.

    Raises
    ------
    InputError
        See `tube`.
    """
    least, most = 0.0, np.inf
    for tolerance in STAGES:
        found = tube(curve, tolerance=tolerance)
        least, most = max(least, found.radius), min(most, found.radius_at_most)
        if distance < least or distance >= most or not found.is_proven:
            break
    return least, most


def _inverse(value: float) -> float:
    return 1.0 / value if value > 0.0 else np.inf


def _check_smooth(curve: CompositeBezier) -> None:
    """Raise where a segment is one point, or two that follow each other do so with a corner."""
    steps = np.diff(curve.control_points, axis=1)
    lengths = np.linalg.norm(steps, axis=2)
    if (lengths.max(axis=1) == 0.0).any():
        segment = int(np.flatnonzero(lengths.max(axis=1) == 0.0)[0])
        raise InputError(
            f"Segment {segment} of the curve is a single point; coincident vertices have no tangent between them."
        )
    before = np.flatnonzero(curve.following >= 0)
    after = curve.following[before]
    last, first = steps[before, -1], steps[after, 0]
    sizes = lengths[before, -1] * lengths[after, 0]
    if (sizes == 0.0).any():
        joint = int(before[sizes == 0.0][0])
        raise InputError(f"The curve stands still at the end of segment {joint} (a cusp); it has no tube there.")
    turned = np.linalg.norm(np.cross(last, first), axis=1)
    corner = (turned > SMOOTH * sizes) | (np.einsum("ij,ij->i", last, first) < 0.0)
    if corner.any():
        joint = int(np.flatnonzero(corner)[0])
        angle = np.degrees(np.arctan2(turned[joint], last[joint] @ first[joint]))
        raise InputError(
            f"The curve has a corner of {angle:.4g}° where segment {before[joint]} meets segment {after[joint]}; only "
            "a curve with a continuous tangent has a tube."
        )


def _tips(curve: CompositeBezier) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the ends of the open strands: points, the segments that they end, and on which side."""
    firsts, lasts = curve.offsets[:-1][~curve.closed], curve.offsets[1:][~curve.closed] - 1
    points = np.concatenate([curve.control_points[firsts, 0], curve.control_points[lasts, -1]])
    segments = np.concatenate([firsts, lasts]).astype(np.int64)
    return points, segments, np.repeat(np.array([0, 1], dtype=np.int64), len(firsts))


def _searched(curve: CompositeBezier, kind: int, limit: TubeLimit, tolerance: float) -> TubeTerm:
    points = np.ascontiguousarray(curve.control_points)
    tips, segments, sides = _tips(curve) if kind == ENDS else (np.empty((0, 3)), *np.empty((2, 0), dtype=np.int64))
    extent = float(np.ptp(points.reshape(-1, 3), axis=0).max())
    horizon = FIRST_HORIZON * float(np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1).mean())
    while True:
        if horizon > 2.0 * extent:  # the diagonal is at most √3 times the longest side
            horizon = np.inf
        least, found, first, second, _ = search(
            points, curve.strand_of_segment, curve.following, tips, segments, sides, kind, horizon, tolerance
        )
        if found <= horizon or horizon == np.inf:
            break
        horizon *= 2.0
    where: tuple[float, ...] = ()
    if np.isfinite(found):
        where = (first, second)
        if kind == ENDS:
            where = (float(segments[int(first)] + sides[int(first)]), second)
    return TubeTerm(limit, 0.5 * least, least, found, where)


def _end_to_end(curve: CompositeBezier) -> TubeTerm:
    """Return the term of the two ends of each open strand; those of different strands belong to `STRANDS`."""
    firsts, lasts = curve.offsets[:-1][~curve.closed], curve.offsets[1:][~curve.closed] - 1
    apart = np.linalg.norm(curve.control_points[lasts, -1] - curve.control_points[firsts, 0], axis=1)
    nearest = int(apart.argmin())
    least = float(apart[nearest]) * (1.0 - 2.0**-49)
    where = (float(firsts[nearest]), float(lasts[nearest] + 1))
    return TubeTerm(TubeLimit.END_END, 0.5 * least, least, float(apart[nearest]), where)
