"""Motions of composite curves, chosen to lie where a certificate is easily wrong, and what exact subdivision says."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from oracles.curves import (
    Meeting,
    Meetings,
    curve_at,
    following_of,
    is_contact,
    moving_meetings,
    static_meetings,
)
from oracles.splines import b_spline_cubics, catmull_rom_cubics, interpolating_cubics
from soundness.families import Generator, Points, powers, signs, unit

SAME_TIME, SAME_PLACE = 1e-7, 1e-5
"""A passage that is claimed is the exact one if times and parameters agree to this."""

MOST_PIECES = 400
"""Pieces that the oracle cuts one pair of segments into before it leaves it undecided."""


@dataclass(frozen=True)
class Motion:
    """Control points (m, degree + 1, 3) at both ends, how many segments each strand has, and which are closed.

    `touch` is an exact contact, as time and two places, where the motion was made to have one; `cells` are the lattice
    vectors at both ends, of a motion with periodic images.
    """

    start: Points
    end: Points
    lengths: tuple[int, ...]
    closed: tuple[bool, ...]
    touch: tuple[float, tuple[int, float], tuple[int, float]] | None = None
    cells: tuple[Points, Points] | None = None

    @property
    def following(self) -> list[int]:
        return following_of(self.lengths, self.closed)

    def in_hex(self) -> str:
        both = [[[[v.hex() for v in p] for p in s] for s in x.tolist()] for x in (self.start, self.end)]
        cells = None if self.cells is None else [[[v.hex() for v in row] for row in x.tolist()] for x in self.cells]
        return f"{both} {self.lengths} {self.closed} {cells}"


def joined(points: Points, lengths: Sequence[int], closed: Sequence[bool]) -> Points:
    """Return the segments with every first point at the last one of the segment before."""
    points, first = points.copy(), 0
    for n, ring in zip(lengths, closed, strict=True):
        points[first + 1 : first + n, 0] = points[first : first + n - 1, -1]
        if ring:
            points[first, 0] = points[first + n - 1, -1]
        first += n
    return points


def composite(rng: Generator) -> Motion:
    """Control points along a random walk, degree 2 to 6, one to three strands, open and closed."""
    strands = int(rng.integers(1, 4))
    lengths = tuple(int(n) for n in rng.integers(1, 4, size=strands))
    closed = tuple(bool(n > 2 and rng.random() < 0.5) for n in lengths)
    degree = int(rng.integers(2, 7))
    walk = rng.normal(size=(sum(lengths), degree + 1, 3)).cumsum(axis=1) * 0.5 + rng.normal(size=(sum(lengths), 1, 3))
    move = rng.normal(size=walk.shape) * 10.0 ** rng.uniform(-3, 0)
    return Motion(joined(walk, lengths, closed), joined(walk + move, lengths, closed), lengths, closed)


def spline(rng: Generator) -> Motion:
    """Splines through a random walk whose vertices move by a fraction of an edge."""
    n, ring = int(rng.integers(5, 12)), bool(rng.random() < 0.5)
    kind = (interpolating_cubics, b_spline_cubics, catmull_rom_cubics)[int(rng.integers(3))]
    x0 = unit(rng, n).cumsum(axis=0)
    x1 = x0 + rng.normal(size=x0.shape) * 10.0 ** rng.uniform(-2, -0.3)
    m = n if ring else n - 1
    start, end = (np.array(kind(x.tolist(), ring), dtype=np.float64) for x in (x0, x1))
    return Motion(joined(start, [m], [ring]), joined(end, [m], [ring]), (m,), (ring,))


def at(points: Points, u: float) -> Points:
    while len(points) > 1:
        points = (1 - u) * points[:-1] + u * points[1:]
    return points[0]


def two_segments(rng: Generator, gap: float, speed: float, *, degree: int = 3) -> Motion:
    """Two curves that at one time are `gap` apart across their common normal, with motions of the size `speed`."""
    n = degree + 1
    a, b = (np.linspace(-1, 1, n)[:, np.newaxis] * unit(rng, 1) + 0.3 * rng.normal(size=(n, 3)) for _ in range(2))
    u, v = rng.uniform(0.1, 0.9, size=2)
    normal = np.cross(*(at(np.diff(p, axis=0), w) for p, w in ((a, u), (b, v))))
    normal /= np.linalg.norm(normal)
    b = b + at(a, u) - at(b, v) + gap * normal
    t, both = rng.uniform(), np.stack([a, b])
    velocity = rng.normal(size=both.shape) * speed
    return Motion(both - t * velocity, both + (1 - t) * velocity, (1, 1), (False, False))


def near_touching(rng: Generator) -> Motion:
    gap = float(powers(rng, 1, -12, -3)[0])
    return two_segments(rng, gap * float(signs(rng, 1)[0]), gap * float(powers(rng, 1, -2, 1)[0]))


def grazing(rng: Generator) -> Motion:
    gap = float((signs(rng, 1) * powers(rng, 1, -12, -3))[0])
    return two_segments(rng, gap, float(powers(rng, 1, -3, 0)[0]), degree=int(rng.integers(1, 6)))


def sized(rng: Generator) -> Motion:
    """Near touching, in sizes from 1e-6 to 1e6 Å, some far from the origin."""
    motion = near_touching(rng)
    size, shift = float(powers(rng, 1, -6, 6)[0]), rng.choice([0.0, 1.0, 1e3]) * rng.normal(size=3)
    start, end = ((x + shift) * size for x in (motion.start, motion.end))
    return Motion(start, end, motion.lengths, motion.closed)


def nearly_cusped(rng: Generator) -> Motion:
    """The cubic of the paper's Fig. 2 about when its cusp becomes a loop, a little out of its plane."""
    out = float(powers(rng, 1, -6, 0)[0])
    first = np.array([[0, 0, 0], [1 / 3, 1, 0], [2 / 3, 1, 0], [1, 0, 0]])
    last = np.array([[0, 0, 0], [2, 1, 0], [-1, 1, 0], [1, 0, 0]])
    width = float(powers(rng, 1, -3, -0.3)[0])
    times = 0.4 - width, 0.4 + width * rng.uniform(-1, 1)
    start, end = ((1 - t) * first + t * last + out * rng.normal(size=(4, 3)) for t in times)
    return Motion(start[np.newaxis], end[np.newaxis], (1,), (False,))


def folds(rng: Generator) -> Motion:
    """Two segments that nearly turn back on each other at their joint."""
    turn = 10.0 ** rng.uniform(-4, 0)
    one = np.cumsum(np.array([1.0, 0, 0]) + 0.2 * turn * rng.normal(size=(3, 3)), axis=0)
    other = one[-1] + np.cumsum(np.array([-1.0, 0, 0]) + turn * rng.normal(size=(3, 3)), axis=0)
    both = np.stack([np.vstack([[0, 0, 0], one]), np.vstack([one[-1], other])])
    move = rng.normal(size=both.shape) * turn * 10.0 ** rng.uniform(-2, 0)
    move[1, 0] = move[0, -1]
    return Motion(both, joined(both + move, [2], [False]), (2,), (False,))


def exact_touch(rng: Generator) -> Motion:
    """Two curves with small whole coordinates that have one point in common, at half time in the middle of both."""
    degree = int(rng.integers(1, 7))
    unit_ = 2 ** (degree + 1)
    start, end = (rng.integers(-9, 10, size=(2, degree + 1, 3)).astype(float) * unit_ for _ in range(2))
    apart = at((start[0] + end[0]) / 2, 0.5) - at((start[1] + end[1]) / 2, 0.5)
    start[1] += apart
    end[1] += apart
    if rng.random() < 0.5:  # nothing moves: a touch at rest
        start = end = (start + end) / 2
    return Motion(start, end, (1, 1), (False, False), (0.5, (0, 0.5), (1, 0.5)))


def planar_at_rest(rng: Generator) -> Motion:
    """A curve in the plane that stands still: what it has in common with itself can be shown exactly."""
    still = composite(rng).start * np.array([1.0, 1.0, 0.0])
    lengths = (len(still),)
    still = joined(still + 3.0 * np.arange(len(still))[:, np.newaxis, np.newaxis] * [1.0, 0.3, 0.0], lengths, (False,))
    return Motion(still, still, lengths, (False,))


def through_the_boundary(rng: Generator) -> Motion:
    """Two curves of which an image of the second nearly touches the first, in skewed cells that change a little."""
    motion = (near_touching, grazing)[int(rng.integers(2))](rng)
    cell = rng.uniform(4.0, 8.0) * (np.eye(3) + rng.uniform(-0.3, 0.3, size=(3, 3)))
    cells = [dyadic(cell @ (np.eye(3) + rng.normal(scale=scale, size=(3, 3)))) for scale in (0.0, 0.01)]
    counts = rng.integers(-1, 2, size=3)
    ends = []
    for x, h in zip((motion.start, motion.end), cells, strict=True):
        ends.append(np.stack([x[0], x[1] - counts @ h]))
    return Motion(ends[0], ends[1], motion.lengths, motion.closed, cells=(cells[0], cells[1]))


def dyadic(cell: Points) -> Points:
    """Return a cell of which small multiples and their sums are floats."""
    return np.round(cell * 2.0**30) / 2.0**30


FAMILIES: dict[str, Callable[[Generator], Motion]] = {
    "composite": composite,
    "spline": spline,
    "near touching": near_touching,
    "grazing": grazing,
    "sized": sized,
    "nearly cusped": nearly_cusped,
    "folds": folds,
    "exact touch": exact_touch,
    "planar at rest": planar_at_rest,
    "through the boundary": through_the_boundary,
}


class Claim(NamedTuple):
    """What is said of a motion: that it is certified or not decided, or its passages."""

    certified: bool
    undecided: bool
    passages: tuple[Meeting, ...]


def is_touching(motion: Motion) -> bool:
    """Return whether the motion has the contact it was made to have, exactly."""
    if motion.touch is None:
        return False
    t, first, second = motion.touch
    return is_contact(curve_at(motion.start.tolist(), motion.end.tolist(), t), first, second)


def same(claim: Meeting, truth: Meeting) -> bool:
    one, other = sorted([claim.first, claim.second]), sorted([truth.first, truth.second])
    return (
        abs(claim.t - truth.t) <= SAME_TIME
        and claim.sign == truth.sign
        and all(p.segment == q.segment and abs(p.u - q.u) <= SAME_PLACE for p, q in zip(one, other, strict=True))
    )


def complaint(claim: Claim, exact: Meetings, touches: bool) -> str:
    """Return what is false in a claim, in a word or two; empty where nothing is shown to be."""
    if claim.certified and (exact.meetings or touches):
        return "false certificate"
    left = list(exact.meetings)
    for passage in claim.passages:
        hit = next((m for m in left if same(passage, m)), None)
        if hit is not None:
            left.remove(hit)
        elif not exact.undecided:
            return "false crossing"
    if left and not claim.undecided:
        return "missed crossing"
    return ""


def exact_meetings(motion: Motion, *, most_pieces: int = MOST_PIECES) -> Meetings:
    if not motion.start[..., 2].any() and np.array_equal(motion.start, motion.end):
        return static_meetings(motion.start[..., :2], motion.following, most_pieces=most_pieces)
    found = [moving_meetings(motion.start, motion.end, motion.following, most_pieces=most_pieces)]
    for shift in shifts_in_reach(motion):
        found.append(moving_meetings(motion.start, motion.end, motion.following, shift=shift, most_pieces=most_pieces))
    meetings = sorted((m for one in found for m in one.meetings), key=lambda m: m.t)
    return Meetings(tuple(meetings), tuple(m for one in found for m in one.undecided))


def shifts_in_reach(motion: Motion) -> Iterator[Points]:
    """Yield the shifts, (2, 3), by which the box of the motion may meet its own image; of ± one of the two."""
    if motion.cells is None:
        return
    both = np.stack([motion.start, motion.end]).reshape(2, -1, 3)
    size = (both.max(axis=(0, 1)) - both.min(axis=(0, 1))) * (1.0 + 1e-9)
    for counts in product(range(-9, 10), repeat=3):
        shift = np.stack([np.array(counts, dtype=float) @ cell for cell in motion.cells])
        if counts > (0, 0, 0) and (shift.min(axis=0) <= size).all() and (shift.max(axis=0) >= -size).all():
            yield shift


Claimant = Callable[[Motion], Claim]


@dataclass
class Tally:
    """How many motions were judged, what was said of them, and what was false: each a word and the motion."""

    certified: int = 0
    crossing: int = 0
    unresolved: int = 0
    undecided: int = 0
    false: tuple[str, ...] = ()

    @property
    def motions(self) -> int:
        return self.certified + self.crossing + self.unresolved

    def sentence(self, name: str) -> str:
        shares = [n / self.motions for n in (self.certified, self.crossing, self.unresolved)]
        return (
            f"{name}: {self.motions} motions, {shares[0]:.2%} certified, {shares[1]:.2%} crossing, "
            f"{shares[2]:.2%} unresolved, {self.undecided} undecided by the oracle, {len(self.false)} false"
        )


def judged(name: str, rng: Generator, n: int, claimant: Claimant) -> Tally:
    """Return what is false in what a claimant says of n motions of one family."""
    tally = Tally()
    for _ in range(n):
        motion = FAMILIES[name](rng)
        claim = claimant(motion)
        tally.certified += claim.certified
        tally.unresolved += claim.undecided
        tally.crossing += not claim.certified and not claim.undecided
        if claim.undecided and not claim.passages:
            continue
        exact = exact_meetings(motion, most_pieces=MOST_PIECES)
        tally.undecided += bool(exact.undecided)
        if wrong := complaint(claim, exact, is_touching(motion)):
            tally.false += (f"{wrong}: {motion.in_hex()}",)
    return tally
