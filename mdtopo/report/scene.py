"""The strands around an event, along the motion that was certified: what the 3D view and the static picture show."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.blocks import covariances, motion_of, whole_frames
from mdtopo.curves import StepMotion
from mdtopo.errors import MdtopoError
from mdtopo.geometry.rigid import best_rotations
from mdtopo.records import BrokenEdge, Frame, MonitorConfig, Strands, Traces
from mdtopo.report.overlay import CurvePath, arc_places, places, trace_curves
from mdtopo.smooth import CurveKind
from mdtopo.typing import Indices, Points

MOST_VERTICES = 600
"""Vertices of a view, the nearest first: more make the page heavy and the view a ball of wool."""

NEAR_PARTS, FAR_PARTS = 10, 4
"""Chords by which the smooth curve of an edge is drawn, within the first view and beyond it."""

ARC_PARTS = 24
"""Chords of an arc that is marked; the place that the event is about is one of their ends."""

N_INSTANTS = 201
IMAGES = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A run of consecutive vertices of one strand: positions at both ends of the step, relative to the centre, Å."""

    strand: str
    labels: tuple[str, ...]
    x0: Points
    x1: Points


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The surroundings of an event.

    Attributes
    ----------
    pieces : tuple of Piece
        The strands, straight edges.
    marked : tuple of (x0, x1)
        The marked edges at both ends of the step, each of shape (2, 3), Å; where an event is about the smooth curve,
        the arcs that go with them, of more points.
    t : float
        When the view opens: at the crossing, or where the pair is nearest.
    distance : float
        Distance of the pair then, or the length of a single edge, Å.
    eye : ndarray, shape (3,)
        Unit vector towards the viewer; across both edges.
    radius : float
        Half the width of the first view, Å.
    curves : tuple of CurvePath
        The smooth curve along the pieces of the marked strands; of all strands they would hide the pair.
    no_curve : str
        Why a strand has none, in one sentence; empty where all have one.
    own_type : str
        Whether the curve of the event's strands has their own type, in words; empty where nobody looked.
    """

    pieces: tuple[Piece, ...]
    marked: tuple[tuple[Points, Points], ...]
    t: float
    distance: float
    eye: NDArray[np.float64]
    radius: float
    curves: tuple[CurvePath, ...] = ()
    no_curve: str = ""
    own_type: str = ""


def step_path(
    frames: tuple[Frame, Frame], strands: Strands, broken: Collection[BrokenEdge], config: MonitorConfig, periodic: bool
) -> tuple[StepMotion, Traces] | None:
    """Return the linear motion of a step as the ladder has seen it, and its traces; None where a frame is unusable."""
    if any(frame.problem or (frame.cell is not None) != periodic for frame in frames):
        return None
    lost = {edge.edge for edge in broken if edge.frame <= frames[0].index}
    indices = [k for k, edge in enumerate(map(tuple, strands.edges.tolist())) if edge in lost] if lost else []
    t, yes = Traces.of(strands, indices), np.ones(2, dtype=np.bool_)
    cells = (
        np.zeros((2, 3, 3)) if not periodic else np.stack([frame.cell for frame in frames if frame.cell is not None])
    )
    positions = np.stack([frame.positions for frame in frames])
    whole = whole_frames(positions, cells, yes, periodic, t.vertices, t.offsets, t.closed, t.edges)
    rotation, rigid = np.eye(3), config.motion == "rigid"
    if rigid:
        groups = t.offsets if periodic else np.array([0, len(t.vertices)], dtype=np.int64)
        rotation = best_rotations(*covariances(whole.positions, yes[:1], t.vertices, groups))[0]
    return motion_of(whole, 0, periodic, rigid, rotation, t.vertices, t.offsets), t


def event_scene(
    motion: StepMotion,
    traces: Traces,
    strands: Strands,
    edges: tuple[tuple[int, int], ...],
    t: float | None,
    kind: CurveKind = "interpolating",
    on_curve: tuple[float, ...] | None = None,
) -> Scene:
    """Return the surroundings of the marked edges.

    Parameters
    ----------
    motion, traces
        As `step_path` returns them.
    strands : Strands
    edges : tuple of tuple of int
        One or two edges.
    t : float or None
        When the view opens; by default where the pair is nearest.
    kind : str
        Which smooth curve is drawn beside the edges.
    on_curve : tuple of float, optional
        Where the event is about the smooth curve: the place on each arc, from 0 to 1, that the event is about. The arcs
        are marked then.

    Raises
    ------
    InputError, StrandError
        If an event about the curve is of strands that have none.
    """
    images = [np.zeros(3, dtype=np.int64)]
    if len(edges) == 2:
        images.append(_nearest_image(motion, edges))
    marked = [_placed(motion, list(edge), image) for edge, image in zip(edges, images, strict=True)]
    if on_curve is not None:
        held = zip(edges, images, on_curve, strict=True)
        marked = [_arc(motion, traces, edge, image, share, kind) for edge, image, share in held]
    instants = np.linspace(0.0, 1.0, N_INSTANTS)
    if t is None:
        t = float(instants[np.argmin([_spread(marked, instant) for instant in instants])]) if len(marked) == 2 else 0.5
    now = [(1.0 - t) * x0 + t * x1 for x0, x1 in marked]
    centre = np.mean(np.concatenate(now), axis=0)
    span = max(float(np.linalg.norm(x - centre, axis=1).max()) for x in now)
    bodies = _bodies(motion, traces, centre, t, [list(edge) for edge in edges], images)
    curves, no_curve = _curves(motion, strands, bodies, centre, 4.0 * span, t, kind)
    return Scene(
        tuple(_pieces(motion, strands, bodies, centre)),
        tuple((x0 - centre, x1 - centre) for x0, x1 in marked),
        t,
        _spread(marked, t),
        _eye(now),
        4.0 * span,
        tuple(curves),
        no_curve,
    )


def _placed(motion: StepMotion, vertices: list[int], image: Indices) -> tuple[Points, Points]:
    return motion.x0[vertices] + image @ motion.cell0, motion.x1[vertices] + image @ motion.cell1


def _arc(
    motion: StepMotion, traces: Traces, edge: tuple[int, int], image: Indices, share: float, kind: CurveKind
) -> tuple[Points, Points]:
    """Return the arc of the smooth curve that goes with an edge, at both ends of the step."""
    at = int(np.flatnonzero(traces.vertices == edge[0])[0])
    g = int(np.searchsorted(traces.offsets, at, side="right")) - 1
    first, stop, closed = int(traces.offsets[g]), int(traces.offsets[g + 1]), bool(traces.closed[g])
    curves = trace_curves(*_placed(motion, traces.vertices[first:stop].tolist(), image), closed=closed, kind=kind)
    shares = np.unique(np.append(np.linspace(0.0, 1.0, ARC_PARTS + 1), share))
    x0, x1 = (arc_places(curve, stop - first - (not closed), at - first, shares) for curve in curves)
    return x0, x1


def _nearest_image(motion: StepMotion, edges: tuple[tuple[int, int], ...]) -> Indices:
    """Return the lattice counts that bring the second edge nearest to the first during the step."""
    if not motion.cell0.any():
        return np.zeros(3, dtype=np.int64)
    first, second = list(edges[0]), list(edges[1])
    apart = motion.x0[first].mean(axis=0) - motion.x0[second].mean(axis=0)
    base = np.rint(apart @ np.linalg.inv(motion.cell0)).astype(np.int64)
    one = _placed(motion, first, np.zeros(3, dtype=np.int64))
    best = min(
        (base + shift for shift in IMAGES),
        key=lambda image: min(
            _spread([one, _placed(motion, second, image)], instant) for instant in np.linspace(0.0, 1.0, 21)
        ),
    )
    return np.asarray(best, dtype=np.int64)


def _spread(marked: list[tuple[Points, Points]], t: float) -> float:
    """Return the distance of two edges or arcs at time t, or the length of one."""
    now = [(1.0 - t) * x0 + t * x1 for x0, x1 in marked]
    return path_length(now[0]) if len(now) == 1 else path_distance(now[0], now[1])


def path_length(x: Points) -> float:
    """Return the length of a path of straight pieces, Å."""
    return float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())


def path_distance(p: Points, q: Points) -> float:
    """Return the distance of two paths of straight pieces, Å, near their nearest points; for the eye.

    Examples
    --------
    >>> path_distance(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0.5, 1.0, 2.0], [0.5, -1.0, 2.0]]))
    2.0
    """
    i, j = np.unravel_index(np.argmin(np.linalg.norm(p[:, None] - q[None], axis=2)), (len(p), len(q)))
    firsts = [p[k : k + 2] for k in (i - 1, i) if 0 <= k < len(p) - 1]
    seconds = [q[k : k + 2] for k in (j - 1, j) if 0 <= k < len(q) - 1]
    return min(segment_distance(one, other) for one in firsts for other in seconds)


def segment_distance(p: Points, q: Points) -> float:
    """Return the distance of two segments, each of shape (2, 3), Å; for the eye, not for a certificate.

    Examples
    --------
    >>> segment_distance(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[0.5, 1.0, 2.0], [0.5, -1.0, 2.0]]))
    2.0
    """
    d1, d2, r = p[1] - p[0], q[1] - q[0], p[0] - q[0]
    a, e, f, c, b = d1 @ d1, d2 @ d2, d2 @ r, d1 @ r, d1 @ d2
    denominator = a * e - b * b
    candidates = []
    if denominator > 1e-12 * max(a * e, 1e-300):
        s = np.clip((b * f - c * e) / denominator, 0.0, 1.0)
        u = np.clip((b * s + f) / e, 0.0, 1.0)
        candidates.append((np.clip((b * u - c) / a, 0.0, 1.0), u))
    for s in (0.0, 1.0):
        candidates.append((s, np.clip((b * s + f) / e, 0.0, 1.0) if e else 0.0))
    for u in (0.0, 1.0):
        candidates.append((np.clip((b * u - c) / a, 0.0, 1.0) if a else 0.0, u))
    return float(min(np.linalg.norm(r + s * d1 - u * d2) for s, u in candidates))


def _eye(now: list[Points]) -> NDArray[np.float64]:
    """Return the direction to look from: across both edges, so that they form an X, a little from the side."""
    d1 = now[0][-1] - now[0][0]
    d2 = now[1][-1] - now[1][0] if len(now) == 2 else now[0][1] - now[0][0]  # of one arc: onto the plane of its bend
    across = np.cross(d1, d2)
    if np.linalg.norm(across) < 1e-3 * (np.linalg.norm(d1) * np.linalg.norm(d2) + 1e-12):
        across = np.cross(d1, np.eye(3)[np.argmin(np.abs(d1))])
    across = across / max(float(np.linalg.norm(across)), 1e-12)
    tilted = across + 0.3 * d1 / max(float(np.linalg.norm(d1)), 1e-12)
    return np.asarray(tilted / max(float(np.linalg.norm(tilted)), 1e-12))


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """A trace in one image, the runs of its vertices near the centre, as positions in it, and whether it is marked."""

    vertices: Indices
    image: Indices
    closed: bool
    runs: tuple[Indices, ...]
    marked: bool


def _bodies(
    motion: StepMotion,
    traces: Traces,
    centre: NDArray[np.float64],
    t: float,
    edges: list[list[int]],
    images: list[Indices],
) -> list[_Body]:
    """Return the traces near the centre; those of marked edges in the images of those edges."""
    bodies: list[tuple[Indices, Indices, bool, bool]] = []
    for g, closed in enumerate(traces.closed):
        vertices = traces.vertices[traces.offsets[g] : traces.offsets[g + 1]]
        held = [image for edge, image in zip(edges, images, strict=True) if edge[0] in vertices]
        for image in held or [_image_near(motion, vertices, centre, t)]:
            if not any(v is vertices and (i == image).all() for v, i, *_ in bodies):
                bodies.append((vertices, image, bool(closed), bool(held)))
    far = [np.linalg.norm(_at(motion, vertices, image, t) - centre, axis=1) for vertices, image, *_ in bodies]
    every = np.sort(np.concatenate(far))
    reach = every[min(MOST_VERTICES, len(every)) - 1]
    return [
        _Body(vertices, image, closed, tuple(_runs(distance <= reach, closed)), marked)
        for (vertices, image, closed, marked), distance in zip(bodies, far, strict=True)
    ]


def _pieces(motion: StepMotion, strands: Strands, bodies: list[_Body], centre: NDArray[np.float64]) -> Iterator[Piece]:
    for body in bodies:
        for run in body.runs:
            chosen = body.vertices[run]
            x0, x1 = _placed(motion, chosen.tolist(), body.image)
            name = strands.names[strands.strand_of_vertex[chosen[0]]]
            yield Piece(name, tuple(strands.labels.text(v) for v in chosen), x0 - centre, x1 - centre)


def _curves(
    motion: StepMotion,
    strands: Strands,
    bodies: list[_Body],
    centre: NDArray[np.float64],
    radius: float,
    t: float,
    kind: CurveKind,
) -> tuple[list[CurvePath], str]:
    """Return the smooth curve along the runs of the marked traces, and why one of them has none."""
    paths, problem = [], ""
    for body in bodies:
        if not (body.marked and body.runs):
            continue
        x0, x1 = (x - centre for x in _placed(motion, body.vertices.tolist(), body.image))
        try:
            curves = trace_curves(x0, x1, closed=body.closed, kind=kind)
        except MdtopoError as error:
            problem = problem or str(error)
            continue
        name = strands.names[strands.strand_of_vertex[body.vertices[0]]]
        near = np.linalg.norm((1.0 - t) * x0 + t * x1, axis=1) <= radius
        n_edges = len(x0) - (not body.closed)
        for run in body.runs:
            parts = np.where(near[run[:-1]] | near[run[1:]], NEAR_PARTS, FAR_PARTS)
            paths.append(CurvePath(name, *(places(curve, n_edges, run, parts) for curve in curves)))
    return paths, problem


def _at(motion: StepMotion, vertices: Indices, image: Indices, t: float) -> Points:
    x0, x1 = _placed(motion, vertices.tolist(), image)
    return (1.0 - t) * x0 + t * x1


def _image_near(motion: StepMotion, vertices: Indices, centre: NDArray[np.float64], t: float) -> Indices:
    if not motion.cell0.any():
        return np.zeros(3, dtype=np.int64)
    cell = (1.0 - t) * motion.cell0 + t * motion.cell1
    x = _at(motion, vertices, np.zeros(3, dtype=np.int64), t)
    counts = np.rint((centre - x) @ np.linalg.inv(cell)).astype(np.int64)
    nearest = np.argmin(np.linalg.norm(x + counts @ cell - centre, axis=1))
    return np.asarray(counts[nearest])


def _runs(inside: NDArray[np.bool_], closed: bool) -> list[Indices]:
    """Return the runs of consecutive vertices that are inside, as positions in the trace; a whole ring comes closed."""
    indices = np.flatnonzero(inside)
    if not len(indices):
        return []
    if closed and inside.all():
        return [np.append(indices, 0)]
    if closed and inside[0] and inside[-1]:
        cut = int(np.flatnonzero(~inside)[0])
        indices = np.concatenate([indices[indices >= cut], indices[indices < cut]])
        breaks = np.flatnonzero(np.diff(indices) % len(inside) != 1) + 1
    else:
        breaks = np.flatnonzero(np.diff(indices) != 1) + 1
    return [run for run in np.split(indices, breaks) if len(run) > 1]
