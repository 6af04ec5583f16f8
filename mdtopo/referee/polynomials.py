"""Polynomials with integer coefficients: their roots in [0, 1], and signs at these roots, without rounding.

A polynomial is a tuple of Python integers in ascending powers without trailing zeros; the zero polynomial is empty.
Roots are isolated by bisection with Descartes' rule of signs in the Bernstein basis (Collins and Akritas 1976): over
an interval, the number of roots inside is at most the number of sign changes of the coefficients, and equal to it where
that is 0 or 1. For a polynomial without multiple roots the bisection ends (Obreschkoff).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import comb, factorial, gcd
from typing import TypeAlias

Polynomial: TypeAlias = tuple[int, ...]

FINE = 128
"""Roots are reported from intervals of width 2^-128, so that what is worked out there keeps its digits in float64."""


def trimmed(coefficients: Iterable[int]) -> Polynomial:
    """Return the polynomial with these coefficients."""
    p = list(coefficients)
    while p and p[-1] == 0:
        p.pop()
    return tuple(p)


def plus(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p + q."""
    if len(p) < len(q):
        p, q = q, p
    return trimmed([*(x + y for x, y in zip(p, q, strict=False)), *p[len(q) :]])


def minus(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p - q."""
    return plus(p, tuple(-x for x in q))


def times(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p·q."""
    product = [0] * max(len(p) + len(q) - 1, 0)
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            product[i + j] += x * y
    return trimmed(product)


def value(p: Polynomial, t: Fraction) -> Fraction:
    """Return p(t)."""
    total = Fraction(0)
    for x in reversed(p):
        total = total * t + x
    return total


def sign(number: int | Fraction) -> int:
    """Return -1, 0 or 1."""
    return (number > 0) - (number < 0)


def primitive(p: Polynomial) -> Polynomial:
    """Return p without the common factor of its coefficients."""
    factor = gcd(*p) if p else 1
    return tuple(x // factor for x in p)


def common_divisor(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return the greatest common divisor, up to a constant factor (Euclid with primitive remainders)."""
    while q:
        p, q = q, primitive(_remainder(p, q))
    return primitive(p)


def _remainder(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return the remainder of p by q, up to a constant factor."""
    while len(p) >= len(q):
        shifted = (0,) * (len(p) - len(q)) + q
        p = minus(times((q[-1],), p), times((p[-1],), shifted))
    return p


def squarefree(p: Polynomial) -> Polynomial:
    """Return a polynomial with the same roots, each of them simple; p must not be zero."""
    p = primitive(p)
    shared = common_divisor(p, trimmed(k * x for k, x in enumerate(p) if k))
    quotient = [0] * (len(p) - len(shared) + 1)
    for k in reversed(range(len(quotient))):  # primitive by primitive divides in integers (Gauss)
        quotient[k] = p[-1] // shared[-1] if len(p) == len(shared) + k else 0
        p = minus(p, times((0,) * k + (quotient[k],), shared)) if quotient[k] else p
    return trimmed(quotient)


def bernstein(p: Polynomial, k: int = 0, e: int = 0) -> list[int]:
    """Return the Bernstein coefficients of p over [k/2^e, (k+1)/2^e], times one positive factor."""
    n = len(p) - 1
    local = [x << (e * (n - i)) for i, x in enumerate(p)]
    if k:
        for i in range(n):  # Taylor shift by k, as Horner does it
            for j in range(n - 1, i - 1, -1):
                local[j] += k * local[j + 1]
    weighted = [x * factorial(i) * factorial(n - i) for i, x in enumerate(local)]
    return [sum(comb(m, i) * weighted[i] for i in range(m + 1)) for m in range(n + 1)]


def sign_changes(numbers: Iterable[int]) -> int:
    """Return how often the sign changes along a list, zeros left out."""
    signs = [x > 0 for x in numbers if x]
    return sum(x != y for x, y in pairwise(signs))


@dataclass(frozen=True, slots=True)
class Root:
    """A root of a polynomial without multiple roots.

    Attributes
    ----------
    polynomial : Polynomial
    k, e : int
        The root is k/2^e where `is_point`, else the only root in the open interval (k/2^e, (k+1)/2^e).
    is_point : bool
    """

    polynomial: Polynomial
    k: int
    e: int
    is_point: bool

    @property
    def middle(self) -> Fraction:
        """The root where it is a point, else the middle of its interval."""
        return Fraction(self.k, 1 << self.e) if self.is_point else Fraction(2 * self.k + 1, 2 << self.e)

    def halved(self) -> "Root":
        """Return the root in half of its interval."""
        if self.is_point:
            return self
        if value(self.polynomial, self.middle) == 0:
            return Root(self.polynomial, 2 * self.k + 1, self.e + 1, True)
        left = sign_changes(bernstein(self.polynomial, 2 * self.k, self.e + 1)) == 1
        return Root(self.polynomial, 2 * self.k + (not left), self.e + 1, False)

    def fine(self) -> "Root":
        """Return the root within an interval of width 2^-FINE."""
        root = self
        while not root.is_point and root.e < FINE:
            root = root.halved()
        return root


def point_root(t: int) -> Root:
    """Return the integer t, 0 or 1, as a root."""
    return Root((-t, 1), t, 0, True)


def unit_roots(p: Polynomial) -> list[Root]:
    """Return the distinct roots of p in [0, 1], in rising order; p must not be zero."""
    q = squarefree(p)
    roots = [Root(q, t, 0, True) for t in (0, 1) if value(q, Fraction(t)) == 0]
    pending = [(0, 0)]
    while pending:
        k, e = pending.pop()
        changes = sign_changes(bernstein(q, k, e))
        if changes == 1:
            roots.append(Root(q, k, e, False))
        elif changes > 1:
            if value(q, Fraction(2 * k + 1, 2 << e)) == 0:
                roots.append(Root(q, 2 * k + 1, e + 1, True))
            pending += [(2 * k, e + 1), (2 * k + 1, e + 1)]
    return sorted(roots, key=lambda root: root.middle)


def sign_at(p: Polynomial, root: Root) -> int:
    """Return the sign of p at a root, exactly.

    Where p vanishes there too, the greatest common divisor has that root; otherwise halving the interval long enough
    leaves p without a sign change on it.
    """
    if not p:
        return 0
    shared = common_divisor(root.polynomial, p)
    while True:
        if root.is_point:
            return sign(value(p, root.middle))
        if sign_changes(bernstein(shared, root.k, root.e)) == 1:
            return 0
        coefficients = bernstein(p, root.k, root.e)
        if sign_changes(coefficients) == 0:
            return sign(next(x for x in coefficients if x))
        root = root.halved()


def turn_at(p: Polynomial, root: Root) -> int:
    """Return the sign of p just after a root where p changes its sign, and 0 at a root where it does not."""
    order, derivative, found = 0, p, 0
    while not found:
        derivative = trimmed(k * x for k, x in enumerate(derivative) if k)
        order, found = order + 1, sign_at(derivative, root)
    return found if order % 2 else 0
