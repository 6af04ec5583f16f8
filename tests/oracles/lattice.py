"""Periodic images by brute force. Rows of a cell are its lattice vectors; a shift is three integers."""

from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

Shift = tuple[int, int, int]

PAD = 1e-6
"""Added to ranges of images that are computed in floats: a few images too many cost time and nothing else."""


def nearest_image_brute(difference: ArrayLike, cell: ArrayLike, *, reach: int = 2) -> tuple[NDArray[np.float64], Shift]:
    """Return the shortest of d + s·H over all shifts s with entries in -reach … reach, and its shift.

    The first in lexicographic order wins a tie. Right for vectors whose shortest image lies within the reach.
    """
    h, d = np.asarray(cell, dtype=np.float64), np.asarray(difference, dtype=np.float64)
    shifts = list(product(range(-reach, reach + 1), repeat=3))
    images = [d + np.array(s) @ h for s in shifts]
    best = min(range(len(images)), key=lambda i: float(images[i] @ images[i]))
    return images[best], shifts[best]


def make_whole_brute(
    x: ArrayLike, offsets: Sequence[int], cell: ArrayLike, *, reach: int = 2
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return whole strands and the integer shift of each vertex: whole = x + shifts·H.

    Walks along each strand from its first vertex, which stays, and joins every vertex to the nearest image of
    the next. A ring's closing edge follows from the rest: it is short exactly where the ring has no winding.
    """
    h, points = np.asarray(cell, dtype=np.float64), np.asarray(x, dtype=np.float64)
    shifts = np.zeros(points.shape, dtype=np.int64)
    for start, stop in pairwise(offsets):
        for i in range(start + 1, stop):
            _, step = nearest_image_brute(points[i] - points[i - 1], h, reach=reach)
            shifts[i] = shifts[i - 1] + step
    return points + shifts @ h, shifts


def shifts_within(
    pair0: ArrayLike, pair1: ArrayLike, cell0: ArrayLike, cell1: ArrayLike, reach: float
) -> Iterator[Shift]:
    """Yield every shift s for which edge (a, b) and edge (c, d) + s·H(t) can come within `reach` in [0, 1].

    With n the nearest shift at mid-step, |(s - n)·H(t)| ≤ reach + max |V - n·H| over the four corner
    differences V at both ends of the step, because V - n·H(t) is linear in t; and |(s - n)·H(t)| ≥ σ |s - n|
    with the least singular value σ of H(t), which is at least (σ0 + σ1 - ‖H1 - H0‖)/2 (Lipschitz in H).
    """
    h = [np.asarray(cell, dtype=np.float64) for cell in (cell0, cell1)]
    corners = [_corner_differences(pair) for pair in (pair0, pair1)]
    least = [np.linalg.svd(cell, compute_uv=False)[-1] for cell in h]
    sigma = (least[0] + least[1] - np.linalg.norm(h[1] - h[0], 2)) / 2
    if sigma <= 0:
        raise ValueError("The cell changes too much in one step for a brute-force search of images.")
    middle = np.concatenate(corners).mean(axis=0)
    nearest = np.rint(middle @ np.linalg.inv((h[0] + h[1]) / 2))
    longest = max(np.linalg.norm(v - nearest @ cell, axis=1).max() for v, cell in zip(corners, h, strict=True))
    radius = (reach + longest) / sigma + PAD
    box = range(-int(radius), int(radius) + 1)
    for s in product(box, repeat=3):
        if np.linalg.norm(s) <= radius:
            yield tuple(int(k) for k in nearest + s)


def _corner_differences(pair: ArrayLike) -> NDArray[np.float64]:
    """Return {a-c, a-d, b-c, b-d}."""
    first, second = np.asarray(pair, dtype=np.float64)
    return np.array([p - q for p in first for q in second])
