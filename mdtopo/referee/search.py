"""Which pairs of moving edges can be near each other? All pairs in all images, but for those whose boxes are apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.referee.cells import least_stretch, short_vectors
from mdtopo.referee.paths import LinearPath
from mdtopo.typing import Flags, Indices, Points

MARGIN = 1e-12
"""Boxes and slabs count as apart from this multiple of the greatest length on: some thousand roundings."""

LEAST_MARGIN = 1e-140
"""Å. And from this gap on, so that squares which underflow separate nothing."""

FURTHEST = 30.0
"""Images further away than this are too many to try."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Pairs of edges: edge `first` at home, edge `second` shifted by `image` lattice vectors, as the whole strands lie.

    Each unordered pair stands here once, the edge with the lower first vertex first. Pairs that share a vertex, and an
    edge with itself, appear in true images only.
    """

    first: Indices
    second: Indices
    image: Indices

    def __len__(self) -> int:
        return len(self.first)

    def chosen(self, rows: Flags | Indices) -> "Pairs":
        """Return some of the pairs."""
        return Pairs(self.first[rows], self.second[rows], self.image[rows])


def near_pairs(path: LinearPath, edges: Indices, reach: float, times: tuple[float, float] = (0.0, 1.0)) -> Pairs | None:
    """Return every pair of edges that may come within `reach` of each other between two times.

    Parameters
    ----------
    path : LinearPath
    edges : ndarray of int, shape (m, 2)
    reach : float
        Å.
    times : tuple of float
        Between 0 and 1.

    Returns
    -------
    Pairs or None
        None where the images cannot be counted.

    Guarantee
    ---------
    Conservative: what is missing stays further apart than the reach. A vertex on a straight line stays in the box of
    its two ends.
    """
    ends = corners(path, edges, times)
    grown = 0.5 * reach + MARGIN * path.scale + LEAST_MARGIN
    if path.cells is None:
        low, high = ends.min(axis=(0, 1)) - grown, ends.max(axis=(0, 1)) + grown
        owner = np.arange(len(edges))
        first, ghost = _overlaps(low, high, low, high)
        keep = first < ghost
        return _ordered(edges, first[keep], owner[ghost[keep]], np.zeros((int(keep.sum()), 3), dtype=np.int64))
    short = short_vectors(path.cells[0])
    bases = [short @ (path.cells[0] + t * (path.cells[1] - path.cells[0])) for t in times]
    # every edge is brought into the home cell first, so that few images are to be tried
    centre = ends.mean(axis=(0, 1))
    home = -np.floor(centre @ np.linalg.inv(0.5 * (bases[0] + bases[1]))).astype(np.int64)
    folded = ends + np.stack([home @ basis for basis in bases])[:, np.newaxis]
    low, high = folded.min(axis=(0, 1)) - grown, folded.max(axis=(0, 1)) + grown
    extent = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    stretch = least_stretch(*bases)
    if not extent < FURTHEST * stretch:
        return None
    ghosts, images = _ghosts(low, high, folded, bases, grown, int(extent / stretch) + 1)
    first, found = _overlaps(low, high, *_ghost_boxes(folded, ghosts, images, bases, grown))
    second, image = ghosts[found], images[found]
    keep = image.any(axis=1) | (first < second)
    first, second, image = first[keep], second[keep], image[keep]
    return _ordered(edges, first, second, (image + home[second] - home[first]) @ short)


def corners(path: LinearPath, edges: Indices, times: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the ends of the edges at the times, shape (n_times, 2, m, 3)."""
    x0, x1 = path.ends
    return np.stack([(x0 + t * (x1 - x0) if t < 1.0 else x1)[edges].swapaxes(0, 1) for t in times])


def _ghosts(
    low: Points, high: Points, folded: NDArray[np.float64], bases: list[Points], grown: float, furthest: int
) -> tuple[Indices, Indices]:
    """Return edges and shifts of all images whose box meets the box around everything at home.

    Of a pair's two descriptions, (i, j + s) and (j, i - s), one has a shift that is not below zero in dictionary order.
    """
    bottom, top = low.min(axis=0), high.max(axis=0)
    span = np.arange(-furthest, furthest + 1)
    shifts = np.array(np.meshgrid(span, span, span, indexing="ij")).reshape(3, -1).T
    shifts = shifts[len(shifts) // 2 :]  # the middle one is zero
    shifts = shifts[(shifts**2).sum(axis=1) <= furthest**2]
    owners, images = [], []
    for shift in shifts:
        moves = np.stack([shift @ basis for basis in bases])
        # the box of an image lies between the boxes at the two ends, each of them moved
        lows = np.min([folded[k].min(axis=0) + moves[k] for k in (0, 1)], axis=0) - grown
        highs = np.max([folded[k].max(axis=0) + moves[k] for k in (0, 1)], axis=0) + grown
        meets = np.flatnonzero(((lows <= top) & (highs >= bottom)).all(axis=1))
        owners.append(meets)
        images.append(np.broadcast_to(shift, (len(meets), 3)))
    return np.concatenate(owners), np.concatenate(images)


def _ghost_boxes(
    folded: NDArray[np.float64], ghosts: Indices, images: Indices, bases: list[Points], grown: float
) -> tuple[Points, Points]:
    moved = np.stack([folded[k][:, ghosts] + images @ bases[k] for k in (0, 1)])
    return moved.min(axis=(0, 1)) - grown, moved.max(axis=(0, 1)) + grown


def _overlaps(low: Points, high: Points, ghost_low: Points, ghost_high: Points) -> tuple[Indices, Indices]:
    """Return the indices of all boxes and ghost boxes that overlap."""
    if not len(low) or not len(ghost_low):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    order = np.argsort(ghost_low[:, 0], kind="stable")
    ghost_low, ghost_high = ghost_low[order], ghost_high[order]
    widest = float((ghost_high[:, 0] - ghost_low[:, 0]).max())
    starts = np.searchsorted(ghost_low[:, 0], low[:, 0] - 2.0 * widest, side="left")
    stops = np.searchsorted(ghost_low[:, 0], high[:, 0], side="right")
    firsts, ghosts = [], []
    for i in range(len(low)):
        part = slice(starts[i], stops[i])
        meets = ((ghost_low[part] <= high[i]) & (ghost_high[part] >= low[i])).all(axis=1)
        found = order[part][meets]
        firsts.append(np.full(len(found), i, dtype=np.int64))
        ghosts.append(found)
    return np.concatenate(firsts), np.concatenate(ghosts)


def _ordered(edges: Indices, first: Indices, second: Indices, image: Indices) -> Pairs:
    """Return the pairs with the lower first vertex first, without those that share a vertex at home."""
    swap = edges[first, 0] > edges[second, 0]
    one, other = np.where(swap, second, first), np.where(swap, first, second)
    image = np.where(swap[:, np.newaxis], -image, image)
    shared = (edges[one][:, :, np.newaxis] == edges[other][:, np.newaxis, :]).any(axis=(1, 2))
    keep = ~shared | image.any(axis=1)
    return Pairs(one[keep], other[keep], image[keep])


def undecided_pairs(path: LinearPath, edges: Indices, pairs: Pairs) -> Pairs:
    """Return those pairs that no plane separates during the whole step, of the few planes that are tried.

    The origin lies on one side of all eight differences {a - c, a - d, b - c, b - d} of both ends, and so of all
    differences between. Conservative: what is missing does not meet.
    """
    start, end = (points_at(path, edges, pairs, t) for t in (0.0, 1.0))
    differences = np.stack([ends[:, i] - ends[:, j] for ends in (start, end) for i in (0, 1) for j in (2, 3)])
    margin = MARGIN * path.scale * (1.0 + float(np.abs(pairs.image).max(initial=0))) + LEAST_MARGIN
    apart = np.zeros(len(pairs), dtype=np.bool_)
    for direction in _directions(start, end):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
            along = np.einsum("knd,nd->kn", differences, unit)
        apart |= (along.min(axis=0) > margin) | (along.max(axis=0) < -margin)  # false where it is NaN
    return pairs.chosen(~apart)


def _directions(start: NDArray[np.float64], end: NDArray[np.float64]) -> list[Points]:
    """Return directions in which a pair may be apart: across both edges, and along their distance."""
    found = [(start + end)[:, :2].mean(axis=1) - (start + end)[:, 2:].mean(axis=1)]
    for t in (0.0, 0.25, 0.5, 0.75, 1.0):
        a, b, c, d = np.moveaxis(start + t * (end - start), 1, 0)
        u, v, w = b - a, d - c, 0.5 * (a + b) - 0.5 * (c + d)
        found.append(np.cross(u, v))
        found.append(np.cross(u, np.cross(w, u)))  # the distance of the middles, across the first edge
        found.append(np.cross(v, np.cross(w, v)))
    return found


def points_at(path: LinearPath, edges: Indices, pairs: Pairs, t: float) -> NDArray[np.float64]:
    """Return the vertices a, b, c, d of each pair at a time, the second edge in its image, shape (n, 4, 3)."""
    x0, x1 = path.ends
    x = x0 + t * (x1 - x0) if t < 1.0 else x1
    points: NDArray[np.float64] = x[np.concatenate([edges[pairs.first], edges[pairs.second]], axis=1)]
    if path.cells is not None:
        shift = pairs.image @ (path.cells[0] + t * (path.cells[1] - path.cells[0]))
        points[:, 2:] += shift[:, np.newaxis]
    return points
