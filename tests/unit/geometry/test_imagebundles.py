"""Pairs of boxes across periodic images: every one that meets, once, and no other."""

from itertools import combinations_with_replacement, pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.broadphase import MAX_CELL_DRIFT, cell_drift
from mdtopo.geometry.bundles import NARROWING, bundle_starts, edge_boxes, joint_boxes
from mdtopo.geometry.imagebundles import meetings_in_cell, pairs_across_images, pairs_of_images
from mdtopo.geometry.lattice import basis_of
from mdtopo.records import Strands, Traces

Points = NDArray[np.float64]
Pair = tuple[int, int, int, int, int]

SPAN = 2
CELLS = {
    "cube": np.eye(3),
    "skewed": np.array([[1, 0, 0], [0.4, 0.9, 0], [-0.45, 0.4, 0.8]]),
    "flat": np.diag([1.0, 1.3, 0.7]),
    "left-handed": np.array([[0, 1.0, 0], [1.1, 0.2, 0], [0.1, 0.3, 0.9]]),
}


def chains(rng: np.random.Generator, lengths: list[int]) -> tuple[Points, Traces]:
    """Coils of edges of 0.5, spread over a few cells."""
    steps = rng.normal(size=(sum(lengths), 3))
    steps *= 0.5 / np.linalg.norm(steps, axis=1, keepdims=True)
    starts = np.concatenate([[0], np.cumsum(lengths)])
    x = np.concatenate([rng.uniform(-6, 6, 3) + steps[a:b].cumsum(axis=0) for a, b in pairwise(starts)])
    return x, Traces.of(Strands.from_lengths(lengths))


def gaps(x0: Points, x1: Points, t: Traces, pads: Points, cells: tuple[Points, Points]) -> dict[Pair, float]:
    """Return by how much the boxes of each pair are apart along some axis, for each image that is not far away."""
    low0, high0, low1, high1 = (
        of(x[t.edges], axis=1) + sign * pads[:, np.newaxis]
        for x in (x0, x1)
        for of, sign in ((np.min, -1.0), (np.max, 1.0))
    )
    found = {}
    low, high = np.minimum(low0, low1), np.maximum(high0, high1)
    middle = 0.5 * (low + high)
    counts = np.array(list(product(range(-SPAN, SPAN + 1), repeat=3)))
    for i, j in combinations_with_replacement(range(len(low)), 2):
        images = counts + np.rint(np.linalg.solve(cells[0].T, middle[i] - middle[j])).astype(int)
        a, b = images @ cells[0], images @ cells[1]
        gap = np.maximum(low[j] + np.minimum(a, b) - high[i], low[i] - high[j] - np.maximum(a, b)).max(axis=1)
        for k in np.flatnonzero(gap <= 1.0):
            image = tuple(images[k].tolist())
            if i < j or image > (0, 0, 0):
                found[(i, j, *image)] = float(gap[k])
    return found  # type: ignore[return-value]


@pytest.mark.parametrize("stretch", [0.0, 0.03])
@pytest.mark.parametrize("cell", CELLS)
def test_every_image_whose_box_meets_is_listed_once(cell: str, stretch: float) -> None:
    rng = np.random.default_rng([len(cell), int(100 * stretch)])
    x0, t = chains(rng, [70, 11, 2, 50])
    x1 = x0 + 0.05 * rng.normal(size=x0.shape)
    cell0 = 5.0 * CELLS[cell]
    cell1 = cell0 @ (np.eye(3) + stretch * rng.normal(size=(3, 3)))
    assert cell_drift(basis_of(cell0), basis_of(cell1)) < MAX_CELL_DRIFT
    pads = rng.uniform(0.05, 0.3, len(t.edges))
    starts = bundle_starts(t.trace)
    boxes = edge_boxes(x0, x1, t.edges, pads, starts)
    bases = basis_of(cell0), basis_of(cell1)
    meetings = meetings_in_cell(joint_boxes(boxes, starts), *bases)
    assert len(meetings.source) > len(starts) - 1, "there are ghosts"
    pairs, images = pairs_of_images(boxes, meetings, starts, t.trace, *bases)
    assert (pairs[:, 0] <= pairs[:, 1]).all()
    listed = [(int(i), int(j), *(int(k) for k in s)) for (i, j), s in zip(pairs, images, strict=True)]
    assert len(set(listed)) == len(listed), "a pair is listed twice"
    apart = gaps(x0, x1, t, pads, (cell0, cell1))
    alike = {p for p in apart if p[2:] == (0, 0, 0) and p[1] - p[0] <= 2 and t.trace[p[0]] == t.trace[p[1]]}
    expected = {p for p, gap in apart.items() if gap <= 0.0} - alike
    assert expected <= set(listed), "a pair whose boxes meet is missing"
    if stretch == 0.0:  # else a bundle at home and a ghost each grow by what their cells move
        rounding = 40.0 * NARROWING * float(np.abs(x0).max() + np.abs(cell0).sum())
        assert all(apart[p] <= rounding for p in listed), "a pair is listed whose boxes do not meet"
    assert sum(p[2:] != (0, 0, 0) for p in expected) > 20
    some, of_some = pairs_across_images(boxes, meetings, meetings.near[3:9], starts, *bases)
    assert {(int(i), int(j), *map(int, s)) for (i, j), s in zip(some, of_some, strict=True)} <= set(listed)


def test_a_strand_meets_its_own_image() -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    t = Traces.of(Strands.from_lengths([3]))
    starts = bundle_starts(t.trace)
    boxes = edge_boxes(x, x, t.edges, np.full(2, 0.2), starts)
    basis = basis_of(np.diag([9.0, 9.0, 9.0]))
    assert (
        len(
            pairs_of_images(
                boxes, meetings_in_cell(joint_boxes(boxes, starts), basis, basis), starts, t.trace, basis, basis
            )[0]
        )
        == 0
    )
    basis = basis_of(np.diag([2.3, 9.0, 9.0]))
    meetings = meetings_in_cell(joint_boxes(boxes, starts), basis, basis)
    pairs, images = pairs_of_images(boxes, meetings, starts, t.trace, basis, basis)
    assert (pairs.tolist(), images.tolist()) == ([[0, 1]], [[-1, 0, 0]])


def test_bundles_that_are_long_beside_the_cell_are_not_placed() -> None:
    boxes = np.array([[0.0], [0], [0], [30], [1], [1]], dtype=np.float32)
    basis = basis_of(10.0 * np.eye(3))
    assert len(meetings_in_cell(boxes, basis, basis).source) == 0
