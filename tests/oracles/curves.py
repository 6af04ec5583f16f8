"""Where a composite Bezier curve meets itself, at rest and while its control points move linearly: exact.

Each question is one about zeros of a polynomial map (`oracles.zeros`): of A(u) - B(v) for two segments; of the same
with the common point divided out for two that follow each other; of (A(u) - A(v)) / (u - v) for one with itself, which
is zero at a cusp as well. A moving curve has the time as a third unknown, and its zeros are its passages. At rest there
are more equations than unknowns in space, so that a contact is shown in the plane only; elsewhere it is `undecided`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from oracles.beziers import (
    Whole,
    bezier_derivative,
    bezier_point,
    difference,
    divided_difference,
    joint_charts,
    restricted,
    whole_numbers,
)
from oracles.exact import Number, cross, dot, fraction, minus
from oracles.zeros import Box, Zero, zeros

HALF = Fraction(1, 2)


class Place(NamedTuple):
    """A parameter of the composite curve: which segment, and where on it."""

    segment: int
    u: float


@dataclass(frozen=True)
class Meeting:
    """A passage: when and at which two places of the curve (`first` comes first), and its sign.

    +1 where det(A - B, A', B') rises through zero, as for edges. At rest t is 0 and the sign too.
    """

    t: float
    first: Place
    second: Place
    sign: int


@dataclass(frozen=True)
class Meetings:
    """All passages, and the places where none is shown and none excluded: touches, cusps, contact in a frame."""

    meetings: tuple[Meeting, ...]
    undecided: tuple[Meeting, ...]

    @property
    def is_free(self) -> bool:
        return not self.meetings and not self.undecided


class _Piece(NamedTuple):
    """Part of a segment: its coefficients (times, degree + 1, dim), and which parameters of the segment it holds."""

    points: Whole
    segment: int
    low: Fraction
    high: Fraction

    def place(self, u: float) -> Place:
        return Place(self.segment, float(self.low) + u * float(self.high - self.low))


def following_of(lengths: Sequence[int], closed: Sequence[bool]) -> list[int]:
    """Return for each segment of strands, so many segments long, the one that follows it; -1 where none does."""
    after: list[int] = []
    for n, ring in zip(lengths, closed, strict=True):
        start = len(after)
        after += [*range(start + 1, start + n), start if ring else -1]
    return after


def moving_meetings(
    points0: Any, points1: Any, following: Sequence[int], *, shift: Any = None, most_pieces: int = 3000
) -> Meetings:
    """Return the passages of a curve whose control points (m, degree + 1, 3) move from points0 to points1.

    With a shift, (2, 3), only those of the curve with its own image, moved by shift[0] at the start and shift[1] at
    the end.
    """
    if shift is not None:
        start, end, there = whole_numbers(points0, points1, shift)
        return _image_meetings(np.stack([start, end], axis=1), there[:, np.newaxis], most_pieces)
    start, end = whole_numbers(points0, points1)
    return _meetings(np.stack([start, end], axis=1), following, most_pieces)


def static_meetings(points: Any, following: Sequence[int], *, most_pieces: int = 3000) -> Meetings:
    """Return where a curve at rest meets itself or has a cusp: shown in the plane, in space `undecided` at best."""
    (whole,) = whole_numbers(points)
    return _meetings(whole[:, np.newaxis], following, most_pieces)


def curve_at(points0: Any, points1: Any, t: Number) -> list[list[list[Fraction]]]:
    """Return the control points at the time t, exactly."""
    at = fraction(t)
    return [
        [
            [(1 - at) * fraction(a) + at * fraction(b) for a, b in zip(p, q, strict=True)]
            for p, q in zip(s, r, strict=True)
        ]
        for s, r in zip(points0, points1, strict=True)
    ]


def is_contact(points: Any, first: tuple[int, Number], second: tuple[int, Number]) -> bool:
    """Return whether two places of a curve at rest are the same point, exactly: a contact that needs no search."""
    one, other = (bezier_point(points[segment], u) for segment, u in (first, second))
    return one == other


def _meetings(segments: Whole, following: Sequence[int], most_pieces: int) -> Meetings:
    pieces, after = _pieces(segments, following)
    found: list[tuple[_Piece, _Piece, str, Whole]] = []
    for piece in pieces:
        if piece.points.shape[1] > 2:
            found.append((piece, piece, "self", divided_difference(piece.points)))
    for i, j in combinations(range(len(pieces)), 2):
        one, other = pieces[i], pieces[j]
        if after[j] == i:
            one, other = other, one
        if after[i] == j or after[j] == i:
            near, far = joint_charts(one.points, other.points)
            found += [(one, other, "near", near), (one, other, "far", far)]
        elif _boxes_meet(one.points, other.points):
            found.append((one, other, "pair", difference(one.points, other.points)))
    return _collected(found, most_pieces)


def _image_meetings(segments: Whole, shift: Whole, most_pieces: int) -> Meetings:
    pieces = [_Piece(s, k, Fraction(0), Fraction(1)) for k, s in enumerate(segments)]
    moved = [piece._replace(points=piece.points + shift) for piece in pieces]
    found = [
        (a, b, "pair", difference(a.points, b.points)) for a in pieces for b in moved if _boxes_meet(a.points, b.points)
    ]
    return _collected(found, most_pieces)


def _pieces(segments: Whole, following: Sequence[int]) -> tuple[list[_Piece], list[int]]:
    """Return the segments as pieces; those of a ring of one or two are quartered, so that no two have two joints."""
    pieces = [_Piece(s, k, Fraction(0), Fraction(1)) for k, s in enumerate(segments)]
    after = list(following)
    while any(j >= 0 and (j == i or after[j] == i) for i, j in enumerate(after)):
        halves = [h for p in pieces for h in _halves(p)]
        after = [k + 1 if k % 2 == 0 else (2 * after[k // 2] if after[k // 2] >= 0 else -1) for k in range(len(halves))]
        pieces = halves
    return pieces, after


def _halves(piece: _Piece) -> Iterator[_Piece]:
    middle = (piece.low + piece.high) / 2
    yield _Piece(restricted(piece.points, 1, 0, HALF), piece.segment, piece.low, middle)
    yield _Piece(restricted(piece.points, 1, HALF, 1), piece.segment, middle, piece.high)


def _boxes_meet(one: Whole, other: Whole) -> bool:
    """Return whether the boxes around all control points, at all times, have a point in common."""
    a, b = (x.reshape(-1, x.shape[-1]) for x in (one, other))
    return bool(((a.min(axis=0) <= b.max(axis=0)) & (b.min(axis=0) <= a.max(axis=0))).all())


def _collected(found: list[tuple[_Piece, _Piece, str, Whole]], most_pieces: int) -> Meetings:
    meetings: list[Meeting] = []
    undecided: list[Meeting] = []
    for one, other, kind, f in found:
        g = f if f.shape[0] > 1 else f[0]
        result = zeros(g, most_pieces=most_pieces)
        moving = g.ndim == 4
        for zero in result.simple:
            meeting = _meeting(one, other, kind, zero.box, _sign(kind, zero) if moving else 0, moving)
            if kind != "self" or meeting.first.u < meeting.second.u:
                meetings.append(meeting)
        for box in result.undecided:
            if kind != "self" or box.low[-2] < box.high[-1]:  # its mirror image in u = v is there too
                undecided.append(_meeting(one, other, kind, box, 0, moving))
    return Meetings(tuple(sorted(meetings, key=lambda m: m.t)), tuple(undecided))


SIGNS = {"pair": -1, "self": 1, "near": -1, "far": 1}
"""The sign of a passage over that of the Jacobian's determinant.

Of F = A(u) - B(v) over (t, u, v) it is -1, because det(F_t, A', -B') = -F_t·(A' × B'). Divided by u - v < 0, of which
the third power enters, it turns. In the charts of a joint (u, v) = (1 - s y, y), which keeps the orientation, or
(1 - x, s x), which turns it.
"""


def _sign(kind: str, zero: Zero) -> int:
    return SIGNS[kind] * zero.turn


def _meeting(one: _Piece, other: _Piece, kind: str, box: Box, sign: int, moving: bool) -> Meeting:
    middle = box.middle
    t, (x, y) = (middle[0], middle[1:]) if moving else (0.0, middle)
    u, v = {"pair": (x, y), "self": (x, y), "near": (1 - x * y, x), "far": (1 - x, x * y)}[kind]
    first, second = one.place(u), other.place(v)
    return Meeting(t, first, second, sign)


def passage_sign(points0: Any, points1: Any, t: Number, first: tuple[int, Number], second: tuple[int, Number]) -> int:
    """Return the sign of (A - B)_t·(A' × B') for two places at a time: that of a passage there, in rational numbers."""
    now = curve_at(points0, points1, t)
    (i, u), (j, v) = first, second
    speeds = [
        minus(bezier_point(points1[k], w), bezier_point(points0[k], w)) for k, w in ((i, fraction(u)), (j, fraction(v)))
    ]
    tangents = [bezier_point(bezier_derivative(now[k]), w) for k, w in ((i, u), (j, v))]
    value = dot(minus(*speeds), cross(*tangents))
    return (value > 0) - (value < 0)
