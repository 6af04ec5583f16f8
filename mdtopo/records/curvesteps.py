"""What one step of a smooth curve measures and proves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.records.crossings import Grade
from mdtopo.records.steps import Rung, Verdict


@dataclass(frozen=True, slots=True, eq=False)
class CurveCrossing:
    """One passage of a smooth curve through itself, or of one strand's curve through another's.

    Attributes
    ----------
    t : float
        Time within the step, in (0, 1).
    segments : tuple of int
        The two segments.
    parameters : tuple of float
        Where on them, from 0 to 1.
    point : ndarray, shape (3,)
        Where in space, Å.
    sign : int
        Change of the linking number, or half the change of the writhe, that the passage brings.
    grade : Grade
        PROVEN: the linking number of the two closed strands differs between the two ends, whatever the path. RESOLVED
        and UNDERSAMPLED as for a polyline, with the chord for the edge.
    motion, resolution : float
        Greatest relative motion of control points of the two segments, and the length it is held against, Å.
    """

    t: float
    segments: tuple[int, int]
    parameters: tuple[float, float]
    point: NDArray[np.float64]
    sign: int
    grade: Grade
    motion: float
    resolution: float


@dataclass(frozen=True, slots=True)
class CurvePlace:
    """Where halving gave up: two segments, and ranges of time and of the parameter on each."""

    segments: tuple[int, int]
    t: tuple[float, float]
    u: tuple[float, float]
    v: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class CurveReport:
    """What one step of a smooth curve measures and proves.

    Attributes
    ----------
    verdict : Verdict
        CERTIFIED: the curve never meets itself during the step. CROSSING: it passes as listed. Else UNRESOLVED.
    rung : Rung
        The costliest rung that a check needed; BISECTION is halving in time and space, EXACT a proved passage.
    depth : int
        The most halvings that a check needed; 0 where hulls alone settle the step.
    d_star, d_star_segment : float, int
        Least distance of the origin to the hull of a segment's differences of control points, at the start, Å.
    bezier_ratio, bezier_margin : float
        Greatest max|δ(P_(i+1) - P_i)|/d* over the segments: below 1 no segment comes to meet itself. Least d* less that
        motion, Å.
    printed_ratio : float
        Greatest max|δP_i|/d*: the paper's comparison (Prop. 3.2) as printed. It proves something below 1/2 only.
    clearance : float
        Proven lower bound of the distance of segments that share no point during the step, Å; 0 where the step is not
        certified. It is followed to the mean length of a segment.
    pair : tuple of int
        The two segments that hold it, -1 where none is so near.
    n_open : int
        Checks that are not settled.
    place : CurvePlace or None
        Where the first of them gave up.
    crossings : tuple of CurveCrossing
        In order of time.
    """

    verdict: Verdict
    rung: Rung
    depth: int
    d_star: float
    d_star_segment: int
    bezier_ratio: float
    bezier_margin: float
    printed_ratio: float
    clearance: float
    pair: tuple[int, int]
    n_open: int
    place: CurvePlace | None
    crossings: tuple[CurveCrossing, ...]
