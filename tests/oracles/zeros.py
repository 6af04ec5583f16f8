"""Zeros of a polynomial map on the unit box, by cutting the box: shown in whole numbers, each with an enclosure.

The map is given by its tensor of Bernstein coefficients, (n1 + 1, …, nk + 1, d), as Python integers. A piece holds no
zero if some direction w has w·c > 0 for all coefficients c of the piece. It holds exactly one if Krawczyk's operator
maps a box around it into itself (Krawczyk 1969; Neumaier, Interval methods for systems of equations, 1990, 5.1); that
test runs in rational numbers, only the approximate inverse that it takes comes from floats. What neither settles is cut
in two, as often as the caller allows.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import comb

import numpy as np
from numpy.typing import NDArray

from oracles.beziers import Whole, along, restricted
from oracles.exact import determinant, sign

MARGIN = Fraction(1, 8)
"""A piece is enlarged by this share on every side before its zero is looked for, so that one on its border is found."""

WIDTH = Fraction(1, 2**80)
"""Zeros are enclosed this closely."""

INVERSE_BITS = 60
DIRECTION_BITS = 40


@dataclass(frozen=True)
class Box:
    """A piece of the unit box: low and high end along each axis."""

    low: tuple[Fraction, ...]
    high: tuple[Fraction, ...]

    @property
    def middle(self) -> tuple[float, ...]:
        return tuple(float((a + b) / 2) for a, b in zip(self.low, self.high, strict=True))

    @property
    def sizes(self) -> tuple[Fraction, ...]:
        return tuple(b - a for a, b in zip(self.low, self.high, strict=True))

    def part(self, axis: int, low: Fraction, high: Fraction) -> "Box":
        size = self.high[axis] - self.low[axis]
        ends = self.low[axis] + low * size, self.low[axis] + high * size
        before, after = list(self.low), list(self.high)
        before[axis], after[axis] = ends
        return Box(tuple(before), tuple(after))

    def enlarged(self, share: Fraction) -> "Box":
        sides = [(b - a) * share for a, b in zip(self.low, self.high, strict=True)]
        return Box(
            tuple(a - d for a, d in zip(self.low, sides, strict=True)),
            tuple(b + d for b, d in zip(self.high, sides, strict=True)),
        )

    def meets(self, other: "Box") -> bool:
        return all(a <= d and c <= b for a, b, c, d in zip(self.low, self.high, other.low, other.high, strict=True))

    def is_inside(self, other: "Box") -> bool:
        """Return whether this box lies in the interior of the other."""
        return all(c < a and b < d for a, b, c, d in zip(self.low, self.high, other.low, other.high, strict=True))


@dataclass(frozen=True)
class Zero:
    """The only zero in its box, a simple one, with the sign of the Jacobian's determinant there."""

    box: Box
    turn: int


NO_ZERO = Zero(Box((), ()), 0)
"""What is said of a piece that has none."""


@dataclass(frozen=True)
class Zeros:
    """All zeros inside the unit box, and the pieces that may hold more: on its border, double, or not looked at."""

    simple: tuple[Zero, ...]
    undecided: tuple[Box, ...]

    @property
    def is_free(self) -> bool:
        return not self.simple and not self.undecided


def unit_box(k: int) -> Box:
    return Box((Fraction(0),) * k, (Fraction(1),) * k)


def over(f: Whole, box: Box) -> Whole:
    """Return the coefficients over a box."""
    for axis, (low, high) in enumerate(zip(box.low, box.high, strict=True)):
        f = restricted(f, axis, low, high)
    return smaller(f)


def smaller(f: Whole) -> Whole:
    """Return f without the powers of two that all its numbers share."""
    common = int(np.bitwise_or.reduce(f.ravel()))
    twos = (common & -common).bit_length() - 1
    return f >> twos if twos > 0 else f


def zeros(f: Whole, start: Box | None = None, *, most_pieces: int = 3000) -> Zeros:
    """Return the zeros of f in a box (the unit box if left out), looking at so many pieces at most."""
    k = f.ndim - 1
    unit, box = unit_box(k), start or unit_box(k)
    pending, looked = deque([(box, over(f, box))]), 0
    found: list[Zero] = []
    undecided: list[Box] = []
    while pending:
        box, g = pending.popleft()
        looked += 1
        if has_no_zero(g):
            continue
        if looked > most_pieces:
            undecided.append(box)
            continue
        if f.shape[-1] == k and (zero := only_zero(f, box, g)) is not None:
            if zero is not NO_ZERO and zero.box.meets(box) and zero.box.meets(unit):
                found.append(zero)
            continue
        if not g.any():
            undecided.append(box)
            continue
        pending += halves(box, g)
    return _sorted_out(found, undecided, unit)


def _sorted_out(found: list[Zero], undecided: list[Box], unit: Box) -> Zeros:
    simple: list[Zero] = []
    for zero in found:
        if any(zero.box.meets(other.box) for other in simple):
            continue
        if zero.box.is_inside(unit):
            simple.append(zero)
        else:
            undecided.append(zero.box)
    return Zeros(tuple(simple), tuple(undecided))


def halves(box: Box, g: Whole) -> Iterator[tuple[Box, Whole]]:
    """Yield the halves of a piece across the axis along which the coefficients change most."""
    floats = as_floats(g)
    k = g.ndim - 1
    axis = max(range(k), key=lambda i: float(np.abs(np.diff(floats, axis=i)).max(initial=0.0)) * (g.shape[i] - 1))
    for low, high in ((Fraction(0), Fraction(1, 2)), (Fraction(1, 2), Fraction(1))):
        yield box.part(axis, low, high), smaller(restricted(g, axis, low, high))


def as_floats(g: Whole) -> NDArray[np.float64]:
    """Return the numbers over the power of two above the greatest."""
    bits = max(int(abs(g).max()).bit_length(), 1)
    return np.asarray(g / (1 << bits), dtype=np.float64)


def has_no_zero(g: Whole) -> bool:
    """Return whether some direction shows that the piece has no zero; False says nothing."""
    flat = g.reshape(-1, g.shape[-1])
    if any(column.min() > 0 or column.max() < 0 for column in flat.T):
        return True
    floats = as_floats(flat)
    for w in directions(as_floats(g)):
        size = np.abs(w).max()
        if not size > 0 or (height := floats @ (w / size)).min() * height.max() <= 0:
            continue
        exact = flat @ np.rint(w / size * 2.0**DIRECTION_BITS).astype(np.int64).astype(object)
        if exact.min() > 0 or exact.max() < 0:
            return True
    return False


def directions(g: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Yield the value in the middle, and in space what is perpendicular to two of the derivatives there."""
    k = g.ndim - 1
    yield at_middle(g)
    if g.shape[-1] == 3:
        slopes = [at_middle(np.diff(g, axis=i)) for i in range(k) if g.shape[i] > 1]
        for i in range(len(slopes)):
            for j in range(i):
                yield np.cross(slopes[i], slopes[j])


@cache
def _middle_weights(degree: int) -> Whole:
    return np.array([comb(degree, i) for i in range(degree + 1)], dtype=object)


def at_middle(g: NDArray[np.float64]) -> NDArray[np.float64]:
    while g.ndim > 1:
        degree = g.shape[0] - 1
        g = np.tensordot(_middle_weights(degree).astype(np.float64) / 2.0**degree, g, axes=(0, 0))
    return g


def only_zero(f: Whole, box: Box, g: Whole) -> Zero | None:
    """Return the only zero in the enlarged piece, `NO_ZERO` where it has none, None where neither is shown."""
    around, h = box.enlarged(MARGIN), g
    for axis in range(g.ndim - 1):
        h = restricted(h, axis, -MARGIN, 1 + MARGIN)
    step = contraction(smaller(h))
    if step is None or step.is_empty:
        return None if step is None else NO_ZERO
    if not all(low > 0 and high < 1 for low, high in step.shares):
        return None
    turn = step.turn
    while True:
        closer = narrowed(around, step.shares)
        if closer == around or max(closer.sizes) <= WIDTH:
            return Zero(closer, turn)
        around = closer
        step = contraction(over(f, around))
        if step is None:
            return Zero(around, turn)


def narrowed(box: Box, inner: list[tuple[Fraction, Fraction]]) -> Box:
    """Return the part of a box, rounded outwards to some binary digits beyond its own width."""
    low, high = [], []
    for a, b, (c, d) in zip(box.low, box.high, inner, strict=True):
        size = b - a
        unit = Fraction(1, 2 ** max(0, 8 - _log2((d - c) * size)))
        low.append(max(a, ((a + c * size) // unit) * unit))
        high.append(min(b, -(-(a + d * size) // unit) * unit))
    return Box(tuple(low), tuple(high))


def _log2(x: Fraction) -> int:
    return -200 if x == 0 else max(x.numerator.bit_length() - x.denominator.bit_length(), -200)


@dataclass(frozen=True)
class Contraction:
    """Krawczyk's box as shares of the piece, and the sign of the Jacobian's determinant."""

    shares: list[tuple[Fraction, Fraction]]
    turn: int

    @property
    def is_empty(self) -> bool:
        """Whether the piece has no zero."""
        return any(high < 0 or low > 1 for low, high in self.shares)


def contraction(h: Whole) -> Contraction | None:
    """Return Krawczyk's box of a piece h; None where the Jacobian changes too much over it for that.

    With c the middle and Y about the inverse of the Jacobian there, every zero in the piece X lies in
    c - Y f(c) + (I - Y J(X)) (X - c). If that is inside X there is exactly one, and J is regular all over X. The range
    of Y J is that of its Bernstein coefficients.
    """
    k = h.ndim - 1
    if min(h.shape[:-1]) < 2:
        return None
    bits = max(int(abs(h).max()).bit_length(), 1)
    changes = [(h.shape[j] - 1) * np.diff(h, axis=j) for j in range(k)]
    slopes = np.stack([at_middle(np.asarray(c / (1 << bits), dtype=np.float64)) for c in changes], axis=1)
    inverse = _inverse(slopes)
    if inverse is None or _looks_hopeless([c.reshape(-1, k) / (1 << bits) for c in changes], inverse):
        return None
    whole = np.vectorize(lambda v: int(np.ldexp(v, INVERSE_BITS)), otypes=[object])(inverse)
    unit = 1 << (bits + INVERSE_BITS)  # Y f is whole @ h / unit
    radius = [0] * k
    for j in range(k):
        change = changes[j].reshape(-1, k) @ whole.T
        for i in range(k):
            one = unit if i == j else 0
            radius[i] += max(abs(one - int(change[:, i].min())), abs(one - int(change[:, i].max())))
    value, scale = middle_exact(h)
    shares = []
    for moved, r in zip(whole @ value, radius, strict=True):
        centre, reach = Fraction(1, 2) - Fraction(int(moved), unit * scale), Fraction(r, 2 * unit)
        shares.append((centre - reach, centre + reach))
    return Contraction(shares, sign(determinant([[Fraction(int(v)) for v in row] for row in whole])))


def _inverse(slopes: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return about the inverse, each column brought to length 1 first; None where that is far from regular."""
    size = np.abs(slopes).max(axis=0)
    if not size.min() > 0 or np.linalg.cond(slopes / size) > 1e14:
        return None
    return np.asarray(np.linalg.inv(slopes / size) / size[:, np.newaxis])


def _looks_hopeless(changes: list[Whole], inverse: NDArray[np.float64]) -> bool:
    """Return whether the Jacobian changes so much over the piece that the exact test need not be tried."""
    radius = np.zeros(len(changes))
    for j, change in enumerate(changes):
        relative = change.astype(np.float64) @ inverse.T
        radius += np.abs(relative - np.eye(len(changes))[j]).max(axis=0) / 2
    return not radius.max() < 1.0


def middle_exact(h: Whole) -> tuple[Whole, int]:
    """Return the value in the middle times a power of two, and that power."""
    scale = 1
    while h.ndim > 1:
        degree = h.shape[0] - 1
        h = along(0, _middle_weights(degree)[np.newaxis], h)[0]
        scale <<= degree
    return h, scale
