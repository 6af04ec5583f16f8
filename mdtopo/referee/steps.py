"""All that the referee says of one step."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdtopo.records import Frame, Strands
from mdtopo.referee.distances import least_distances, separation, vertex_distances
from mdtopo.referee.meeting import judge_pair
from mdtopo.referee.paths import LinearPath, Piece, frame_fault, linear_path, pieces_of
from mdtopo.referee.search import near_pairs, undecided_pairs
from mdtopo.typing import Indices, Lengths

Edge = tuple[int, int]


@dataclass(frozen=True, slots=True)
class FoundCrossing:
    """One edge passes through another.

    Attributes
    ----------
    t : float
        Time within the step.
    edges : tuple of two edges
        The edge with the lower first vertex comes first.
    parameters : tuple of float
        Where on the edges, from 0 to 1.
    sign : int
        +1 where det(a - c, b - a, d - c) rises through zero, -1 where it falls.
    image : tuple of int
        Lattice counts that bring the second edge, as the first frame stores its first vertex, to the first edge, as the
        first frame stores its.
    """

    t: float
    edges: tuple[Edge, Edge]
    parameters: tuple[float, float]
    sign: int
    image: tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class FoundContact:
    """Two edges meet without passing; `kind` as in `Meeting`."""

    t: float
    edges: tuple[Edge, Edge]
    kind: str


@dataclass(frozen=True, eq=False)
class StepCase:
    """One step before the referee.

    Attributes
    ----------
    path : LinearPath
        The motion that is judged.
    pieces : tuple of Piece
        What is left of the strands.
    """

    path: LinearPath
    pieces: list[Piece]

    @cached_property
    def edges(self) -> Indices:
        """The edges that are left, shape (m, 2)."""
        return np.concatenate([piece.edges for piece in self.pieces])

    @property
    def angle(self) -> float:
        """Angle of the rotation that is taken out, degrees."""
        return self.path.angle

    @property
    def scale(self) -> float:
        """The greatest length that enters the positions, Å."""
        return self.path.scale

    @cached_property
    def displacement(self) -> float:
        """How far the vertex that moves most moves, Å."""
        x0, x1 = self.path.ends
        return float(np.linalg.norm(x1 - x0, axis=1).max())

    @cached_property
    def separation(self) -> float | None:
        """ν at the start, Å; None where images cannot be counted."""
        return separation(self.path, self.pieces, self.edges)

    def least_distances(self, reach: Lengths) -> Lengths | None:
        """Return the least sampled distance of each class within reach; see `distances.least_distances`."""
        return least_distances(self.path, self.pieces, self.edges, reach)

    def vertex_distances(self, reach: float) -> Lengths | None:
        """Return the least sampled distance of each vertex's edges within reach; see `distances.vertex_distances`."""
        return vertex_distances(self.path, self.edges, reach)

    @cached_property
    def meetings(self) -> tuple[tuple[FoundCrossing, ...], tuple[FoundContact, ...]] | None:
        """Every crossing and every contact of edges that share no vertex, in order of time.

        None where images cannot be counted. Exact for the path: in the lab frame for the stored coordinates, else for
        the turned ones in float64.
        """
        pairs = near_pairs(self.path, self.edges, 0.0)
        if pairs is None:
            return None
        pairs = undecided_pairs(self.path, self.edges, pairs)
        crossings, contacts = [], []
        for i, j, image in zip(pairs.first.tolist(), pairs.second.tolist(), pairs.image.tolist(), strict=True):
            edges = self._edge(i), self._edge(j)
            for found in judge_pair(*self._exact(edges, image)):
                if found.sign:
                    shown = self._as_stored(edges, image)
                    crossings.append(FoundCrossing(found.t, edges, (found.s, found.r), found.sign, shown))
                else:
                    contacts.append(FoundContact(found.t, edges, found.kind))
        return tuple(sorted(crossings, key=lambda c: c.t)), tuple(sorted(contacts, key=lambda c: c.t))

    def _edge(self, k: int) -> Edge:
        tail, head = self.edges[k].tolist()
        return tail, head

    def _as_stored(self, edges: tuple[Edge, Edge], image: list[int]) -> tuple[int, int, int]:
        counts = self.path.counts0
        a, b, c = (np.array(image) + counts[edges[1][0]] - counts[edges[0][0]]).tolist()
        return a, b, c

    def _exact(self, edges: tuple[Edge, Edge], image: list[int]) -> tuple[list[list[int]], list[list[int]]]:
        """Return the four vertices at both ends as whole numbers in one unit, the second edge in its image."""
        path, vertices = self.path, [*edges[0], *edges[1]]
        floats = [path.base0[vertices], path.base1[vertices]]
        if path.cells is not None:
            floats += path.cells
        numbers = _whole_numbers(floats)
        ends = numbers[:8]
        if path.cells is not None:
            for k, counts in enumerate((path.counts0, path.counts1)):
                cell = numbers[8 + 3 * k : 11 + 3 * k]
                for corner, vertex in enumerate(vertices):
                    shift = [int(n) + (m if corner > 1 else 0) for n, m in zip(counts[vertex], image, strict=True)]
                    point = ends[4 * k + corner]
                    for axis in range(3):
                        point[axis] += sum(n * row[axis] for n, row in zip(shift, cell, strict=True))
        return ends[:4], ends[4:8]


def _whole_numbers(arrays: list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]) -> list[list[int]]:
    """Return the rows of the arrays as multiples of one power of two: floats are dyadic."""
    ratios = [[x.as_integer_ratio() for x in row] for array in arrays for row in array.tolist()]
    unit = max(denominator for row in ratios for _, denominator in row)
    return [[numerator * (unit // denominator) for numerator, denominator in row] for row in ratios]


def open_step(
    frame0: Frame, frame1: Frame, strands: Strands, broken: Collection[Edge], *, rigid: bool, periodic: bool
) -> StepCase | str:
    """Return the step between two frames, ready to be judged, or why nothing can be said of it, in words.

    Parameters
    ----------
    frame0, frame1 : Frame
        As stored.
    strands : Strands
    broken : collection of edges
        Edges that were broken before the step.
    rigid : bool
        Whether the common rigid motion is taken out of the step.
    periodic : bool
        Whether the trajectory's first frame has a cell.
    """
    for frame in (frame0, frame1):
        fault = frame_fault(frame, periodic=periodic)
        if fault:
            return fault
    if frame1.time <= frame0.time:
        return f"the time of frame {frame1.index} does not come after that of frame {frame0.index}"
    pieces = pieces_of(strands, frozenset(broken))
    path = linear_path(frame0, frame1, pieces, rigid=rigid)
    return path if isinstance(path, str) else StepCase(path, pieces)
