"""The smooth curve of a frame as a polyline that is isotopic to it, where that is proved."""

from dataclasses import dataclass

import numpy as np

from mdtopo.approximation import approximate
from mdtopo.errors import InputError
from mdtopo.records import Isotopy, Strands, Traces
from mdtopo.records.strands import CLOSED_MINIMUM
from mdtopo.smooth import CurveKind, spline_curve
from mdtopo.typing import Flags, Indices, Lengths, Points, Ratios


@dataclass(frozen=True, slots=True, eq=False)
class CurveSnapshot:
    """The polyline of the curve at one time.

    Attributes
    ----------
    title : str
        Which frame, in words.
    time : float
        ps; NaN where the trajectory holds none.
    positions : ndarray, shape (n, 3)
        Points on the curve, Å; their number differs from frame to frame.
    offsets : ndarray of int, shape (n_traces + 1,)
        Trace g has the points ``offsets[g]`` … ``offsets[g + 1] - 1``.
    closed : ndarray of bool, shape (n_traces,)
        Whether the last point is joined to the first.
    strand : ndarray of int, shape (n,)
        The strand of each point.
    parameter : ndarray, shape (n,)
        Where on its trace each point lies, from 0 to 1; a spline gives every edge an equal share.
    chord_error : float
        The curve is at most so far from the polyline, Å.
    is_isotopic : bool
        Whether the polyline is proved to be ambient isotopic to the curve, all traces together; False: not known.
    reason : str
        By which argument, or what it lacks.
    polyline_clearance : ndarray, shape (n,)
        How close the straight edges come to any other in the step that begins there, at least, Å: the lower value of
        the two vertices between which the point's parameter lies; NaN where it has none.
    """

    title: str
    time: float
    positions: Points
    offsets: Indices
    closed: Flags
    strand: Indices
    parameter: Ratios
    chord_error: float
    is_isotopic: bool
    reason: str
    polyline_clearance: Lengths


def curve_snapshot(
    positions: Points,
    strands: Strands,
    traces: Traces,
    kind: CurveKind,
    tolerance: float,
    *,
    title: str,
    time: float,
    polyline_clearance: Lengths,
) -> CurveSnapshot:
    """Return the polyline of the curve of one frame.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        Whole strands, Å.
    strands, traces : Strands, Traces
        The strands, and what is left of them without broken edges. A vertex without an edge has no curve.
    kind : str
        See `spline_curve`.
    tolerance : float
        How far the curve may be from the polyline, Å.
    title, time
        See `CurveSnapshot`.
    polyline_clearance : ndarray, shape (n_vertices,)
        Of each vertex of the strands; see `mdtopo.export.Snapshot`.

    Guarantee
    ---------
    `chord_error` and `is_isotopic` are proven, see `approximate`: for the curve in the cell as written. Images of it in
    other cells are not looked at.

    Raises
    ------
    InputError
        If the frame has no curve, because consecutive vertices coincide or every edge is broken, or the tolerance is
        too small.
    """
    sizes = np.diff(traces.offsets)
    kept = sizes > 1
    if not kept.any():
        raise InputError(f"The strands of {title} have no curve: every edge is broken.")
    pieces = Strands.from_lengths(sizes[kept].tolist(), closed=traces.closed[kept].tolist())
    vertices = traces.vertices[np.repeat(kept, sizes)]
    try:
        found = approximate(spline_curve(positions[vertices], pieces, kind), tolerance)
    except InputError as error:
        raise InputError(f"The curve of {title} cannot be exported. {error}") from error
    lengths = np.diff(found.offsets) - pieces.closed  # a ring's last point is its first
    if (few := pieces.closed & (lengths < CLOSED_MINIMUM)).any():
        raise InputError(
            f"A tolerance of {tolerance:g} Å leaves {int(lengths[few][0])} points of a ring in {title}; choose a "
            "smaller one."
        )
    chosen = np.ones(len(found.points), dtype=np.bool_)
    chosen[found.offsets[1:][pieces.closed] - 1] = False
    strand = strands.strand_of_vertex[vertices[pieces.offsets[:-1]]]
    parameters, owner = found.parameters[chosen], np.repeat(np.arange(len(lengths)), lengths)
    return CurveSnapshot(
        title=title,
        time=time,
        positions=found.points[chosen],
        offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        closed=pieces.closed,
        strand=np.repeat(strand, lengths),
        parameter=parameters,
        chord_error=found.chord_error,
        is_isotopic=found.isotopy is Isotopy.TUBE,
        reason=found.reason,
        polyline_clearance=_between_vertices(polyline_clearance[vertices], pieces, owner, parameters),
    )


def _between_vertices(values: Lengths, pieces: Strands, owner: Indices, parameters: Ratios) -> Lengths:
    """Return for each point the lower value of the two vertices between which it lies; an edge has an equal share."""
    sizes = np.diff(pieces.offsets)[owner]
    place = parameters * (sizes - ~pieces.closed[owner])
    before = np.minimum(np.floor(place), sizes - 1).astype(np.int64)
    after = np.ceil(place).astype(np.int64) % sizes
    first = pieces.offsets[owner]
    lower: Lengths = np.fmin(values[first + before], values[first + after])
    return lower
