"""Which linear motion a step is: whole strands, each beside where it was, the common rigid motion taken out."""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mdtopo.errors import AuditError
from mdtopo.geometry.rigid import best_rotations, covariance
from mdtopo.records import Frame, Strands
from mdtopo.referee.cells import drift, matched_counts, nearest_counts, short_vectors
from mdtopo.typing import Cell, Indices, Points

TOO_FAR = 0.8
"""Drift of a cell at which its images cannot be counted on a straight path: part of what a step's path is."""

LARGEST = 1e12
"""Å. Beyond it, a coordinate is bad data."""

ROTATION_ERROR = 1e-12
"""A rotation may differ from an orthogonal matrix by this much: some thousand units in the last place."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """What is left of a strand between broken edges: its vertices in order, and whether it returns to the first."""

    vertices: Indices
    is_closed: bool

    @property
    def edges(self) -> Indices:
        """Its edges in order, shape (m, 2)."""
        after = np.roll(self.vertices, -1)
        both = np.stack([self.vertices, after], axis=1)
        return both if self.is_closed else both[:-1]


def pieces_of(strands: Strands, broken: Collection[tuple[int, int]]) -> list[Piece]:
    """Return the strands, cut at their broken edges."""
    found = []
    for (start, stop), ring in zip(pairwise(strands.offsets.tolist()), strands.closed.tolist(), strict=True):
        vertices = list(range(start, stop))
        if ring and any((v, w) in broken for v, w in pairwise([*vertices, start])):
            # begin behind the first cut: the ring is an open strand then
            first = next(k for k, (v, w) in enumerate(pairwise([*vertices, start])) if (v, w) in broken)
            vertices, ring = vertices[first + 1 :] + vertices[: first + 1], False
        part = [vertices[0]]
        for v, w in pairwise(vertices):
            if (v, w) in broken:
                found.append(Piece(np.array(part, dtype=np.int64), False))
                part = []
            part.append(w)
        found.append(Piece(np.array(part, dtype=np.int64), bool(ring)))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class LinearPath:
    """The motion of one step: vertex i runs straight from base0 + counts0·cell0 to base1 + counts1·cell1.

    Attributes
    ----------
    base0, base1 : ndarray, shape (n, 3)
        Positions as stored; in the second frame turned and shifted by the rigid motion that is taken out, Å.
    counts0, counts1 : ndarray of int, shape (n, 3)
        Lattice vectors that make strands whole, and put the second frame's beside the first's.
    cells : tuple of two ndarrays, shape (3, 3), or None
        The lattice vectors at both ends, those of the second frame matched to those of the first and turned along.
    angle : float
        Angle of the rotation that was taken out, degrees.
    """

    base0: Points
    base1: Points
    counts0: Indices
    counts1: Indices
    cells: tuple[Cell, Cell] | None
    angle: float

    @property
    def ends(self) -> tuple[Points, Points]:
        """Positions at both ends in floating point, Å."""
        if self.cells is None:
            return self.base0, self.base1
        return self.base0 + self.counts0 @ self.cells[0], self.base1 + self.counts1 @ self.cells[1]

    @property
    def scale(self) -> float:
        """The greatest length that enters: rounding is a multiple of it."""
        greatest = max(float(np.abs(base).max(initial=0.0)) for base in (self.base0, self.base1))
        if self.cells is not None:
            applied = 1 + max(int(np.abs(counts).max(initial=0)) for counts in (self.counts0, self.counts1))
            greatest += applied * float(sum(np.abs(cell).sum() for cell in self.cells))
        return greatest


def frame_fault(frame: Frame, *, periodic: bool) -> str:
    """Return why a frame cannot be used in a run, in words; empty where it can."""
    if not (np.abs(frame.positions) <= LARGEST).all():
        return f"frame {frame.index} has coordinates that are no numbers or too large"
    if (frame.cell is not None) != periodic:
        return f"frame {frame.index} {'has no' if periodic else 'has a'} periodic box, unlike the first frame"
    if frame.cell is not None and not _spans_space(frame.cell):
        return f"the periodic box of frame {frame.index} has no volume"
    return ""


def _spans_space(cell: Cell) -> bool:
    """Return whether a cell is finite, none of its vectors below 1e-6 Å, and they are not nearly in one plane."""
    if not (np.abs(cell) <= LARGEST).all():
        return False
    a, b, c = cell
    sizes = [float(np.sqrt(v @ v)) for v in cell]
    if min(sizes) < 1e-6:
        return False
    return bool(abs(np.cross(a / sizes[0], b / sizes[1]) @ (c / sizes[2])) > 1e-12)


def linear_path(frame0: Frame, frame1: Frame, pieces: list[Piece], *, rigid: bool) -> LinearPath | str:
    """Return the path of a step whose frames can be used, or why it has none, in words.

    Parameters
    ----------
    frame0, frame1 : Frame
        As stored.
    pieces : list of Piece
    rigid : bool
        Whether the common rigid motion is taken out.

    Raises
    ------
    AuditError
        If what is to be taken out is no rotation.
    """
    if frame0.cell is None or frame1.cell is None:
        none = np.zeros(frame0.positions.shape, dtype=np.int64)
        groups = np.array([0, sum(len(piece.vertices) for piece in pieces)])
        turn = _rotation(frame0.positions, frame1.positions, pieces, groups) if rigid else np.eye(3)
        base1 = frame1.positions @ turn.T if rigid else frame1.positions
        path = LinearPath(frame0.positions, base1, none, none, None, angle_of(turn))
        return _centred(path) if rigid else path
    counts = []
    for frame, cell in ((frame0, frame0.cell), (frame1, frame1.cell)):
        found = _whole(frame.positions, cell, pieces)
        if found is None:
            return f"a ring closes through the periodic boundary in frame {frame.index}"
        counts.append(found)
    match = matched_counts(frame0.cell, frame1.cell)
    cell1 = match @ frame1.cell
    counts[1] = counts[1] @ np.rint(np.linalg.inv(match)).astype(np.int64)
    path = LinearPath(frame0.positions, frame1.positions, counts[0], counts[1], (frame0.cell, cell1), 0.0)
    if rigid:
        offsets = np.concatenate([[0], np.cumsum([len(piece.vertices) for piece in pieces])])
        turn = _rotation(*path.ends, pieces, offsets)
        if drift(*_short(frame0.cell, cell1 @ turn.T)) < TOO_FAR:
            turned = frame1.positions @ turn.T
            path = LinearPath(
                path.base0, turned, path.counts0, path.counts1, (frame0.cell, cell1 @ turn.T), angle_of(turn)
            )
    assert path.cells is not None
    if not drift(*_short(*path.cells)) < TOO_FAR:
        return "the periodic box changes too much in this step"
    path = _beside(path, pieces)
    return _centred(path) if rigid else path


def _short(cell0: Cell, cell1: Cell) -> tuple[Cell, Cell]:
    """Return both cells in the short vectors of the first."""
    counts = short_vectors(cell0)
    return counts @ cell0, counts @ cell1


def _whole(x: Points, cell: Cell, pieces: list[Piece]) -> Indices | None:
    """Return the counts that make each piece whole, with its centre nearest to that of the first piece.

    The first piece begins where its first vertex is stored. None where a ring does not close. Which image a strand
    takes matters where the cell turns with it: further out it is moved further.
    """
    short = short_vectors(cell)
    counts = np.zeros(x.shape, dtype=np.int64)
    anchor = None
    for piece in pieces:
        steps = nearest_counts(x[np.roll(piece.vertices, -1)] - x[piece.vertices], short @ cell) @ short
        if piece.is_closed and steps.sum(axis=0).any():
            return None
        counts[piece.vertices[1:]] = np.cumsum(steps[:-1], axis=0)
        centre = (x[piece.vertices] + counts[piece.vertices] @ cell).mean(axis=0)
        anchor = centre if anchor is None else anchor
        counts[piece.vertices] += (nearest_counts((centre - anchor)[np.newaxis], short @ cell) @ short)[0]
    return counts


def _rotation(x0: Points, x1: Points, pieces: list[Piece], groups: Indices) -> Points:
    """Return the common rotation of a step, shape (3, 3), and check that it is one."""
    vertices = np.concatenate([piece.vertices for piece in pieces])
    correlation, size = covariance(np.ascontiguousarray(x0), np.ascontiguousarray(x1), vertices, groups)
    turn: Points = best_rotations(correlation[np.newaxis], np.array([size]))[0]
    if not (np.abs(turn.T @ turn - np.eye(3)).max() < ROTATION_ERROR and np.linalg.det(turn) > 0.0):
        raise AuditError(f"The rotation that a step takes out is no rotation: {turn.tolist()}.")
    return turn


def angle_of(rotation: Points) -> float:
    """Return the angle of a rotation, degrees: half of its chord is sin(angle / 2)."""
    chord = float(np.linalg.norm(rotation - np.eye(3))) / np.sqrt(8.0)
    if chord < 0.9:
        return float(2.0 * np.degrees(np.arcsin(chord)))
    # near half a turn the sine is flat: the matrix plus one has the cosine
    half = 0.25 * (1.0 + float(np.trace(rotation)))
    return float(2.0 * np.degrees(np.arccos(np.sqrt(max(half, 0.0)))))


def _beside(path: LinearPath, pieces: list[Piece]) -> LinearPath:
    """Return the path with each piece of the second frame beside where it was, but for a motion that most share.

    That motion is the circular mean of all vertices, so a file that was centred anew tears nothing.
    """
    assert path.cells is not None
    x0, x1 = path.ends
    cell1 = path.cells[1]
    short = short_vectors(cell1)
    basis = short @ cell1
    moves = np.array([(x1[piece.vertices] - x0[piece.vertices]).mean(axis=0) for piece in pieces])
    sizes = np.array([len(piece.vertices) for piece in pieces])
    phases = np.exp(2j * np.pi * (moves @ np.linalg.inv(basis)))
    shared = np.angle((sizes[:, np.newaxis] * phases).sum(axis=0)) / (2.0 * np.pi) @ basis
    shifts = nearest_counts(moves - shared, basis) @ short
    counts1 = path.counts1.copy()
    for piece, shift in zip(pieces, shifts, strict=True):
        counts1[piece.vertices] += shift
    return LinearPath(path.base0, path.base1, path.counts0, counts1, path.cells, path.angle)


def _centred(path: LinearPath) -> LinearPath:
    """Return the path without the motion of the centroid."""
    x0, x1 = path.ends
    shift = x1.mean(axis=0) - x0.mean(axis=0)
    return LinearPath(path.base0, path.base1 - shift, path.counts0, path.counts1, path.cells, path.angle)
