"""Polynomials over the rationals: real roots in [0, 1] by Sturm sequences, and signs at these roots.

A polynomial is a list of Fractions in ascending powers without trailing zeros; the zero polynomial is empty.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import floor
from typing import TypeAlias

from oracles.exact import Number, fraction, sign

Polynomial: TypeAlias = list[Fraction]

ROOT_WIDTH = Fraction(1, 2**100)
"""Irrational roots are enclosed this closely: far below 1e-12 even after division by a small denominator."""


def trimmed(p: Sequence[Fraction]) -> Polynomial:
    p = list(p)
    while p and p[-1] == 0:
        p.pop()
    return p


def added(p: Polynomial, q: Polynomial) -> Polynomial:
    n = max(len(p), len(q))
    padded = ([*r, *[Fraction(0)] * (n - len(r))] for r in (p, q))
    return trimmed([x + y for x, y in zip(*padded, strict=True)])


def subtracted(p: Polynomial, q: Polynomial) -> Polynomial:
    return added(p, [-x for x in q])


def multiplied(p: Polynomial, q: Polynomial) -> Polynomial:
    product = [Fraction(0)] * (len(p) + len(q))
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


def value_at(p: Polynomial, t: Fraction) -> Fraction:
    """Return p(t) by Horner's rule."""
    value = Fraction(0)
    for x in reversed(p):
        value = value * t + x
    return value


def divided(p: Polynomial, q: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Return quotient and remainder of long division."""
    rest, quotient = list(p), [Fraction(0)] * max(len(p) - len(q) + 1, 0)
    for k in reversed(range(len(quotient))):
        quotient[k] = rest[k + len(q) - 1] / q[-1]
        for j, x in enumerate(q):
            rest[k + j] -= quotient[k] * x
    return trimmed(quotient), trimmed(rest)


def common_divisor(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return the monic greatest common divisor (Euclid)."""
    while q:
        p, q = q, divided(p, q)[1]
    return [x / p[-1] for x in p] if p else []


def squarefree(p: Polynomial) -> Polynomial:
    """Return the polynomial with the same roots, each simple."""
    return divided(p, common_divisor(p, derivative(p)))[0]


def sturm_chain(p: Polynomial) -> list[Polynomial]:
    """Return p, p', and the negated remainders of Euclid's algorithm; p must be square-free."""
    chain = [p, derivative(p)]
    while chain[-1]:
        chain.append([-x for x in divided(chain[-2], chain[-1])[1]])
    return chain[:-1]


def sign_changes(chain: list[Polynomial], t: Fraction) -> int:
    signs = [s for s in (sign(value_at(p, t)) for p in chain) if s != 0]
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


def simplest_between(low: Fraction, high: Fraction) -> Fraction:
    """Return the fraction of least denominator in [low, high] (Stern-Brocot)."""
    whole = floor(low)
    if whole == low:
        return low
    if whole + 1 <= high:
        return Fraction(whole + 1)
    return whole + 1 / simplest_between(1 / (high - whole), 1 / (low - whole))


def refined(root: Root) -> Root:
    """Return the root enclosed within ROOT_WIDTH, as a point where it is a simple rational number."""
    while root.high - root.low > ROOT_WIDTH:
        root = halved(root)
    guess = simplest_between(root.low, root.high)
    if root.low < guess and value_at(root.chain[0], guess) == 0:
        return Root(root.chain, guess, guess)
    return root


def unit_roots(p: Polynomial) -> list[Root]:
    """Return the distinct roots of p in [0, 1] in rising order; p must not be the zero polynomial."""
    zero, one = Fraction(0), Fraction(1)
    chain = sturm_chain(squarefree(p))
    roots = [Root(chain, zero, zero)] if value_at(p, zero) == 0 else []
    pending = [(zero, one)]
    while pending:
        low, high = pending.pop()
        count = count_roots(chain, low, high)
        middle = (low + high) / 2
        if count == 1:
            roots.append(refined(Root(chain, low, high)))
        elif count > 1:
            pending += [(middle, high), (low, middle)]
    return roots


def sign_at(p: Polynomial, root: Root) -> int:
    """Return the sign of p at the root, exactly.

    A common root shows in the greatest common divisor; otherwise the enclosing interval is halved until p has
    no root in it, which must happen.
    """
    if not p or root.low == root.high:
        return sign(value_at(p, root.low))
    chain = sturm_chain(squarefree(p))
    shared = common_divisor(root.chain[0], p)
    if count_roots(sturm_chain(shared), root.low, root.high):
        return 0
    while root.low != root.high and (count_roots(chain, root.low, root.high) or not value_at(p, root.low)):
        root = halved(root)
    return sign(value_at(p, root.middle))
