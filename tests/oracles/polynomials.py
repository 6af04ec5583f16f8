"""Polynomials over the rationals: real roots in [0, 1] by Sturm sequences, and signs at these roots.

A polynomial is a list of integers or Fractions in ascending powers without trailing zeros; the zero polynomial is
empty.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm
from typing import Any, TypeAlias

from oracles.exact import Number, fraction, sign

Polynomial: TypeAlias = list[Any]  # of int or Fraction

ROOT_WIDTH = Fraction(1, 2**100)
"""Irrational roots are enclosed this closely: far below 1e-12 even after division by a small denominator."""


def trimmed(p: Sequence[Any]) -> Polynomial:
    p = list(p)
    while p and p[-1] == 0:
        p.pop()
    return p


def added(p: Polynomial, q: Polynomial) -> Polynomial:
    n = max(len(p), len(q))
    padded = ([*r, *[0] * (n - len(r))] for r in (p, q))
    return trimmed([x + y for x, y in zip(*padded, strict=True)])


def subtracted(p: Polynomial, q: Polynomial) -> Polynomial:
    return added(p, [-x for x in q])


def multiplied(p: Polynomial, q: Polynomial) -> Polynomial:
    product = [0] * (len(p) + len(q))
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            product[i + j] += x * y
    return trimmed(product)


class Poly:
    """A polynomial in t with operators, so that the vector algebra reads as it does on numbers."""

    def __init__(self, coefficients: Polynomial) -> None:
        self.p = coefficients

    def __add__(self, other: "Poly") -> "Poly":
        return Poly(added(self.p, other.p))

    def __sub__(self, other: "Poly") -> "Poly":
        return Poly(subtracted(self.p, other.p))

    def __mul__(self, other: "Poly") -> "Poly":
        return Poly(multiplied(self.p, other.p))

    def __rmul__(self, factor: int) -> "Poly":
        return Poly(trimmed([factor * x for x in self.p]))


def derivative(p: Polynomial) -> Polynomial:
    return [k * x for k, x in enumerate(p)][1:]


def scaled_value(p: Polynomial, numerator: int, denominator: int) -> tuple[Any, int]:
    """Return p(numerator / denominator)·d and d, a power of the denominator: Horner's rule without division."""
    value, power = 0, 1
    for k, x in enumerate(reversed(p)):
        power *= denominator if k else 1
        value = value * numerator + x * power
    return value, power


def value_at(p: Polynomial, t: Fraction) -> Fraction:
    value, power = scaled_value(p, t.numerator, t.denominator)
    return Fraction(value, power)


def sign_value(p: Polynomial, numerator: int, denominator: int) -> int:
    """Return the sign of p(numerator / denominator), the denominator positive."""
    return sign(scaled_value(p, numerator, denominator)[0])


def remainder(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return a positive multiple of what long division of p by q leaves, in the least whole coefficients."""
    rest, lead = whole(p), whole(q)
    while len(rest) >= len(lead):
        factor, shift = rest[-1] if lead[-1] > 0 else -rest[-1], len(rest) - len(lead)
        rest = [abs(lead[-1]) * x for x in rest]
        for j, x in enumerate(lead):
            rest[shift + j] -= factor * x
        rest = trimmed(rest)
    return whole(rest)


def whole(p: Polynomial) -> Polynomial:
    """Return the positive multiple of p whose coefficients are coprime integers: it has the same signs everywhere."""
    scale = lcm(*(x.denominator for x in p))
    integers = [x.numerator * (scale // x.denominator) for x in p]
    common = gcd(*integers) or 1
    return [x // common for x in integers]


def quotient(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p / q, which leaves no rest."""
    rest, found = list(p), [Fraction(0)] * max(len(p) - len(q) + 1, 0)
    for k in reversed(range(len(found))):
        found[k] = Fraction(rest[k + len(q) - 1]) / q[-1]
        for j, x in enumerate(q):
            rest[k + j] -= found[k] * x
    assert not any(rest)
    return trimmed(found)


def common_divisor(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return the greatest common divisor (Euclid), in the least whole coefficients, up to its sign."""
    p, q = whole(p), whole(q)
    while q:
        p, q = q, remainder(p, q)
    return p


def squarefree(p: Polynomial) -> Polynomial:
    """Return the polynomial with the same roots, each simple."""
    shared = common_divisor(p, derivative(p))
    return whole(quotient(p, shared)) if len(shared) > 1 else whole(p)


def sturm_chain(p: Polynomial) -> list[Polynomial]:
    """Return p, p', and the negated remainders of Euclid's algorithm, up to positive factors; p must be square-free."""
    chain = [whole(p), whole(derivative(p))]
    while chain[-1]:
        chain.append([-x for x in remainder(chain[-2], chain[-1])])
    return chain[:-1]


def sign_changes(chain: list[Polynomial], t: Fraction) -> int:
    signs = [s for s in (sign_value(p, t.numerator, t.denominator) for p in chain) if s != 0]
    return sum(x != y for x, y in pairwise(signs))


def count_roots(chain: list[Polynomial], low: Fraction, high: Fraction) -> int:
    """Return the number of roots in (low, high] (Sturm's theorem for a square-free polynomial)."""
    return sign_changes(chain, low) - sign_changes(chain, high)


@dataclass(frozen=True)
class Root:
    """One root of a square-free polynomial: the only one in (low, high], or low itself where low = high."""

    chain: list[Polynomial]
    low: Fraction
    high: Fraction

    @property
    def middle(self) -> Fraction:
        return (self.low + self.high) / 2


def at(t: Number) -> Root:
    """Return a rational number as a root."""
    t = fraction(t)
    return Root(sturm_chain([-t, Fraction(1)]), t, t)


def halved(root: Root) -> Root:
    """Return the half of the enclosing interval that holds the root; a point where the middle is the root."""
    middle = root.middle
    if value_at(root.chain[0], middle) == 0:
        return Root(root.chain, middle, middle)
    if count_roots(root.chain, root.low, middle):
        return Root(root.chain, root.low, middle)
    return Root(root.chain, middle, root.high)


def bisected(root: Root) -> Root:
    """Return the root enclosed within ROOT_WIDTH: of two halves, the signs at their ends tell which holds it.

    A simple root changes the sign. Where an end is a root (that one, or its neighbour), `halved` counts instead.
    """
    p, scale = root.chain[0], lcm(root.low.denominator, root.high.denominator)
    low, high = (x.numerator * (scale // x.denominator) for x in (root.low, root.high))
    before, after = sign_value(p, low, scale), sign_value(p, high, scale)
    if before * after == 0:
        while root.high - root.low > ROOT_WIDTH:
            root = halved(root)
        return root
    while (high - low) * ROOT_WIDTH.denominator > ROOT_WIDTH.numerator * scale:
        low, middle, high, scale = 2 * low, low + high, 2 * high, 2 * scale
        turn = sign_value(p, middle, scale)
        if turn == 0:
            return Root(root.chain, Fraction(middle, scale), Fraction(middle, scale))
        low, high = (middle, high) if turn == before else (low, middle)
    return Root(root.chain, Fraction(low, scale), Fraction(high, scale))


def simplest_between(low: Fraction, high: Fraction) -> Fraction:
    """Return the fraction of least denominator in [low, high] (Stern-Brocot): the common start of continued fractions.

    With p/q and p'/q' the last two convergents of that start, it is (p·k + p')/(q·k + q') for the least whole k.
    """
    (a, b), (c, d) = low.as_integer_ratio(), high.as_integer_ratio()
    p, q, p_before, q_before = 1, 0, 0, 1
    while True:
        k = a // b
        if k * b == a or (k + 1) * d <= c:
            k += k * b != a
            return Fraction(p * k + p_before, q * k + q_before)
        p, q, p_before, q_before = p * k + p_before, q * k + q_before, p, q
        a, b, c, d = d, c - k * d, b, a - k * b


def refined(root: Root) -> Root:
    """Return the root enclosed within ROOT_WIDTH, as a point where it is a simple rational number."""
    root = bisected(root)
    guess = simplest_between(root.low, root.high)
    if root.low < guess and sign_value(root.chain[0], *guess.as_integer_ratio()) == 0:
        return Root(root.chain, guess, guess)
    return root


def unit_roots(p: Polynomial) -> list[Root]:
    """Return the distinct roots of p in [0, 1] in rising order; p must not be the zero polynomial."""
    zero, one = Fraction(0), Fraction(1)
    chain = sturm_chain(squarefree(p))
    roots = [Root(chain, zero, zero)] if p[0] == 0 else []
    pending = [(zero, one)]
    while pending:
        low, high = pending.pop()
        count = count_roots(chain, low, high)
        if count == 1:
            roots.append(refined(Root(chain, low, high)))
        elif count > 1:
            middle = (low + high) / 2
            pending += [(middle, high), (low, middle)]
    return roots


def clear_sign(p: Polynomial, low: Fraction, high: Fraction) -> int:
    """Return the sign that p has all over [low, high] within [0, 1], 0 where this bound does not show one.

    There |p(t) - p(m)| ≤ |t - m|·Σ k·|p_k|, with m the middle.
    """
    middle, half = (low + high) / 2, (high - low) / 2
    value, power = scaled_value(p, middle.numerator, middle.denominator)
    slope = sum(k * abs(x) for k, x in enumerate(p))
    return sign(value) if abs(value) * half.denominator > half.numerator * slope * power else 0


def sign_at(p: Polynomial, root: Root) -> int:
    """Return the sign of p at the root, exactly.

    Mostly it is the same all over the enclosing interval. A common root shows in the greatest common divisor;
    otherwise the interval is halved until p has no root in it, which must happen.
    """
    if not p or root.low == root.high:
        return sign(value_at(p, root.low))
    if root.low >= 0 and root.high <= 1 and (clear := clear_sign(p, root.low, root.high)):
        return clear
    chain = sturm_chain(squarefree(p))
    shared = common_divisor(root.chain[0], p)
    if count_roots(sturm_chain(shared), root.low, root.high):
        return 0
    while root.low != root.high and (count_roots(chain, root.low, root.high) or not value_at(p, root.low)):
        root = halved(root)
    return sign(value_at(p, root.middle))
