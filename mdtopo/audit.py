"""The self-audit: the crossings of a step must explain how its invariants change.

For closed strands the signed crossings between two of them equal the change of their linking number, and a self
crossing changes the writhe by 2 at its instant. Both are computed from positions alone, by code that the ladder does
not use. What disagrees is a bug, and said so. What agrees tells more: two strands whose linking number has changed, or
a strand whose knot determinant has, passed through each other on any path between the two frames.
"""

from collections import defaultdict
from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mdtopo.curves import StepMotion
from mdtopo.errors import AuditError, InputError
from mdtopo.geometry.knots import knot_determinant
from mdtopo.geometry.linking import linking_number, writhe
from mdtopo.passages import Decided, Meeting, meeting_of
from mdtopo.records import Traces
from mdtopo.typing import Indices, Points

INSTANTS = (1e-6, 1e-8, 1e-4)
"""How long before and after a self crossing the writhe is taken, as a share of the step."""

STEADY = 0.25
"""The writhe may change steadily by so much between the two, and its jump is still told."""

APART = 1e-9
"""Edges whose lines pass each other at this share of their lengths or more are apart, whatever the rounding."""

MOST_CROSSINGS = 400
"""Of a ring's diagram, for a look at its knot determinant: that takes some tenths of a second."""

HOME = (0, 0, 0)


class Event(NamedTuple):
    """A passage within a ring: time, sign, and the vertices of the two edges."""

    t: float
    sign: int
    pair: tuple[Indices, Indices]


def changed_invariants(motion: StepMotion, traces: Traces, decided: Decided, where: str) -> set[Meeting]:
    """Return which closed traces have an invariant that differs between the two frames of a step.

    Parameters
    ----------
    motion : StepMotion
    traces : Traces
    decided : Decided
        The step's passages; what an undecided pair touches is not audited.
    where : str
        Names the step in an error.

    Returns
    -------
    set of Meeting
        Pairs of traces (with the image of the second) whose linking number differs, and traces, as pairs with
        themselves, whose knot determinant differs.

    Raises
    ------
    AuditError
        If passages and invariants contradict each other.
    """
    if not traces.closed.any():
        return set()
    events: dict[Meeting, list[Event]] = defaultdict(list)
    for row in decided.passages:
        pair = (traces.edges[int(row[0])], traces.edges[int(row[1])])
        events[meeting_of(row, traces)].append(Event(float(row[5]), int(row[11]), pair))
    unknown = {meeting_of(row, traces) for row in decided.open_pairs}
    changed = set()
    for meeting in sorted(set(close_rings(motion, traces)) | events.keys()):
        a, b, image = meeting
        if meeting in unknown or not (traces.closed[a] and traces.closed[b]):
            continue
        if a == b and image == HOME:
            differs = bool(events[meeting]) and _is_knotted_anew(motion, traces, a, events[meeting], where)
        else:
            differs = _is_linked_anew(motion, traces, meeting, sum(event.sign for event in events[meeting]), where)
        if differs:
            changed.add(meeting)
    return changed


def close_rings(motion: StepMotion, traces: Traces) -> Iterator[Meeting]:
    """Yield the pairs of closed traces, and of a trace with its own images, whose boxes overlap at one end at least."""
    rings = np.flatnonzero(traces.closed)
    periodic = bool(motion.cell0.any())
    reach = [_fractional_boxes(x, cell, traces, rings, periodic) for x, cell in _ends(motion)]
    low = np.minimum(*(np.ceil(mins[:, None] - maxs[None]) for mins, maxs in reach)).astype(np.int64)
    high = np.maximum(*(np.floor(maxs[:, None] - mins[None]) for mins, maxs in reach)).astype(np.int64)
    if not periodic:  # there is one image, and it overlaps or does not
        low, high = np.maximum(low, 0), np.minimum(high, 0)
    for p, q in np.argwhere((low <= high).all(axis=2)):
        if p > q:
            continue
        x, y, z = (range(m, n + 1) for m, n in zip(low[p, q].tolist(), high[p, q].tolist(), strict=True))
        for image in product(x, y, z):
            if p < q or image > HOME:
                mirrored = (-image[0], -image[1], -image[2])
                yield min((int(rings[p]), int(rings[q]), image), (int(rings[q]), int(rings[p]), mirrored))


def _ends(motion: StepMotion) -> tuple[tuple[Points, Points], tuple[Points, Points]]:
    return (motion.x0, motion.cell0), (motion.x1, motion.cell1)


def _fractional_boxes(
    x: Points, cell: Points, traces: Traces, rings: NDArray[np.intp], periodic: bool
) -> tuple[Points, Points]:
    """Return the least and greatest coordinates of each ring, in units of the cell where there is one."""
    scaled = np.linalg.solve(cell.T, x.T).T if periodic else x
    members = [scaled[traces.vertices[traces.offsets[g] : traces.offsets[g + 1]]] for g in rings]
    return np.array([m.min(axis=0) for m in members]), np.array([m.max(axis=0) for m in members])


def _ring(x: Points, traces: Traces, g: int) -> Points:
    return x[traces.vertices[traces.offsets[g] : traces.offsets[g + 1]]]


def _is_linked_anew(motion: StepMotion, traces: Traces, meeting: Meeting, signs: int, where: str) -> bool:
    """Return whether a linking number differs between the frames, after a look whether the passages explain it."""
    a, b, image = meeting
    try:
        before, after = (
            linking_number(_ring(x, traces, a), _ring(x, traces, b) + np.array(image) @ cell)
            for x, cell in _ends(motion)
        )
    except InputError:  # they touch in a frame, and have no linking number there
        return False
    if after - before != signs:
        raise AuditError(
            f"Self-audit, {where}: the linking number of rings {a} and {b} (image {image}) goes from {before} to "
            f"{after}, but their signed crossings add up to {signs:+d}. This is a bug in mdtopo; please report it."
        )
    return before != after


def _is_knotted_anew(motion: StepMotion, traces: Traces, ring: int, events: list[Event], where: str) -> bool:
    """Return whether a knot determinant differs, after a look whether the writhe jumps at each self crossing."""
    x0, x1 = _ring(motion.x0, traces, ring), _ring(motion.x1, traces, ring)
    for event in events:
        if _jumps_rightly(motion, (x0, x1), event.t, events) is False:
            raise AuditError(
                f"Self-audit, {where}: the writhe of ring {ring} does not jump by 2 at its self crossing at "
                f"t = {event.t:.12g}. This is a bug in mdtopo; please report it."
            )
    try:
        return knot_determinant(x0, MOST_CROSSINGS) != knot_determinant(x1, MOST_CROSSINGS)
    except InputError:  # it touches itself in a frame, or is too tangled
        return False


def _jumps_rightly(motion: StepMotion, ring: tuple[Points, Points], t: float, events: list[Event]) -> bool | None:
    """Return whether the writhe jumps at a time by twice the signs of the crossings; None where that cannot be told."""
    answers = []
    for span in (min(instant, 0.5 * t, 0.5 * (1.0 - t)) for instant in INSTANTS):
        before, after = (_between(*ring, s) for s in (t - span, t + span))
        near = [event for event in events if abs(event.t - t) < 2.0 * span]
        clear = all(_are_apart(motion, event, s) for event in near for s in (t - span, t + span))
        if not clear or not steady_change(before, after) < STEADY:
            continue
        expected = 2 * sum(event.sign for event in near if abs(event.t - t) < span)
        answers.append(abs(writhe(after) - writhe(before) - expected) < 0.5)
        if answers[-1]:
            return True
    return False if answers else None


def _between(x0: Points, x1: Points, t: float) -> Points:
    return (1.0 - t) * x0 + t * x1


def _are_apart(motion: StepMotion, event: Event, t: float) -> bool:
    """Return whether the lines of a crossing's edges are so far apart at a time that rounding cannot hide it."""
    (a, b), (c, d) = (_between(motion.x0[edge], motion.x1[edge], t) for edge in event.pair)
    normal = np.cross(b - a, d - c)
    lengths = np.linalg.norm(b - a) * np.linalg.norm(d - c)
    return bool(abs((c - a) @ normal) > APART * lengths * np.linalg.norm([b - a, d - c]))


def steady_change(before: Points, after: Points) -> float:
    """Return an upper bound of how much the writhe of a ring changes between two shapes, jumps by 2 left out.

    Guarantee
    ---------
    Proven to first order: the writhe is A/2π - 1 modulo 2, with A the area on the sphere that the tangents enclose
    (Fuller 1978). An arc between the tangents of two edges sweeps at most what its ends move, times 2√2 over the length
    of their sum: near an edge that folds back on the one before, it may sweep anything.
    """
    tangents = [np.roll(x, -1, axis=0) - x for x in (before, after)]
    with np.errstate(invalid="ignore", divide="ignore"):
        old, new = (e / np.linalg.norm(e, axis=1, keepdims=True) for e in tangents)
        turn = np.linalg.norm(new - old, axis=1)
        bend = np.linalg.norm(old + np.roll(old, -1, axis=0), axis=1)
        swept = (turn + np.roll(turn, -1)) * 2.0 * np.sqrt(2.0) / bend
    return float(swept.sum() / (2.0 * np.pi))
