"""Bezier curves in whole and rational numbers: values, pieces, and what is left once a known zero is divided out.

Arrays hold Bernstein coefficients along some of their axes, as Python integers in one common unit: no result here
depends on that unit, and so every function that returns `Whole` may multiply all its numbers by one positive factor.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from itertools import pairwise
from math import comb, lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oracles.exact import Number, exact_points, fraction, plus, scaled

Whole = NDArray[Any]  # of Python integers


def bezier_point(points: Sequence[Sequence[Number]], u: Number) -> list[Fraction]:
    """Return the point of one Bezier segment at the parameter u, by de Casteljau's rule."""
    level, at = exact_points(points), fraction(u)
    while len(level) > 1:
        level = [plus(scaled(1 - at, p), scaled(at, q)) for p, q in pairwise(level)]
    return level[0]


def bezier_derivative(points: Sequence[Sequence[Number]]) -> list[list[Fraction]]:
    """Return the control points of the derivative: degree times the differences of neighbours."""
    exact = exact_points(points)
    n = len(exact) - 1
    return [scaled(Fraction(n), [b - a for a, b in zip(p, q, strict=True)]) for p, q in pairwise(exact)]


def split_at(points: Sequence[Sequence[Number]], u: Number) -> tuple[list[list[Fraction]], list[list[Fraction]]]:
    """Return the control points of the two pieces before and after the parameter u."""
    level, at = exact_points(points), fraction(u)
    left, right = [level[0]], [level[-1]]
    while len(level) > 1:
        level = [plus(scaled(1 - at, p), scaled(at, q)) for p, q in pairwise(level)]
        left.append(level[0])
        right.append(level[-1])
    return left, right[::-1]


def whole_numbers(*arrays: Any) -> list[Whole]:
    """Return all arrays in the one unit in which every number of theirs is an integer."""
    exact = [np.vectorize(fraction, otypes=[object])(np.asarray(x, dtype=object)) for x in arrays]
    unit = lcm(*(int(v.denominator) for x in exact for v in x.flat))
    return [np.vectorize(lambda v: v.numerator * (unit // v.denominator), otypes=[object])(x) for x in exact]


@cache
def _restriction(degree: int, low: Fraction, high: Fraction) -> tuple[Whole, int]:
    """Return the matrix from Bernstein coefficients on [0, 1] to those on [low, high], times a positive integer.

    Coefficient k on [low, high] is the blossom (polar form) at `low` taken degree - k times and `high` k times.
    """
    matrix = []
    for k in range(degree + 1):
        rows = [[Fraction(int(i == j)) for j in range(degree + 1)] for i in range(degree + 1)]
        for at in [low] * (degree - k) + [high] * k:
            rows = [plus(scaled(1 - at, p), scaled(at, q)) for p, q in pairwise(rows)]
        matrix.append(rows[0])
    (integers,) = whole_numbers(matrix)
    factor = lcm(*(v.denominator for row in matrix for v in row))
    return integers, factor


def along(axis: int, matrix: Whole, f: Whole) -> Whole:
    """Return f with a matrix applied along one axis."""
    return np.asarray(np.moveaxis(np.tensordot(matrix, f, axes=(1, axis)), 0, axis))


def restricted(f: Whole, axis: int, low: Number, high: Number) -> Whole:
    """Return the coefficients over the part [low, high] of an axis; it may reach beyond [0, 1]."""
    return along(axis, _restriction(f.shape[axis] - 1, fraction(low), fraction(high))[0], f)


@cache
def _to_powers(degree: int) -> Whole:
    """Return the matrix from Bernstein coefficients to those of 1, u, u², …"""
    n = degree
    rows = [[(-1) ** (k - i) * comb(n, k) * comb(k, i) if i <= k else 0 for i in range(n + 1)] for k in range(n + 1)]
    return np.array(rows, dtype=object)


@cache
def _from_powers(degree: int) -> Whole:
    """Return the inverse of `_to_powers`, times a positive integer."""
    rows = [[Fraction(comb(i, k), comb(degree, k)) for k in range(degree + 1)] for i in range(degree + 1)]
    return whole_numbers(rows)[0]


def difference(one: Whole, other: Whole) -> Whole:
    """Return A(u) - B(v) as coefficients (…, degree of A + 1, degree of B + 1, 3)."""
    return np.asarray(one[..., :, np.newaxis, :] - other[..., np.newaxis, :, :])


def divided_difference(segment: Whole) -> Whole:
    """Return (A(u) - A(v)) / (u - v): zero at a double point, and for u = v where the derivative vanishes.

    Of u^k that is the sum of u^i v^j over i + j = k - 1.
    """
    n = segment.shape[-2] - 1
    powers = along(segment.ndim - 2, _to_powers(n), segment)
    terms = np.zeros((*segment.shape[:-2], n, n, segment.shape[-1]), dtype=object)
    for i in range(n):
        for j in range(n - i):
            terms[..., i, j, :] = powers[..., i + j + 1, :]
    return _in_bernstein(terms)


def joint_charts(one: Whole, other: Whole) -> tuple[Whole, Whole]:
    """Return A(u) - B(v) with the common point A(1) = B(0) divided out, for the two halves of the square.

    With x = 1 - u and y = v it is x·p(x) - y·q(y). The first holds x = s·y, divided by y, over (y, s); the second
    y = s·x, divided by x, over (x, s). At the common point they vanish only where the curve turns back on itself.
    """
    assert (one[..., -1, :] == other[..., 0, :]).all(), "the segments have no common point"
    axis = one.ndim - 2
    p = along(axis, _to_powers(one.shape[axis] - 1), one[..., ::-1, :])[..., 1:, :]
    q = along(axis, _to_powers(other.shape[axis] - 1), other)[..., 1:, :]
    return _in_bernstein(_chart(q, p)), _in_bernstein(-_chart(p, q))


def _chart(outer: Whole, inner: Whole) -> Whole:
    """Return s·inner(r s) - outer(r) as coefficients of r^i s^j."""
    n, m = outer.shape[-2], inner.shape[-2]
    terms = np.zeros((*outer.shape[:-2], max(n, m), m + 1, outer.shape[-1]), dtype=object)
    for k in range(n):
        terms[..., k, 0, :] -= outer[..., k, :]
    for k in range(m):
        terms[..., k, k + 1, :] += inner[..., k, :]
    return terms


def _in_bernstein(terms: Whole) -> Whole:
    for axis in (terms.ndim - 3, terms.ndim - 2):
        terms = along(axis, _from_powers(terms.shape[axis] - 1), terms)
    return terms
