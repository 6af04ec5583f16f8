"""When do two edges meet whose vertices move linearly? Decided in integers, without rounding.

Two edges a + s·u and c + r·v, with u = b - a, v = d - c and w = c - a linear in t, lie in one plane where
F(t) = det(a - c, u, v) = -w·(u × v) is zero. With n = u × v ≠ 0 their lines then meet at s = (w × v)·n/n² and
r = (w × u)·n/n². A crossing is a time inside (0, 1) at which F changes its sign and both parameters are strictly
inside; its sign is +1 where F rises. All else that meets is a contact.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

from mdtopo.referee.polynomials import (
    Polynomial,
    Root,
    bernstein,
    minus,
    plus,
    point_root,
    sign_at,
    times,
    trimmed,
    turn_at,
    unit_roots,
    value,
)

Whole: TypeAlias = Sequence[int]
"""Three integers: a point in a unit that makes its coordinates whole numbers."""

MovingVector: TypeAlias = tuple[Polynomial, Polynomial, Polynomial]


@dataclass(frozen=True, slots=True)
class Meeting:
    """One time at which two edges meet.

    Attributes
    ----------
    t : float
        In [0, 1].
    sign : int
        +1 or -1 for a crossing, 0 for a contact.
    s, r : float
        Where on the edges; NaN where a contact has no such place.
    kind : str
        ``crossing``; or of a contact: ``frame`` (at t = 0 or 1), ``touch`` (inside both without passing), ``vertex``
        (at an end of an edge), ``parallel`` (the edges are parallel then), ``coplanar`` (in one plane all the time).
    """

    t: float
    sign: int
    s: float
    r: float
    kind: str


def judge_pair(start: Sequence[Whole], end: Sequence[Whole]) -> tuple[Meeting, ...]:
    """Return every meeting of two moving edges, in order of time.

    Parameters
    ----------
    start, end : sequence of four points
        The vertices a, b, c, d at t = 0 and t = 1, in whole numbers.

    Guarantee
    ---------
    Exact: no meeting is missed, and none is invented. Of edges in one plane all the time, at least the first meeting is
    given.
    """
    pair = _Pair(start, end)
    if pair.volume:
        coefficients = bernstein(pair.volume)
        if min(coefficients) > 0 or max(coefficients) < 0:
            return ()
        return tuple(_meetings(pair))
    return tuple(_slides(pair))


class _Pair:
    """The polynomials whose signs decide."""

    def __init__(self, start: Sequence[Whole], end: Sequence[Whole]) -> None:
        a, b, c, d = self.vertices = tuple(_moving(p, q) for p, q in zip(start, end, strict=True))
        self.u, self.v, self.w = _difference(b, a), _difference(d, c), _difference(c, a)
        self.normal = _cross(self.u, self.v)
        self.volume = minus((), _dot(self.w, self.normal))

    @cached_property
    def squared_normal(self) -> Polynomial:
        """Square of the common normal, as a polynomial of time."""
        return _dot(self.normal, self.normal)

    @cached_property
    def parameters(self) -> tuple[Polynomial, Polynomial]:
        """The parameters s and r, both times n²."""
        return _dot(_cross(self.w, self.v), self.normal), _dot(_cross(self.w, self.u), self.normal)

    @cached_property
    def inside(self) -> tuple[Polynomial, ...]:
        """Positive where the lines meet inside both edges: s, 1 - s, r and 1 - r, times n²."""
        s, r = self.parameters
        return s, minus(self.squared_normal, s), r, minus(self.squared_normal, r)

    @cached_property
    def ends_on_edges(self) -> tuple[tuple[Polynomial, Polynomial], ...]:
        """For each vertex p and the other edge qr: |(q - p) × (r - p)|², and (q - p)·(r - p)."""
        a, b, c, d = self.vertices
        found = []
        for p, q, r in ((a, c, d), (b, c, d), (c, a, b), (d, a, b)):
            e, f = _difference(q, p), _difference(r, p)
            area = _cross(e, f)
            found.append((_dot(area, area), _dot(e, f)))
        return tuple(found)

    def state(self, root: Root) -> str:
        """Return how the edges meet at a time when they are in one plane; empty where they do not."""
        if sign_at(self.squared_normal, root) == 0:
            # parallel edges meet where a vertex of one lies on the other: no area, and not beyond both ends
            on = any(sign_at(area, root) == 0 and sign_at(along, root) <= 0 for area, along in self.ends_on_edges)
            return "parallel" if on else ""
        least = min(sign_at(p, root) for p in self.inside)
        return {1: "touch", 0: "vertex", -1: ""}[least]

    def meeting(self, root: Root, sign: int, kind: str) -> Meeting:
        """Return the meeting at a root, with its place on both edges."""
        root = root.fine()
        size = value(self.squared_normal, root.middle)
        s, r = (float(value(p, root.middle) / size) if size else float("nan") for p in self.parameters)
        return Meeting(float(root.middle), sign, s, r, kind)


def _meetings(pair: _Pair) -> Iterator[Meeting]:
    """Yield the meetings of edges that are in one plane at single times only."""
    for root in unit_roots(pair.volume):
        state = pair.state(root)
        if not state:
            continue
        turn = turn_at(pair.volume, root)
        if root.is_point and root.k in (0, 1 << root.e):
            yield pair.meeting(root, 0, "frame")
        elif state == "touch" and turn:
            yield pair.meeting(root, turn, "crossing")
        else:
            yield pair.meeting(root, 0, state)


def _slides(pair: _Pair) -> Iterator[Meeting]:
    """Yield meetings of edges that are in one plane all the time.

    Contact begins at t = 0 or where one of the deciding polynomials has a root, so it is enough to look there.
    """
    if pair.squared_normal:
        deciding = [pair.squared_normal, *pair.inside]
    else:
        deciding = [p for both in pair.ends_on_edges for p in both]
    roots = [point_root(0), point_root(1), *(root for p in deciding if p for root in unit_roots(p))]
    for root in sorted(roots, key=lambda root: root.fine().middle):
        if pair.state(root):
            yield pair.meeting(root, 0, "coplanar")


def _moving(p: Whole, q: Whole) -> MovingVector:
    x, y, z = (trimmed((int(i), int(j) - int(i))) for i, j in zip(p, q, strict=True))
    return x, y, z


def _difference(p: MovingVector, q: MovingVector) -> MovingVector:
    return minus(p[0], q[0]), minus(p[1], q[1]), minus(p[2], q[2])


def _dot(p: MovingVector, q: MovingVector) -> Polynomial:
    return plus(plus(times(p[0], q[0]), times(p[1], q[1])), times(p[2], q[2]))


def _cross(p: MovingVector, q: MovingVector) -> MovingVector:
    return (
        minus(times(p[1], q[2]), times(p[2], q[1])),
        minus(times(p[2], q[0]), times(p[0], q[2])),
        minus(times(p[0], q[1]), times(p[1], q[0])),
    )
