"""What an approximation must know of one strand of a smooth curve, whichever way the curve is given."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mdtopo.geometry.chords import arc_chords, strand_points
from mdtopo.records import CompositeBezier, ParametricCurve
from mdtopo.typing import BezierPoints, Flags, Lengths, Points

FIRST_PANELS = 16
"""Panels to begin with on a curve that is known by functions; they are halved where |c''| needs it."""

CHORD_PARTS = 8
"""Parts of a chord at whose ends the distance of such a curve is measured."""

SMOOTH = 1e-9
"""Segments that follow each other smoothly have tangents within this angle: more than rounding, less than a corner."""

Parameters = NDArray[np.float64]


class Arc(Protocol):
    """One strand, by a parameter from `edges[0]` to `edges[-1]`."""

    @property
    def edges(self) -> Parameters:
        """Where |c''| may jump, and both ends."""

    @property
    def corners(self) -> Parameters:
        """Where the tangent jumps, so that a vertex must lie there."""

    def bend_lengths(self, t: Parameters) -> Lengths:
        """Return |c''|, shape (n,)."""

    def points(self, t: Parameters) -> Points:
        """Return c, shape (n, 3), Å."""

    def chords(self, t: Parameters) -> tuple[Lengths, Flags]:
        """Return how far the arc of each chord is from it, Å, and whether its tangents make acute angles with it."""


@dataclass(frozen=True, slots=True)
class SampledArc:
    """A parametric curve; what is said of its chords comes from samples."""

    curve: ParametricCurve

    @property
    def edges(self) -> Parameters:
        """See `Arc`."""
        return np.linspace(0.0, 1.0, FIRST_PANELS + 1)

    @property
    def corners(self) -> Parameters:
        """See `Arc`; a C² curve has none."""
        return np.empty(0)

    def bend_lengths(self, t: Parameters) -> Lengths:
        """See `Arc`."""
        return np.array([np.linalg.norm(self.curve.bend(float(u))) for u in t])

    def points(self, t: Parameters) -> Points:
        """See `Arc`."""
        return self.curve.points(t)

    def chords(self, t: Parameters) -> tuple[Lengths, Flags]:
        """See `Arc`; tangents count as acute only where a first derivative was given."""
        a, b = self.curve.points(t[:-1]), self.curve.points(t[1:])
        greatest, along = np.zeros(len(a)), np.full(len(a), self.curve.first_derivative is not None)
        for part in range(CHORD_PARTS + 1):
            share = part / CHORD_PARTS
            where = np.clip((1.0 - share) * t[:-1] + share * t[1:], 0.0, 1.0)
            greatest = np.maximum(greatest, distances(self.curve.points(where), a, b))
            if self.curve.first_derivative is not None:
                tangents = np.stack([self.curve.velocity(float(u)) for u in where])
                along &= np.einsum("ij,ij->i", tangents, b - a) > 0.0
        return greatest, along


@dataclass(frozen=True, slots=True)
class BezierArc:
    """One strand of Bezier segments; what is said of its chords is proven. The parameter is segment + u."""

    segments: BezierPoints
    bends: BezierPoints

    @classmethod
    def of(cls, curve: CompositeBezier, strand: int) -> "BezierArc":
        """Return one strand of a curve."""
        segments = np.ascontiguousarray(curve.control_points[curve.offsets[strand] : curve.offsets[strand + 1]])
        n = curve.degree
        bends = n * (n - 1) * np.diff(segments, n=2, axis=1) if n > 1 else np.zeros((len(segments), 1, 3))
        return cls(segments, bends)

    @property
    def edges(self) -> Parameters:
        """See `Arc`: the joints."""
        return np.arange(len(self.segments) + 1, dtype=np.float64)

    @property
    def corners(self) -> Parameters:
        """See `Arc`."""
        last, first = (
            self.segments[:-1, -1] - self.segments[:-1, -2],
            self.segments[1:, 1] - self.segments[1:, 0],
        )
        sizes = np.linalg.norm(last, axis=1) * np.linalg.norm(first, axis=1)
        turned = np.linalg.norm(np.cross(last, first), axis=1) > SMOOTH * sizes
        return 1.0 + np.flatnonzero(turned | ~(np.einsum("ij,ij->i", last, first) > 0.0)).astype(np.float64)

    def bend_lengths(self, t: Parameters) -> Lengths:
        """See `Arc`."""
        segment = np.minimum(t.astype(np.int64), len(self.segments) - 1)
        row, u = self.bends[segment], (t - segment)[:, None, None]
        while row.shape[1] > 1:
            row = (1.0 - u) * row[:, :-1] + u * row[:, 1:]
        lengths: Lengths = np.linalg.norm(row[:, 0], axis=1)
        return lengths

    def points(self, t: Parameters) -> Points:
        """See `Arc`."""
        found: Points = strand_points(self.segments, t)
        return found

    def chords(self, t: Parameters) -> tuple[Lengths, Flags]:
        """See `Arc`."""
        bounds, along = arc_chords(self.segments, t, float(np.abs(self.segments).max()))
        return bounds, along


def distances(p: Points, a: Points, b: Points) -> Lengths:
    """Return the distance of each point from the straight piece (a, b), Å."""
    along = b - a
    squared = np.einsum("ij,ij->i", along, along)
    where = np.einsum("ij,ij->i", p - a, along) / np.where(squared > 0.0, squared, 1.0)
    apart: Lengths = np.linalg.norm(p - a - np.clip(where, 0.0, 1.0)[:, None] * along, axis=1)
    return apart
