"""Periodic cells by trying: short lattice vectors, and nearest images. Rows of a cell are its lattice vectors."""

from itertools import product

import numpy as np

from mdtopo.typing import Cell, Indices, Points

NEIGHBOURS: Indices = np.array(list(product((-1, 0, 1), repeat=3)), dtype=np.int64)
"""Of these shifts from the rounded fractions one is the nearest image, where the lattice vectors are short."""

GAIN = 1.0 - 1e-9
"""A lattice vector is replaced by one whose square is shorter than this multiple, so that a tie ends the search."""

LONGEST_SEARCH = 10_000
"""Rounds after which a cell counts as one that has no volume."""


def short_vectors(cell: Cell) -> Indices:
    """Return the integers T, shape (3, 3), that make the rows of T @ cell the shortest vectors of the lattice.

    Each vector is shortened by small multiples of the two others until none becomes shorter.
    """
    counts = np.eye(3, dtype=np.int64)
    for _ in range(LONGEST_SEARCH):
        squared = ((counts @ cell) ** 2).sum(axis=1)
        trials = [
            (
                float((((trial := counts[k] + i * counts[k - 1] + j * counts[k - 2]) @ cell) ** 2).sum()) / squared[k],
                k,
                trial,
            )
            for k in range(3)
            for i, j in product((-2, -1, 0, 1, 2), repeat=2)
        ]
        best, k, trial = min(trials, key=lambda entry: entry[0])
        if not best < GAIN:
            break
        counts[k] = trial
    return counts


def nearest_counts(differences: Points, basis: Cell) -> Indices:
    """Return the counts of basis vectors that make each difference shortest, shape (n, 3); the basis must be short."""
    rounded = -np.rint(differences @ np.linalg.inv(basis)).astype(np.int64)
    best, least = rounded, np.full(len(differences), np.inf)
    for shift in NEIGHBOURS:
        trial = rounded + shift
        squared = ((differences + trial @ basis) ** 2).sum(axis=1)
        nearer = squared < least
        best, least = np.where(nearer[:, np.newaxis], trial, best), np.where(nearer, squared, least)
    return best


def matched_counts(cell0: Cell, cell1: Cell) -> Indices:
    """Return the integers M, shape (3, 3), for which M @ cell1 are the lattice vectors of cell0 one step later.

    An engine may have flipped the cell to an equivalent one. Where no match exists, the rows are taken as they are.
    """
    short = short_vectors(cell0)
    rounded = np.rint(short @ cell0 @ np.linalg.inv(cell1)).astype(np.int64)
    if round(abs(np.linalg.det(rounded))) != 1:
        return np.eye(3, dtype=np.int64)
    inverse = np.rint(np.linalg.inv(short)).astype(np.int64)
    matched: Indices = inverse @ rounded
    return matched


def drift(basis0: Cell, basis1: Cell) -> float:
    """Return how far a neighbouring image drifts in half a step, in units of the least height of the middle cell."""
    moved = basis1 - basis0
    if not moved.any():
        return 0.0
    middle = 0.5 * (basis0 + basis1)
    if abs(np.linalg.det(middle)) <= 1e-12 * abs(np.linalg.det(basis0)):
        return float("inf")
    furthest = max(float(np.linalg.norm(np.array(corner) @ moved)) for corner in product((-1, 1), repeat=3))
    return 0.5 * furthest * float(np.linalg.norm(np.linalg.inv(middle), axis=0).max())


def least_stretch(basis0: Cell, basis1: Cell) -> float:
    """Return a number g > 0 with |s·H(t)| ≥ g·|s| for all s and all t in [0, 1]; not above 0 where none was found.

    The least singular value of H changes by no more than H itself, so a few times are enough.
    """
    n = 64
    spread = float(np.linalg.norm(basis1 - basis0, 2))
    values = [np.linalg.svd(basis0 + t * (basis1 - basis0), compute_uv=False)[-1] for t in np.linspace(0.0, 1.0, n + 1)]
    return float(min(values)) * (1.0 - 1e-9) - 0.5 * spread / n
