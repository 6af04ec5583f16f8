"""Every contact of a linear motion, told apart into crossings and degenerate contacts in rational arithmetic.

Two edges a + s·u and c + r·v, with u = b - a, v = d - c, w = c - a linear in t, lie in one plane where
F(t) = det(a - c, u, v) = 0. Where n = u×v ≠ 0 the lines then meet at s = (w×v)·n/n² and r = (w×u)·n/n².
Whether 0 < s < 1 is a question of the signs of polynomials at a root of F, and these are decided exactly.

A crossing (`Event`) is a root of odd order inside (0, 1) with both parameters strictly inside. Its sign is
that of F after it: +1 where the volume det(a - c, b - a, d - c) rises through zero, -1 where it falls. This
is the change of the Gauss linking number, or half the change of the writhe, that the crossing brings. It
stays when the two edges are exchanged or both are reversed, and flips when one is reversed, in a mirror and
in reversed time. Anything else that touches is a `Contact` with its reason.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import chain, pairwise
from math import lcm
from typing import Any

import numpy as np

from oracles.distances import Edge, disjoint_terms, image_terms
from oracles.exact import Number, cross, dot, exact_points, fraction, minus, plus, scaled
from oracles.lattice import Shift, shifts_within
from oracles.polynomials import (
    Poly,
    Polynomial,
    Root,
    at,
    derivative,
    sign_at,
    subtracted,
    trimmed,
    unit_roots,
    value_at,
)

ExactPair = list[list[list[Fraction]]]
WholePair = list[list[list[int]]]


@dataclass(frozen=True)
class Event:
    """One crossing; its time lies in [t_low, t_high], a point if a simple fraction; then s, r are exact."""

    t_low: Fraction
    t_high: Fraction
    s: Fraction
    r: Fraction
    sign: int
    first: Edge = (0, 1)
    second: Edge = (2, 3)
    shift: Shift = (0, 0, 0)

    @property
    def t(self) -> float:
        return float((self.t_low + self.t_high) / 2)


@dataclass(frozen=True)
class Contact:
    """A contact that is no crossing, during [t_low, t_high]: mostly a point, or the enclosure of one.

    Reasons: "frame" (at t = 0 or 1), "touch" (inside both edges without passing), "vertex" (at an end of an
    edge), "parallel" (parallel edges, or one without length), "coplanar" (in one plane all the time).
    """

    t_low: Fraction
    t_high: Fraction
    reason: str
    first: Edge = (0, 1)
    second: Edge = (2, 3)
    shift: Shift = (0, 0, 0)


@dataclass(frozen=True)
class Passages:
    """All crossings and all degenerate contacts of one step, each in order of time."""

    events: tuple[Event, ...]
    contacts: tuple[Contact, ...]


def _moving(x0: Sequence[int], x1: Sequence[int]) -> list[Poly]:
    return [Poly(trimmed([p, q - p])) for p, q in zip(x0, x1, strict=True)]


class _Signs:
    """The polynomials whose signs decide about contact; see `_state`."""

    def __init__(self, pair0: WholePair, pair1: WholePair) -> None:
        ends = zip(chain(*pair0), chain(*pair1), strict=True)
        self._points = a, b, c, d = [_moving(*two) for two in ends]
        self._edges = u, v, w = minus(b, a), minus(d, c), minus(c, a)
        self._n = cross(u, v)
        self.volume: Polynomial = dot(scaled(-1, w), self._n).p

    @cached_property
    def normal(self) -> Polynomial:
        """n², zero where the edges are parallel."""
        return dot(self._n, self._n).p

    @cached_property
    def parameters(self) -> tuple[Polynomial, Polynomial]:
        """The parameters s and r, both times n²."""
        u, v, w = self._edges
        return dot(cross(w, v), self._n).p, dot(cross(w, u), self._n).p

    @cached_property
    def inside(self) -> list[Polynomial]:
        """s, 1 - s, r and 1 - r, all times n²: positive where the lines meet inside both edges."""
        s, r = self.parameters
        return [s, subtracted(self.normal, s), r, subtracted(self.normal, r)]

    @cached_property
    def on_segment(self) -> list[tuple[Polynomial, Polynomial]]:
        """For the ends a, b against cd and c, d against ab; see `_on_segment`."""
        a, b, c, d = self._points
        return [_on_segment(*three) for three in ((a, c, d), (b, c, d), (c, a, b), (d, a, b))]


def _on_segment(p: list[Poly], q: list[Poly], r: list[Poly]) -> tuple[Polynomial, Polynomial]:
    """Return |(q-p)×(r-p)|² and (q-p)·(r-p): p lies on qr where the first is zero and the second ≤ 0."""
    e, f = minus(q, p), minus(r, p)
    area = cross(e, f)
    return dot(area, area).p, dot(e, f).p


def _state(signs: _Signs, root: Root) -> str | None:
    """Return how two edges in one plane meet: inside both ("touch"), at an end, parallel, or not (None).

    Parallel segments, or a segment and a point, meet exactly where an end of one lies on the other.
    """
    if sign_at(signs.normal, root) == 0:
        meets = any(sign_at(area, root) == 0 and sign_at(along, root) <= 0 for area, along in signs.on_segment)
        return "parallel" if meets else None
    least = min(sign_at(p, root) for p in signs.inside)
    return {1: "touch", 0: "vertex", -1: None}[least]


def pair_passages(pair0: Sequence[Any], pair1: Sequence[Any]) -> Passages:
    """Return the crossings and contacts of one moving pair, [[a, b], [c, d]] at the start and at the end.

    A vertex is an edge of length zero, [p, p].
    """
    signs = _Signs(*_whole_numbers(*([exact_points(edge) for edge in pair] for pair in (pair0, pair1))))
    if signs.volume:
        return _isolated(signs)
    return Passages((), tuple(_sliding(signs)))


def _whole_numbers(pair0: ExactPair, pair1: ExactPair) -> tuple[WholePair, WholePair]:
    """Return the pair in the unit in which all coordinates are integers: times and parameters stay, and it is fast."""
    scale = lcm(*(x.denominator for pair in (pair0, pair1) for edge in pair for point in edge for x in point))
    one, other = (
        [[[x.numerator * (scale // x.denominator) for x in point] for point in edge] for edge in pair]
        for pair in (pair0, pair1)
    )
    return one, other


def _isolated(signs: _Signs) -> Passages:
    """Return the contacts of a pair that is in one plane at isolated times only."""
    events: list[Event] = []
    contacts: list[Contact] = []
    for root in unit_roots(signs.volume):
        state = _state(signs, root)
        turn = _turn(signs.volume, root)
        if state is None:
            continue
        if root.low == root.high and root.low in (0, 1):
            contacts.append(Contact(root.low, root.high, "frame"))
        elif state == "touch" and turn != 0:
            s, r = (value_at(p, root.middle) / value_at(signs.normal, root.middle) for p in signs.parameters)
            events.append(Event(root.low, root.high, s, r, turn))
        else:
            contacts.append(Contact(root.low, root.high, state))
    return Passages(tuple(events), tuple(contacts))


def _turn(p: Polynomial, root: Root) -> int:
    """Return the sign of p just after a root of odd order (the opposite before it), 0 at an even order."""
    order, value = 0, 0
    while value == 0:
        p, order = derivative(p), order + 1
        value = sign_at(p, root)
    return value if order % 2 else 0


def _sliding(signs: _Signs) -> Iterator[Contact]:
    """Yield the maximal intervals of contact of a pair that is in one plane all the time.

    Whether there is contact can change only at roots of the deciding polynomials; contact is closed, so it is
    enough to look at these roots and once between neighbours.
    """
    deciding = [signs.normal, *signs.inside] if signs.normal else [p for two in signs.on_segment for p in two]
    found = [root for p in deciding if p for root in unit_roots(p)]
    found = sorted([at(0), *found, at(1)], key=lambda root: root.low)
    times = [found[0]]
    for before, after in pairwise(found):
        if before.high < after.low:
            times.append(at((before.high + after.low) / 2))
        times.append(after)
    meeting: list[Root] = []
    for root in times:
        if _state(signs, root):
            meeting.append(root)
        elif meeting:
            yield _coplanar(meeting)
            meeting = []
    if meeting:
        yield _coplanar(meeting)


def _coplanar(meeting: list[Root]) -> Contact:
    return Contact(meeting[0].low, meeting[-1].high, "coplanar")


def is_free(pair0: Sequence[Any], pair1: Sequence[Any]) -> bool:
    """Return True exactly when the two moving edges have no point in common at any time in [0, 1]."""
    found = pair_passages(pair0, pair1)
    return not found.events and not found.contacts


def passages(
    x0: Sequence[Sequence[Number]],
    x1: Sequence[Sequence[Number]],
    offsets: Sequence[int],
    closed: Sequence[bool],
    *,
    cell0: Sequence[Sequence[Number]] | None = None,
    cell1: Sequence[Sequence[Number]] | None = None,
    pairs: Sequence[tuple[Edge, Edge]] | None = None,
) -> Passages:
    """Return all crossings and degenerate contacts of the linear motion from x0 to x1.

    Tested are the terms of ν (`disjoint_terms`): a vertex term can give contacts only. With cells, also all
    images within reach: the second edge is shifted by s·H(t), H linear in t. `pairs` restricts the search to
    these pairs of edges, in this order and direction, whether or not they are terms of ν.
    """
    points = exact_points(x0), exact_points(x1)
    cells = None if cell0 is None or cell1 is None else (exact_points(cell0), exact_points(cell1))
    events: list[Event] = []
    contacts: list[Contact] = []
    for first, second, shift in _candidates(points, cells, offsets, closed, pairs):
        ends = [_placed(points[k], first, second, shift, cells and cells[k]) for k in (0, 1)]
        if _boxes_meet(*ends):
            found = pair_passages(*ends)
            events += [replace(e, first=first, second=second, shift=shift) for e in found.events]
            contacts += [replace(c, first=first, second=second, shift=shift) for c in found.contacts]
    events.sort(key=lambda e: e.t_low)
    contacts.sort(key=lambda c: c.t_low)
    return Passages(tuple(events), tuple(contacts))


def _candidates(
    points: tuple[Any, Any],
    cells: tuple[Any, Any] | None,
    offsets: Sequence[int],
    closed: Sequence[bool],
    pairs: Sequence[tuple[Edge, Edge]] | None,
) -> Iterator[tuple[Edge, Edge, Shift]]:
    chosen = None if pairs is None else [((int(a), int(b)), (int(c), int(d))) for (a, b), (c, d) in pairs]
    for first, second, *_ in disjoint_terms(offsets, closed) if chosen is None else chosen:
        if not set(first) & set(second):
            yield first, second, (0, 0, 0)
    if cells is None:
        return
    x0, x1, h0, h1 = (np.array(values, dtype=np.float64) for values in (*points, *cells))
    for first, second, *_ in image_terms(offsets, closed) if chosen is None else chosen:
        both = [first, second]
        for shift in shifts_within(x0[both], x1[both], h0, h1, 0.0):
            if shift != (0, 0, 0) and (first != second or shift > (0, 0, 0)):
                yield first, second, shift


def _placed(x: list[list[Fraction]], first: Edge, second: Edge, shift: Shift, cell: Any) -> ExactPair:
    """Return the pair's four points, the second edge moved into its image."""
    other = [x[i] for i in second]
    if any(shift):
        for count, row in zip(shift, cell, strict=True):
            other = [plus(p, scaled(fraction(count), row)) for p in other]
    return [[x[i] for i in first], other]


def _boxes_meet(pair0: ExactPair, pair1: ExactPair) -> bool:
    """Return False where the boxes swept by the two edges are apart: then there is no contact."""
    one, other = pair0[0] + pair1[0], pair0[1] + pair1[1]
    return all(
        max(min(p[k] for p in one), min(p[k] for p in other)) <= min(max(p[k] for p in one), max(p[k] for p in other))
        for k in range(3)
    )
