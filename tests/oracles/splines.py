"""Splines through or along points, straight from their definitions: dense linear systems in rational numbers."""

from collections.abc import Sequence
from fractions import Fraction

from oracles.exact import Number, Vector, exact_points, plus, scaled, solve

Cubics = list[list[list[Fraction]]]  # segments of four points


def interpolating_cubics(points: Sequence[Sequence[Number]], closed: bool) -> Cubics:
    """Return the cubic Bezier segments of the C² curve through the points, one unit of parameter each.

    Unknown are the two inner points a_i, b_i of each segment from p_i to p_{i+1}. Between two segments the first
    derivatives agree, b_{i-1} + a_i = 2 p_i, and the second, a_{i-1} - 2 b_{i-1} = b_i - 2 a_i. The second derivative
    is zero at the ends of an open curve.
    """
    p = exact_points(points)
    n = len(p)
    m = n if closed else n - 1
    rows: list[list[Fraction]] = []
    right: list[Vector] = []

    def condition(terms: dict[int, int], value: Vector) -> None:
        rows.append([Fraction(terms.get(k, 0)) for k in range(2 * m)])
        right.append(value)

    nothing = [Fraction(0)] * len(p[0])
    for i in range(m) if closed else range(1, m):
        a_before, b_before, a, b = 2 * ((i - 1) % m), 2 * ((i - 1) % m) + 1, 2 * i, 2 * i + 1
        condition({b_before: 1, a: 1}, scaled(Fraction(2), p[i]))
        condition(_summed([(a_before, 1), (b_before, -2), (a, 2), (b, -1)]), nothing)
    if not closed:
        condition({0: 2, 1: -1}, p[0])
        condition({2 * m - 2: -1, 2 * m - 1: 2}, p[-1])
    columns = [solve(rows, [value[k] for value in right]) for k in range(len(nothing))]
    inner = [[column[k] for column in columns if column is not None] for k in range(2 * m)]
    return [[p[i], inner[2 * i], inner[2 * i + 1], p[(i + 1) % n]] for i in range(m)]


def _summed(terms: list[tuple[int, int]]) -> dict[int, int]:
    total: dict[int, int] = {}
    for k, value in terms:
        total[k] = total.get(k, 0) + value
    return total


def b_spline_cubics(points: Sequence[Sequence[Number]], closed: bool) -> Cubics:
    """Return the uniform cubic B-spline with the points as control points, in Bezier form.

    Segment i is the blossom: with the knots i-2 … i+3 it has inner points a third and two thirds along (p_i, p_{i+1}),
    and ends in the middle between neighbouring inner points. An open curve goes on past its ends in a straight line
    (p_{-1} = 2 p_0 - p_1), so that it starts and ends at the end points.
    """
    p = exact_points(points)
    around = [p[-1], *p, p[0], p[1]] if closed else [_mirrored(p[1], p[0]), *p, _mirrored(p[-2], p[-1])]
    third, sixth = Fraction(1, 3), Fraction(1, 6)

    def knot(k: int) -> list[Fraction]:
        return scaled(sixth, plus(plus(around[k - 1], scaled(4, around[k])), around[k + 1]))

    return [
        [
            knot(i),
            scaled(third, plus(scaled(2, around[i]), around[i + 1])),
            scaled(third, plus(around[i], scaled(2, around[i + 1]))),
            knot(i + 1),
        ]
        for i in range(1, len(around) - 2)
    ]


def catmull_rom_cubics(points: Sequence[Sequence[Number]], closed: bool) -> Cubics:
    """Return the uniform Catmull-Rom spline: through the points, with derivative (p_{i+1} - p_{i-1}) / 2 at each.

    Past the ends of an open curve the points go on in a straight line, so that the derivative there is p_1 - p_0.
    """
    p = exact_points(points)
    around = [p[-1], *p, p[0], p[1]] if closed else [_mirrored(p[1], p[0]), *p, _mirrored(p[-2], p[-1])]
    sixth = Fraction(1, 6)

    def slope(k: int) -> list[Fraction]:
        return scaled(sixth, plus(around[k + 1], scaled(-1, around[k - 1])))

    return [
        [around[i], plus(around[i], slope(i)), plus(around[i + 1], scaled(-1, slope(i + 1))), around[i + 1]]
        for i in range(1, len(around) - 2)
    ]


def _mirrored(p: Vector, centre: Vector) -> list[Fraction]:
    return plus(scaled(2, centre), scaled(-1, p))
