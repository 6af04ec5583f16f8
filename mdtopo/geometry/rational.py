"""Does one moving edge pass through another? Decided in exact arithmetic, for what floating point leaves open.

Positions are taken as the numbers that they are (a float is a whole number times a power of two), scaled to integers;
then every sign below is a sign of an integer. Roots are isolated by Descartes' rule on halved intervals (Vincent,
Collins and Akritas 1976).
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from math import comb, gcd, lcm
from typing import NamedTuple, TypeAlias

Exact: TypeAlias = Sequence[Fraction]
ExactCorners: TypeAlias = tuple[Exact, Exact, Exact, Exact]
Polynomial: TypeAlias = list[int]
"""Integer coefficients, the constant first, without leading zeros; empty for zero."""

FREE, PASSAGE, TOUCH, VERTEX, SLIDING, FRAME = "free", "passage", "touch", "vertex", "sliding", "frame"

ROOT_WIDTH = Fraction(1, 2**60)
"""How narrow the bracket of a root is made before parameters are read off."""


class Meeting(NamedTuple):
    """A passage: time, parameters on both edges, and the sign of f after it."""

    t: float
    s: float
    r: float
    sign: int


class Root(NamedTuple):
    """A root in (low, high), the only one there, or at low = high."""

    low: Fraction
    high: Fraction


def exact_passages(start: ExactCorners, end: ExactCorners) -> tuple[str, list[Meeting]]:
    """Return how two moving edges meet: in passages only or not, and all passages.

    Parameters
    ----------
    start, end : four points of three Fractions
        a, b, c, d at both ends.

    Returns
    -------
    state : str
        ``free``: they never meet. ``passage``: they meet in passages only. Else they also meet without that anything is
        known to pass, and the last time is named: ``touch`` (inside both, an even root), ``vertex`` (at an end of an
        edge), ``sliding`` (while the edges lie on one line, or in one plane all the time, or one has no length; whether
        they then touch is not looked at), ``frame`` (at t = 0 or 1).
    meetings : list of Meeting
        In order of time.

    Guarantee
    ---------
    Proven: exact arithmetic on the given numbers.
    """
    u, v, w = _differences(start, end)
    n = _cross(u, v)
    f = _dot([_negative(p) for p in w], n)
    if not f:
        return SLIDING, []
    wv, wu = _cross(w, v), _cross(w, u)
    nn, s, r = _dot(n, n), _dot(wv, n), _dot(wu, n)
    inside = [s, _subtract(nn, s), r, _subtract(nn, r)]
    state, meetings = FREE, []
    for root in unit_roots(f):
        signs = [sign_at(p, root, f) for p in (*inside, nn)]
        if min(signs[:4]) < 0:
            continue
        if signs[4] == 0:
            # parallel: on one line, or apart
            if sign_at(_dot(wv, wv), root, f) == 0 and sign_at(_dot(wu, wu), root, f) == 0:
                state = SLIDING
        elif root.low == root.high and root.low in (0, 1):
            state = FRAME
        elif min(signs[:4]) == 0:
            state = VERTEX
        elif (turn := _turn(f, root)) == 0:
            state = TOUCH
        else:
            t = _refined(f, root, turn)
            size = _value(nn, t)
            meetings.append(Meeting(float(t), float(_value(s, t) / size), float(_value(r, t) / size), turn))
    return (PASSAGE if state == FREE and meetings else state), meetings


def _differences(start: ExactCorners, end: ExactCorners) -> list[list[Polynomial]]:
    """Return u, v and w as linear polynomials with integer coefficients, all scaled by one number."""
    scale = lcm(*(x.denominator for point in (*start, *end) for x in point))
    a, b, c, d = (
        [(int(x * scale), int(y * scale)) for x, y in zip(p, q, strict=True)] for p, q in zip(start, end, strict=True)
    )
    pairs = ((b, a), (d, c), (c, a))
    return [
        [_trimmed([p0 - q0, (p1 - q1) - (p0 - q0)]) for (p0, p1), (q0, q1) in zip(p, q, strict=True)] for p, q in pairs
    ]


def _trimmed(p: Polynomial) -> Polynomial:
    while p and p[-1] == 0:
        p.pop()
    return p


def _negative(p: Polynomial) -> Polynomial:
    return [-x for x in p]


def _subtract(p: Polynomial, q: Polynomial) -> Polynomial:
    size = max(len(p), len(q))
    one, other = p + [0] * (size - len(p)), q + [0] * (size - len(q))
    return _trimmed([x - y for x, y in zip(one, other, strict=True)])


def _times(p: Polynomial, q: Polynomial) -> Polynomial:
    product = [0] * max(len(p) + len(q) - 1, 0)
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            product[i + j] += x * y
    return _trimmed(product)


def _cross(p: Sequence[Polynomial], q: Sequence[Polynomial]) -> list[Polynomial]:
    return [_subtract(_times(p[i], q[j]), _times(p[j], q[i])) for i, j in ((1, 2), (2, 0), (0, 1))]


def _dot(p: Sequence[Polynomial], q: Sequence[Polynomial]) -> Polynomial:
    total: Polynomial = []
    for x, y in zip(p, q, strict=True):
        total = _subtract(total, _negative(_times(x, y)))
    return total


def _value(p: Polynomial, t: Fraction) -> Fraction:
    total = Fraction(0)
    for coefficient in reversed(p):
        total = total * t + coefficient
    return total


def _sign_at(p: Polynomial, t: Fraction) -> int:
    """Return the sign of p(t); in whole numbers, without the common divisors that fractions look for."""
    total, scale = 0, 1
    for coefficient in reversed(p):
        total = total * t.numerator + coefficient * scale
        scale *= t.denominator
    return _sign(total)


def _sign(value: Fraction | int) -> int:
    return (value > 0) - (value < 0)


def _derivative(p: Polynomial) -> Polynomial:
    return [k * x for k, x in enumerate(p)][1:]


def _remainder(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return a positive multiple of the remainder of p by q, made primitive."""
    rest = p[:]
    while len(rest) >= len(q):
        factor, shift = rest[-1], len(rest) - len(q)
        scale = abs(q[-1])
        rest = [scale * x for x in rest]
        for k, y in enumerate(q):
            rest[k + shift] -= factor * _sign(q[-1]) * y
        _trimmed(rest)
    common = gcd(*rest) if rest else 1
    return [x // common for x in rest]


def _common_divisor(p: Polynomial, q: Polynomial) -> Polynomial:
    while q:
        p, q = q, _remainder(p, q)
    return p


def _quotient(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p / q, which leaves no rest, as a primitive polynomial with the sign of p / q."""
    rest, result = [Fraction(x) for x in p], [Fraction(0)] * (len(p) - len(q) + 1)
    for shift in range(len(result) - 1, -1, -1):
        result[shift] = rest[shift + len(q) - 1] / q[-1]
        for k, y in enumerate(q):
            rest[k + shift] -= result[shift] * y
    scale = lcm(*(x.denominator for x in result))
    whole = [int(x * scale) for x in result]
    common = gcd(*whole)
    return [x // common for x in whole]


def unit_roots(p: Polynomial) -> Iterator[Root]:
    """Yield the distinct real roots of a polynomial in [0, 1], isolated, in ascending order."""
    simple = _quotient(p, _common_divisor(p, _derivative(p))) if len(p) > 2 else p
    waiting = [(Fraction(0), Fraction(1))]
    if _sign_at(simple, Fraction(0)) == 0:
        yield Root(Fraction(0), Fraction(0))
    while waiting:
        low, high = waiting.pop()
        count = _changes(simple, low, high)
        if count == 1:
            yield Root(low, high)
        if count < 2:
            if _sign_at(simple, high) == 0:
                yield Root(high, high)
            continue
        middle = (low + high) / 2
        waiting += [(middle, high), (low, middle)]


def _changes(p: Polynomial, low: Fraction, high: Fraction) -> int:
    """Return the sign changes of p's Bernstein coefficients over [low, high]; 0 and 1 are the roots inside."""
    degree, length = len(p) - 1, high - low
    shifted = [Fraction(x) for x in p]
    for k in range(degree):  # p(low + x)
        for i in range(degree - 1, k - 1, -1):
            shifted[i] += low * shifted[i + 1]
    scaled = [x * length**k for k, x in enumerate(shifted)]
    signs = [
        _sign(sum((comb(i, k) * scaled[k] / comb(degree, k) for k in range(i + 1)), Fraction(0)))
        for i in range(degree + 1)
    ]
    seen = [x for x in signs if x]
    return sum(x != y for x, y in pairwise(seen))


def sign_at(q: Polynomial, root: Root, p: Polynomial) -> int:
    """Return the sign of q at a root of p."""
    if not q:
        return 0
    if root.low == root.high:
        return _sign_at(q, root.low)
    shared = _common_divisor(p, q)
    if len(shared) > 1 and any(True for _ in _inside(shared, root)):
        return 0
    low, high = root
    while any(True for _ in _inside(q, Root(low, high))):
        low, high = _halved(p, low, high)
        if low == high:
            return _sign_at(q, low)
    return _sign_at(q, (low + high) / 2)


def _inside(p: Polynomial, root: Root) -> Iterator[Root]:
    """Yield the roots of p in the open interval of a root, mapped to [0, 1]."""
    mapped = _mapped(p, root.low, root.high)
    return (found for found in unit_roots(mapped) if not (found.low == found.high and found.low in (0, 1)))


def _mapped(p: Polynomial, low: Fraction, high: Fraction) -> Polynomial:
    """Return q with q(x) = p(low + x·(high - low)), up to a positive factor."""
    total: list[Fraction] = []
    for coefficient in reversed(p):
        shifted = [Fraction(0), *(x * (high - low) for x in total)]
        total = [x + low * y for x, y in zip(shifted, [*total, Fraction(0)], strict=True)]
        total[0] += coefficient
    scale = lcm(*(x.denominator for x in total))
    return _trimmed([int(x * scale) for x in total])


def _halved(p: Polynomial, low: Fraction, high: Fraction) -> tuple[Fraction, Fraction]:
    """Return the half of an isolating interval that holds the root of p."""
    middle = (low + high) / 2
    if _sign_at(p, middle) == 0:
        return middle, middle
    inside = any(True for _ in _inside(p, Root(low, middle)))
    return (low, middle) if inside else (middle, high)


def _turn(p: Polynomial, root: Root) -> int:
    """Return the sign of p after a root of odd order (the opposite before it), 0 at one of even order."""
    low, high = root
    if low == high:
        order = 0
        while _sign_at(p, low) == 0:
            p, order = _derivative(p), order + 1
        return _sign_at(p, low) if order % 2 else 0
    while _sign_at(p, low) == 0 or _sign_at(p, high) == 0:  # an end may be another root
        low, high = _halved(p, low, high)
        if low == high:
            return _turn(p, Root(low, low))
    after = _sign_at(p, high)
    return after if after != _sign_at(p, low) else 0


def _refined(p: Polynomial, root: Root, turn: int) -> Fraction:
    """Return the root of p in an isolating interval, to `ROOT_WIDTH`; `turn` is the sign of p behind it."""
    low, high = root
    while high - low > ROOT_WIDTH:
        middle = (low + high) / 2
        sign = _sign_at(p, middle)
        if sign == 0:
            return middle
        low, high = (low, middle) if sign == turn else (middle, high)
    return (low + high) / 2
