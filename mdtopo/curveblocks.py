"""The smooth curve over the steps of a block: one kernel call for all of them, beside that of the polyline.

The control points are linear in the vertices, with the same weights in every frame. So the motion that the step of the
polyline certifies, with one rigid motion taken out and strands placed beside where they were, moves them linearly too.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.blocks import WholeFrames, motion_of
from mdtopo.curveladder import FOUND_WIDTH, measure_curve
from mdtopo.curves import greatest_magnitude
from mdtopo.geometry.splines import (
    AMPLIFICATION,
    BSPLINE,
    CATMULL_ROM,
    CONTROL_ERROR,
    INTERPOLATING,
    RING_PARTS,
    single_controls,
    single_error,
    spline_controls,
)
from mdtopo.records import Rung, Traces
from mdtopo.spheres import PLACING_ERROR

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BROAD_PHASE = int(Rung.BROAD_PHASE)

SINGLE = 3
"""One Bezier curve for each strand, beside the kinds of `mdtopo.geometry.splines`."""

KINDS = {"interpolating": INTERPOLATING, "bspline": BSPLINE, "catmull-rom": CATMULL_ROM, "bezier": SINGLE}


class Segments(NamedTuple):
    """The segments of a smooth curve through traces, and where on the traces they lie.

    Attributes
    ----------
    kind, degree : int
    following : ndarray of int, shape (m,)
        The segment that follows each one; -1 at an open end.
    edge, ends : ndarray of int, shape (m,) and (m, 2)
        The first edge of the trace that a segment goes along, and the vertices that name it.
    low, width : ndarray, shape (m,)
        Where it begins, counted in edges from there, and how many edges long it is.
    error, amplification : float
        Rounding of a control point over the greatest coordinate, and how an error of the vertices grows.
    """

    kind: int
    degree: int
    following: IntArray
    edge: IntArray
    ends: IntArray
    low: FloatArray
    width: FloatArray
    error: float
    amplification: float

    @classmethod
    def of(cls, traces: Traces, name: str) -> "Segments":
        """Return the segments of a kind of curve: one for each edge, or one for each trace (of a ring four parts)."""
        kind, m = KINDS[name], len(traces.edges)
        if kind != SINGLE:
            ones = np.ones(m)
            edge, error = np.arange(m, dtype=np.int64), CONTROL_ERROR
            return cls(kind, 3, traces.following, edge, traces.edges, 0.0 * ones, ones, error, AMPLIFICATION[kind])
        return _single_segments(traces)

    def place(self, segment: int, u: float) -> tuple[int, float]:
        """Return the edge that a point of the curve goes with, and where along it; by equal shares of the parameter."""
        along = self.low[segment] + u * self.width[segment]
        last = max(np.ceil(self.low[segment] + self.width[segment]) - 1.0, 0.0)
        whole = min(np.floor(along), last)
        return int(self.edge[segment] + whole), float(min(along - whole, 1.0))


def _single_segments(traces: Traces) -> Segments:
    lengths = np.diff(traces.offsets)
    following: list[int] = []
    edge: list[int] = []
    ends: list[tuple[int, int]] = []
    low: list[float] = []
    width: list[float] = []
    first_edge = 0
    for g, (n, ring) in enumerate(zip(lengths.tolist(), traces.closed.tolist(), strict=True)):
        n_edges, parts = (n if ring else n - 1), (RING_PARTS if ring else 1)
        if n_edges < 1:
            continue
        first = len(following)
        tail, head = traces.vertices[traces.offsets[g]], traces.vertices[traces.offsets[g + 1] - 1]
        for p in range(parts):
            following.append(first + p + 1 if p + 1 < parts else (first if ring else -1))
            edge.append(first_edge)
            ends.append((int(tail), int(head)))
            low.append(p * n_edges / parts)
            width.append(n_edges / parts)
        first_edge += n_edges
    points = (lengths + traces.closed)[lengths > 1]
    return Segments(
        SINGLE,
        int(points.max(initial=2)) - 1,
        np.array(following, dtype=np.int64),
        np.array(edge, dtype=np.int64),
        np.array(ends, dtype=np.int64).reshape(-1, 2),
        np.array(low),
        np.array(width),
        single_error(lengths, traces.closed),
        1.0,
    )


class CurveColumns(NamedTuple):
    """What the kernel writes of the curve, one row per step; segments by their numbers. `n_open` is -1 before."""

    d_star: FloatArray
    d_star_segment: IntArray
    bezier_ratio: FloatArray
    bezier_margin: FloatArray
    printed_ratio: FloatArray
    clearance: FloatArray
    pair: IntArray
    rung: IntArray
    depth: IntArray
    n_open: IntArray
    place: FloatArray
    countable: BoolArray

    @classmethod
    def empty(cls, n: int) -> "CurveColumns":
        """Return columns for n steps, of which none has been measured."""

        def number(*shape: int) -> FloatArray:
            """Return a column of numbers, none known."""
            return np.full((n, *shape), np.nan)

        def index(*shape: int) -> IntArray:
            """Return a column of indices or counts, none known."""
            return np.full((n, *shape), -1, dtype=np.int64)

        return cls(
            d_star=number(),
            d_star_segment=index(),
            bezier_ratio=number(),
            bezier_margin=number(),
            printed_ratio=number(),
            clearance=number(),
            pair=index(2),
            rung=np.full(n, Rung.OPEN, dtype=np.int64),
            depth=index(),
            n_open=index(),
            place=number(6),
            countable=np.ones(n, dtype=np.bool_),
        )


@njit(cache=True, nogil=True)
def control_points(
    x: FloatArray,
    vertices: IntArray,
    offsets: IntArray,
    closed: BoolArray,
    kind: int,
    n_segments: int,
    degree: int,
) -> FloatArray:
    """Return the control points of the curve of one frame, shape (n_segments, degree + 1, 3), Å."""
    out = np.empty((n_segments, degree + 1, 3))
    if kind == SINGLE:
        single_controls(x, vertices, offsets, closed, out)
    else:
        spline_controls(x, vertices, offsets, closed, kind, out)
    return out


@njit(cache=True, nogil=True)
def curve_slack(
    x0: FloatArray, x1: FloatArray, placing: float, periodic: bool, error: float, amplification: float
) -> float:
    """Return how far a control point may be off, Å: by its own rounding, and by that of vertices placed in a cell."""
    greatest = max(greatest_magnitude(x0), greatest_magnitude(x1))
    slack = error * greatest
    if periodic:  # without a cell, the vertices are what is certified, and exact
        slack += amplification * PLACING_ERROR * (greatest + placing)
    return slack


@njit(cache=True, nogil=True)
def measure_curves(
    frames: WholeFrames,
    measurable: BoolArray,
    periodic: bool,
    rigid: bool,
    rotations: FloatArray,
    vertices: IntArray,
    offsets: IntArray,
    closed: BoolArray,
    following: IntArray,
    kind: int,
    degree: int,
    error: float,
    amplification: float,
    out: CurveColumns,
) -> tuple[IntArray, FloatArray]:
    """Measure the curve in each step that can be measured, and write its row; other rows stay as they are.

    Returns
    -------
    starts : ndarray of int, shape (n_steps + 1,)
        Where the passages of each step begin.
    found : ndarray, shape (k, 11)
        Those of all steps, one after the other; see `mdtopo.curveladder.CurveMeasure`.
    """
    starts = np.zeros(len(measurable) + 1, dtype=np.int64)
    found, m = np.empty((0, FOUND_WIDTH)), len(following)
    for k in range(len(measurable)):
        starts[k + 1] = starts[k]
        if not measurable[k]:
            continue
        if m == 0:  # single vertices have no curve
            out.rung[k], out.depth[k], out.n_open[k] = BROAD_PHASE, 0, 0
            continue
        motion = motion_of(frames, k, periodic, rigid, rotations[k], vertices, offsets)
        slack = curve_slack(motion.x0, motion.x1, motion.placing, periodic, error, amplification)
        c0 = control_points(motion.x0, vertices, offsets, closed, kind, m, degree)
        c1 = control_points(motion.x1, vertices, offsets, closed, kind, m, degree)
        curve = measure_curve(c0, c1, following, motion.cell0, motion.cell1, periodic, slack)
        out.d_star[k], out.d_star_segment[k] = curve.d_star, curve.d_star_segment
        out.bezier_ratio[k], out.bezier_margin[k] = curve.bezier_ratio, curve.bezier_margin
        out.printed_ratio[k], out.clearance[k] = curve.printed_ratio, curve.clearance
        out.rung[k], out.depth[k], out.n_open[k] = curve.rung, curve.depth, curve.n_open
        out.pair[k, :], out.place[k, :] = curve.pair, curve.place
        out.countable[k] = curve.countable
        if len(curve.found) > 0:
            found = np.concatenate((found, curve.found))
            starts[k + 1] = len(found)
    return starts, found
