"""Rational numbers and the vector algebra over them (the functions on vectors take any kind of number)."""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from numbers import Integral
from typing import Any, TypeAlias

Number: TypeAlias = Any  # float, int, str or Fraction: whatever `fraction` takes
Vector: TypeAlias = Sequence[Fraction]


def fraction(value: Number) -> Fraction:
    """Return the number as it is stored: a float is the dyadic rational of its bits."""
    if isinstance(value, (Fraction, str)):
        return Fraction(value)
    return Fraction(int(value)) if isinstance(value, Integral) else Fraction(float(value))


def exact_points(points: Iterable[Iterable[Number]]) -> list[list[Fraction]]:
    return [[fraction(x) for x in point] for point in points]


def sign(value: Any) -> int:
    return (value > 0) - (value < 0)


def dot(p: Sequence[Any], q: Sequence[Any]) -> Any:
    return sum((x * y for x, y in zip(p, q, strict=True)), start=0 * p[0])


def minus(p: Sequence[Any], q: Sequence[Any]) -> list[Any]:
    return [x - y for x, y in zip(p, q, strict=True)]


def plus(p: Sequence[Any], q: Sequence[Any]) -> list[Any]:
    return [x + y for x, y in zip(p, q, strict=True)]


def scaled(factor: Any, p: Sequence[Any]) -> list[Any]:
    return [factor * x for x in p]


def cross(p: Sequence[Any], q: Sequence[Any]) -> list[Any]:
    return [
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    ]


def solve(matrix: Sequence[Vector], right: Vector) -> list[Fraction] | None:
    """Return the solution of a square linear system (Gauss-Jordan), None where it is singular."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for i in range(len(rows)):
        pivot = next((k for k in range(i, len(rows)) if rows[k][i] != 0), None)
        if pivot is None:
            return None
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(len(rows)):
            if k != i:
                rows[k] = minus(rows[k], scaled(rows[k][i], rows[i]))
    return [row[-1] for row in rows]


def determinant(matrix: Sequence[Sequence[Fraction]]) -> Fraction:
    """Return the determinant by elimination; 1 for the empty matrix."""
    rows, value = [list(row) for row in matrix], Fraction(1)
    for i in range(len(rows)):
        pivot = next((k for k in range(i, len(rows)) if rows[k][i] != 0), None)
        if pivot is None:
            return Fraction(0)
        if pivot != i:
            rows[i], rows[pivot], value = rows[pivot], rows[i], -value
        value *= rows[i][i]
        for k in range(i + 1, len(rows)):
            rows[k] = minus(rows[k], scaled(rows[k][i] / rows[i][i], rows[i]))
    return value
