"""The smooth curve of one step, built again by SciPy: where crossings are said to be, and how far segments are apart.

A point of the curve at a fixed parameter is linear in the vertices. So at time t the curve lies at (1 - t)·S0 + t·S1,
with S0 and S1 the splines of the two ends of the step.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.interpolate import BPoly, BSpline, CubicHermiteSpline, CubicSpline

from mdtopo.referee.paths import Piece
from mdtopo.referee.search import near_pairs
from mdtopo.referee.steps import Edge, StepCase
from mdtopo.typing import Points

Spline: TypeAlias = Callable[..., Points]
"""From parameters, counted in edges from the first vertex, to points; or to derivatives, of the order given second."""

PARAMETERS, TIMES = 9, 5
"""Places on a segment, and times within a step, at which distances are looked at."""

MOST_TOGETHER = 2000
"""Pairs that are looked at together, which bounds memory."""


def spline_of(x: Points, is_closed: bool, kind: str) -> Spline:
    """Return the curve of one piece of a strand, in space.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Its vertices in order, two or more, Å.
    is_closed : bool
    kind : str
        'interpolating', 'bspline', 'catmull-rom' or 'bezier'.
    """
    spline: Spline
    around = np.concatenate([x, x[:1]]) if is_closed else x
    knots = np.arange(len(around), dtype=np.float64)
    if kind == "interpolating":
        spline = CubicSpline(knots, around, bc_type="periodic" if is_closed else "natural")
        return spline
    before = x[-1:] if is_closed else 2.0 * x[:1] - x[1:2]
    after = x[1:2] if is_closed else 2.0 * x[-1:] - x[-2:-1]
    wide = np.concatenate([before, around, after])
    if kind == "bspline":
        spline = BSpline(np.arange(len(wide) + 4) - 3.0, wide, 3)
    elif kind == "catmull-rom":
        spline = CubicHermiteSpline(knots, around, 0.5 * (wide[2:] - wide[:-2]))
    else:
        spline = BPoly(around[:, np.newaxis], [0.0, knots[-1]])
    return spline


@dataclass(frozen=True, eq=False)
class CurveCase:
    """The smooth curve of a step before the referee.

    Attributes
    ----------
    case : StepCase
        The step of the polyline.
    kind : str
    splines : list
        (piece, spline at the start, spline at the end) of each piece with an edge.
    """

    case: StepCase
    kind: str
    splines: list[tuple[Piece, Spline, Spline]]

    @classmethod
    def of(cls, case: StepCase, kind: str) -> "CurveCase":
        """Return the curve of a kind along the path of a step."""
        x0, x1 = case.path.ends
        splines = []
        for piece in case.pieces:
            if len(piece.vertices) > 1:
                start, end = (spline_of(x[piece.vertices], piece.is_closed, kind) for x in (x0, x1))
                splines.append((piece, start, end))
        return cls(case, kind, splines)

    def gap(
        self, t: float, edges: tuple[Edge, Edge], parameters: tuple[float, float], image: tuple[int, int, int]
    ) -> tuple[float, float]:
        """Return how far apart two places of the curve are at a time, Å, and which way they would pass.

        Parameters
        ----------
        t : float
        edges : two edges
            With which the segments go.
        parameters : two floats
            Where on them.
        image : three ints
            Of the second, as results files say it.

        Returns
        -------
        gap : float
        turn : float
            (A - B)_t · (A' x B'), over the lengths of the three; its sign is that of the passage.
        """
        (a, moves_a, along_a), (b, moves_b, along_b) = (
            self._place(t, edge, u) for edge, u in zip(edges, parameters, strict=True)
        )
        path = self.case.path
        if path.cells is not None:
            counts = np.array(image) + path.counts0[edges[0][0]] - path.counts0[edges[1][0]]
            b = b + (1.0 - t) * counts @ path.cells[0] + t * counts @ path.cells[1]
            moves_b = moves_b + counts @ (path.cells[1] - path.cells[0])
        drift, sizes = moves_a - moves_b, np.linalg.norm([moves_a - moves_b, along_a, along_b], axis=1)
        turn = float(drift @ np.cross(along_a, along_b)) / max(float(sizes.prod()), 1e-300)
        return float(np.linalg.norm(a - b)), turn

    def _place(self, t: float, edge: Edge, u: float) -> tuple[Points, Points, Points]:
        """Return point, motion within the step and tangent."""
        for piece, start, end in self.splines:
            k = np.flatnonzero((piece.edges == edge).all(axis=1))
            if len(k):
                at = float(k[0]) + u
                p0, p1 = start(at), end(at)
                return (1.0 - t) * p0 + t * p1, p1 - p0, (1.0 - t) * start(at, 1) + t * end(at, 1)
        raise LookupError(edge)

    def least_distance(self, reach: float) -> float | None:
        """Return the least sampled distance of segments that share no vertex; infinite where none comes within reach.

        None where images cannot be counted, or the curve has not one segment for each edge.
        """
        if self.kind == "bezier":
            return None
        u = np.linspace(0.0, 1.0, PARAMETERS)
        samples: tuple[list[Points], list[Points]] = ([], [])
        for piece, start, end in self.splines:
            grid = np.arange(len(piece.edges))[:, np.newaxis] + u
            samples[0].append(start(grid))
            samples[1].append(end(grid))
        ends = [np.concatenate(points) for points in samples]
        edges, path = self.case.edges, self.case.path
        stray = max(_stray(points, x[edges]) for points, x in zip(ends, path.ends, strict=True))
        pairs = near_pairs(path, edges, reach + 2.0 * stray)
        if pairs is None:
            return None
        least = np.inf
        for t in np.linspace(0.0, 1.0, TIMES):
            points = (1.0 - t) * ends[0] + t * ends[1]
            shift = np.zeros((len(pairs), 3))
            if path.cells is not None:
                shift = pairs.image @ ((1.0 - t) * path.cells[0] + t * path.cells[1])
            for first in range(0, len(pairs), MOST_TOGETHER):
                rows = slice(first, first + MOST_TOGETHER)
                one, other = points[pairs.first[rows]], points[pairs.second[rows]] + shift[rows, np.newaxis]
                apart = np.linalg.norm(one[:, :, np.newaxis] - other[:, np.newaxis], axis=3)
                least = min(least, float(apart.min(initial=np.inf)))
        return least


def _stray(points: Points, edges: Points) -> float:
    """Return how far the samples of a segment lie from the matching points of its edge at most, Å.

    Parameters
    ----------
    points : ndarray, shape (m, k, 3)
        Samples of each segment.
    edges : ndarray, shape (m, 2, 3)
        Both ends of the edge that it goes with.
    """
    share = np.linspace(0.0, 1.0, PARAMETERS)[:, np.newaxis]
    chord = (1.0 - share) * edges[:, :1] + share * edges[:, 1:]
    return float(np.linalg.norm(points - chord, axis=2).max(initial=0.0))
