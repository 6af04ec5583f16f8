"""A smooth curve: Bezier segments that follow each other, open or closed, any number of strands."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdtopo.errors import InputError
from mdtopo.typing import BezierPoints, Flags, Indices, Points, Ratios


@dataclass(frozen=True, eq=False)
class CompositeBezier:
    """Bezier segments of one degree that follow each other along strands.

    Attributes
    ----------
    control_points : ndarray, shape (m, degree + 1, 3)
        Of each segment, Å; consecutive segments of a strand share their end point. In the plane z is 0.
    offsets : ndarray of int, shape (n_strands + 1,)
        Strand s has the segments ``offsets[s]`` … ``offsets[s + 1] - 1``, in order.
    closed : ndarray of bool, shape (n_strands,)
        Whether the last segment ends where the first begins.
    dimension : int
        2 or 3: whether the curve was given in the plane.
    error : float
        How far a control point may lie from the exact one, Å; 0 where the control points are what is meant.

    Raises
    ------
    InputError
        If a shape does not fit, a value is not finite, or consecutive segments do not meet.
    """

    control_points: BezierPoints
    offsets: Indices
    closed: Flags
    dimension: int = 3
    error: float = 0.0

    def __post_init__(self) -> None:
        points = self.control_points
        if points.ndim != 3 or points.shape[2] != 3 or points.shape[1] < 2 or not len(points):
            raise InputError(
                f"Control points have shape {points.shape}; (segments, degree + 1, 3), degree 1 or more, is needed."
            )
        if not np.isfinite(points).all():
            segment = int(np.flatnonzero(~np.isfinite(points).all(axis=(1, 2)))[0])
            raise InputError(f"Segment {segment} has a control point that is not finite.")
        if self.offsets[0] != 0 or self.offsets[-1] != len(points) or (np.diff(self.offsets) < 1).any():
            raise InputError(
                f"Segment offsets {self.offsets.tolist()} do not part {len(points)} segments into strands."
            )
        follows = self.following
        here = np.flatnonzero(follows >= 0)
        apart = (points[here, -1] != points[follows[here], 0]).any(axis=1)
        if apart.any():
            one = int(here[apart][0])
            raise InputError(
                f"Segment {one} ends at {points[one, -1].tolist()}, and segment {follows[one]}, which follows, begins "
                f"at {points[follows[one], 0].tolist()}; they must share that point exactly."
            )

    @classmethod
    def from_control_points(
        cls,
        points: BezierPoints,
        *,
        closed: bool | Sequence[bool] = False,
        lengths: Sequence[int] | None = None,
    ) -> "CompositeBezier":
        """Return the curve of given control points.

        Parameters
        ----------
        points : array, shape (m, degree + 1, 2) or (m, degree + 1, 3)
            Control points of each segment, Å. A single segment may come without its first axis.
        closed : bool or sequence of bool
            Whether the strands are closed: one answer for all, or one for each.
        lengths : sequence of int, optional
            Number of segments of each strand; by default all are one strand.

        Examples
        --------
        >>> arc = CompositeBezier.from_control_points(np.array([[0, 0], [1, 2], [2, 0]]))
        >>> arc.points([0.5]).tolist()
        [[[1.0, 1.0, 0.0]]]
        """
        array = np.ascontiguousarray(points, dtype=np.float64)
        if array.ndim == 2:
            array = array[np.newaxis]
        if array.ndim != 3 or array.shape[2] not in (2, 3):
            raise InputError(f"Control points have shape {array.shape}; (segments, degree + 1, 2 or 3) is needed.")
        dimension = array.shape[2]
        if dimension == 2:
            array = np.concatenate([array, np.zeros((*array.shape[:2], 1))], axis=2)
        offsets = np.concatenate([[0], np.cumsum(np.asarray(lengths or [len(array)], dtype=np.int64))])
        rings = np.broadcast_to(np.asarray(closed, dtype=np.bool_), (len(offsets) - 1,)).copy()
        return cls(np.ascontiguousarray(array), offsets, rings, dimension)

    @property
    def degree(self) -> int:
        """Degree of the segments."""
        return int(self.control_points.shape[1]) - 1

    @property
    def n_segments(self) -> int:
        """Number of segments of all strands together."""
        return len(self.control_points)

    @cached_property
    def strand_of_segment(self) -> Indices:
        """The strand of each segment, shape (m,)."""
        return np.repeat(np.arange(len(self.closed), dtype=np.int64), np.diff(self.offsets))

    @cached_property
    def following(self) -> Indices:
        """The segment that follows each one, shape (m,); -1 at an open end, itself in a ring of one."""
        follows = np.arange(1, self.offsets[-1] + 1, dtype=np.int64)
        follows[self.offsets[1:] - 1] = np.where(self.closed, self.offsets[:-1], -1)
        return follows

    def points(self, u: Ratios | Sequence[float]) -> Points:
        """Return the points of every segment at parameters u from 0 to 1, shape (m, len(u), 3), Å."""
        parameters = np.asarray(u, dtype=np.float64)
        from mdtopo.geometry.bezier import evaluate  # compiled: numba is not for who only wants the records

        return np.stack([evaluate(segment, parameters) for segment in self.control_points])
