"""Motions in periodic cells, and what they are in exact arithmetic once strands have been placed by whole images."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from oracles import Event, Passages, passages
from oracles.lattice import Shift
from soundness.families import Generator, Points, in_hex, meeting, powers, signs

from mdtopo.curves import step_motion, whole_strands
from mdtopo.records import Strands, Traces

LENGTHS = (2, 6)
"""A short strand, and a long one whose first edge meets it and whose centre is a cell away, so that images count."""

PAIR = ((0, 1), (2, 3))


@dataclass(frozen=True)
class Periodic:
    """One step as stored: positions (8, 3) and cells (3, 3) at both ends."""

    x0: Points
    x1: Points
    cell0: Points
    cell1: Points

    def in_hex(self) -> str:
        return f"{in_hex(self.x0, self.x1)} in {in_hex(self.cell0, self.cell1)}"


def with_tail(rng: Generator, x0: Points, x1: Points, length: float) -> tuple[Points, Points]:
    """Return the two edges with four more vertices behind the second one, along a line that leaves the place."""
    away = rng.normal(size=3)
    away *= 0.4 * length / np.linalg.norm(away)
    tail = x0[3] + np.arange(1, 5)[:, np.newaxis] * away
    return np.concatenate([x0, tail]), np.concatenate([x1, tail])


def wrapped(rng: Generator, x: Points, cell: Points, reach: int) -> Points:
    """Return the positions with each vertex moved by whole cells, rounded as a file would hold them."""
    return np.asarray(x + rng.integers(-reach, reach + 1, size=x.shape).astype(float) @ cell)


def cubic(rng: Generator) -> Points:
    return float(rng.uniform(9.0, 60.0)) * np.eye(3)


def skewed(rng: Generator, most: int) -> Points:
    """Return a reduced cell in another, skewed basis of the same lattice (but for rounding)."""
    cell = float(rng.uniform(9.0, 40.0)) * (np.eye(3) + rng.uniform(-0.3, 0.3, size=(3, 3)))
    cell[1] += int(rng.integers(-most, most + 1)) * cell[0]
    cell[2] += int(rng.integers(-most, most + 1)) * cell[0] + int(rng.integers(-2, 3)) * cell[1]
    return cell


def near_meeting(rng: Generator, gap: tuple[float, float], speed: tuple[float, float]) -> tuple[Points, Points]:
    gaps = signs(rng, 1) * powers(rng, 1, *gap)
    x0, x1 = meeting(rng, gaps, np.abs(gaps) * powers(rng, 1, *speed))
    return 3.0 * x0[0], 3.0 * x1[0]


def in_its_box(rng: Generator) -> Periodic:
    """Strands stored whole, as an unwrapped trajectory holds them."""
    cell = cubic(rng)
    x0, x1 = with_tail(rng, *near_meeting(rng, (-15, -1), (-2, 1)), cell[0, 0])
    return Periodic(x0, x1, cell, cell)


def through_the_boundary(rng: Generator) -> Periodic:
    """Every vertex in its own image."""
    cell = cubic(rng)
    x0, x1 = with_tail(rng, *near_meeting(rng, (-13, -1), (-2, 1)), cell[0, 0])
    return Periodic(wrapped(rng, x0, cell, 3), wrapped(rng, x1, cell, 3), cell, cell)


def clear_of_rounding(rng: Generator) -> Periodic:
    """Every vertex in its own image, gaps far above the rounding of what is placed by whole cells, and short edges.

    An edge of about half a cell has two images of about one length, and a step in which they change places is
    undecided, whatever the gap.
    """
    while True:
        cell = cubic(rng) if rng.random() < 0.5 else skewed(rng, 3)
        x0, x1 = with_tail(rng, *near_meeting(rng, (-8, 0), (-2, 1)), 10.0)
        edges = [np.delete(np.diff(x, axis=0), LENGTHS[0] - 1, axis=0) for x in (x0, x1)]
        if np.linalg.norm(edges, axis=2).max() < 0.3 * shortest_vector(cell):
            return Periodic(wrapped(rng, x0, cell, 2), wrapped(rng, x1, cell, 2), cell, cell)


def shortest_vector(cell: Points) -> float:
    """Return the length of the shortest lattice vector of a cell that is skewed three times at most."""
    counts = np.stack(np.meshgrid(*[np.arange(-9.0, 10.0)] * 3), axis=-1).reshape(-1, 3)
    lengths = np.linalg.norm(counts @ cell, axis=1)
    return float(lengths[lengths > 0.0].min())


def skewed_cell(rng: Generator) -> Periodic:
    cell = skewed(rng, 3)
    x0, x1 = with_tail(rng, *near_meeting(rng, (-13, -1), (-2, 1)), 10.0)
    return Periodic(wrapped(rng, x0, cell, 2), wrapped(rng, x1, cell, 2), cell, cell)


def very_skewed_cell(rng: Generator) -> Periodic:
    cell = skewed(rng, 2000)
    x0, x1 = with_tail(rng, *near_meeting(rng, (-13, -1), (-2, 1)), 10.0)
    return Periodic(x0, x1, cell, cell)


def moving_cell(rng: Generator) -> Periodic:
    cell0 = skewed(rng, 1)
    cell1 = cell0 @ (np.eye(3) + rng.normal(scale=0.01, size=(3, 3)))
    x0, x1 = with_tail(rng, *near_meeting(rng, (-13, 0), (-2, 1)), 10.0)
    return Periodic(wrapped(rng, x0, cell0, 1), wrapped(rng, x1, cell1, 1), cell0, cell1)


def skewed_in_the_last_digits(rng: Generator) -> Periodic:
    """The same lattice in a basis skewed by up to ten thousand cells, and gaps of some units in the last place."""
    skew = int(powers(rng, 1, 0, 4)[0]) * int(rng.choice([-1, 1]))
    cell = float(rng.uniform(20.0, 40.0)) * (np.eye(3) + rng.uniform(-0.2, 0.2, size=(3, 3)))
    cell[2] += skew * cell[0]
    x0, x1 = with_tail(rng, *near_meeting(rng, (-15, -11), (-1, 1)), 10.0)
    shift = np.array([*rng.integers(-1, 2, size=2), 0.0]) + rng.choice([0.0, 1.0]) * np.array([-skew, 0.0, 1.0])
    for x in (x0, x1):
        x[2:] += shift @ cell
    return Periodic(x0, x1, cell, cell)


def moving_in_the_last_digits(rng: Generator) -> Periodic:
    cell0 = skewed(rng, 1)
    cell1 = cell0 @ (np.eye(3) + rng.normal(scale=0.01, size=(3, 3)))
    x0, x1 = with_tail(rng, *near_meeting(rng, (-15, -12), (-1, 1)), 10.0)
    return Periodic(wrapped(rng, x0, cell0, 1), wrapped(rng, x1, cell1, 1), cell0, cell1)


def cells_away(rng: Generator) -> Periodic:
    """Two bars whose strands are stored several cells apart, with heights of a few units in the last place."""
    length = float(rng.uniform(30.0, 60.0))
    cell, far = length * np.eye(3), int(powers(rng, 1, 0, 4)[0]) * length
    x0 = np.zeros((8, 3))
    x0[:4] = [[-1, 0, 0], [1, 0, 0], [0, -1, far], [0, 1, far]]
    x0[:4, :2] += rng.normal(scale=0.1, size=(4, 2))
    x0[2:4, 2] += rng.integers(-1, 2, size=2) * np.spacing(far)
    x1 = x0.copy()
    x1[2:4, 2] += rng.integers(-2, 3, size=2) * np.spacing(far)
    for x in (x0, x1):  # a short tail, so that nearest images bring the strand back beside the first
        x[4:] = [[0.1, 2, far + 1], [0.2, 2, far + 2], [0.3, 1, far + 3], [0.4, 0, far + 4]]
    return Periodic(x0, x1, cell, cell)


PERIODIC_FAMILIES: dict[str, Callable[[Generator], Periodic]] = {
    "in its box": in_its_box,
    "through the boundary": through_the_boundary,
    "clear of rounding": clear_of_rounding,
    "skewed cell": skewed_cell,
    "very skewed cell": very_skewed_cell,
    "moving cell": moving_cell,
    "skewed in the last digits": skewed_in_the_last_digits,
    "moving in the last digits": moving_in_the_last_digits,
    "cells away": cells_away,
}


ExactRows = list[list[Fraction]]
PairOfEdges = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True)
class ExactMotion:
    """Positions and cells at both ends in exact arithmetic, placed in the images that the package chose.

    Only whole numbers are taken from the package: `placed`, by how many lattice vectors of the file it moved each
    vertex of the first frame (and likewise of the second), and `basis`, which combinations of them its reduced cell is.
    """

    x0: ExactRows
    x1: ExactRows
    cell0: ExactRows
    cell1: ExactRows
    placed: NDArray[np.int64]
    basis: NDArray[np.int64]

    @classmethod
    def of(cls, step: Periodic, strands: Strands) -> "ExactMotion":
        t = Traces.of(strands)
        whole0, reduced0, *_ = whole_strands(step.x0, step.cell0, t.vertices, t.offsets, t.closed)
        whole1, reduced1, *_ = whole_strands(step.x1, step.cell1, t.vertices, t.offsets, t.closed)
        motion = step_motion(whole0, whole1, reduced0, reduced1, 0.0, True, False, np.eye(3), t.vertices, t.offsets)
        placed, basis = counts(motion.x0 - step.x0, step.cell0), counts(motion.cell0, step.cell0)
        return cls(
            shifted(step.x0, placed, step.cell0),
            shifted(step.x1, counts(motion.x1 - step.x1, step.cell1), step.cell1),
            shifted(np.zeros((3, 3)), basis, step.cell0),
            shifted(np.zeros((3, 3)), counts(motion.cell1, step.cell1), step.cell1),
            placed,
            basis,
        )

    def passages(self, strands: Strands, pairs: Sequence[PairOfEdges]) -> Passages:
        """Return all crossings and contacts of these pairs in all images, counted from the positions as stored."""
        found = passages(
            self.x0, self.x1, strands.offsets, strands.closed, cell0=self.cell0, cell1=self.cell1, pairs=pairs
        )
        return replace(found, events=tuple(replace(e, shift=self._from_stored(e)) for e in found.events))

    def _from_stored(self, event: Event) -> Shift:
        a, c = event.first[0], event.second[0]
        x, y, z = (np.array(event.shift) @ self.basis + self.placed[c] - self.placed[a]).tolist()
        return x, y, z


def counts(vectors: Points, cell: Points) -> NDArray[np.int64]:
    found = vectors @ np.linalg.inv(cell)
    assert np.abs(found - np.rint(found)).max() < 1e-3
    return np.rint(found).astype(np.int64)


def shifted(x: Points, shifts: NDArray[np.int64], cell: Points) -> ExactRows:
    rows = [[Fraction(v) for v in row] for row in cell.tolist()]
    return [
        [Fraction(v) + sum(int(n) * row[axis] for n, row in zip(shift, rows, strict=True)) for axis, v in enumerate(p)]
        for p, shift in zip(x.tolist(), shifts, strict=True)
    ]
