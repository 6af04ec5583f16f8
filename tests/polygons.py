"""Polygons of known topology, and what their projections along z show, in exact arithmetic."""

from fractions import Fraction

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

Points = NDArray[np.float64]
Place = tuple[int, Fraction, int, Fraction, bool, int]
SQUARE = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
THROUGH = np.array([[0.0, 0, 1], [0, 0, -1], [3, 0, -1], [3, 0, 1]])
# six sticks suffice for a trefoil: case T8
STICK_TREFOIL = np.array([[-24.0, -4, 17], [6, 2, -13], [24, 8, 11], [-18, -10, -7], [-6, 26, -1], [18, -22, -7]]) / 6


def turned(x: Points, seed: int) -> Points:
    matrix, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return x @ (matrix * np.sign(np.linalg.det(matrix)))


def turns(n: int) -> Points:
    return np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)


def torus_curve(p: int, q: int, n: int, phase: float = 0.0) -> Points:
    """Return a curve that runs p times around the axis and q times around the core of a torus."""
    t = turns(n)
    radius = 2.0 + np.cos(q * t + phase)
    return np.column_stack([radius * np.cos(p * t), radius * np.sin(p * t), -np.sin(q * t + phase)])


def figure_eight(n: int) -> Points:
    t = turns(n)
    return np.column_stack([(2 + np.cos(2 * t)) * np.cos(3 * t), (2 + np.cos(2 * t)) * np.sin(3 * t), np.sin(4 * t)])


def long_trefoil(mirrored: bool) -> Points:
    """Return an open trefoil from (-3, 0, 0) to (3, 0, 0), which can be tied in a row with others."""
    t = np.linspace(-2.2, 2.2, 40)
    x = np.column_stack([t**3 - 3 * t, t**4 - 4 * t**2, t**5 / 5 - 2 * t])
    return np.vstack([[-8.0, 20, 0], x if not mirrored else x * [1, 1, -1], [8.0, 20, 0]])


def closed_sum(*signs: bool) -> Points:
    """Return trefoils tied in a row, closed far above."""
    parts = [long_trefoil(s) + np.array([40.0 * k, 0, 0]) for k, s in enumerate(signs)]
    return np.vstack([*parts, [[40.0 * len(signs), 60, 0], [-40, 60, 0]]])


def random_ring(seed: int, n: int, spread: float = 1.0) -> Points:
    return np.random.default_rng(seed).normal(size=(n, 3)) * spread


def polygons(n_most: int, first_seed: int = 0) -> st.SearchStrategy[Points]:
    """Polygons of a seed rather than of free floats: those touch themselves nearly always."""
    return st.builds(random_ring, st.integers(first_seed, first_seed + 2**32 - 1), st.integers(3, n_most))


def exact(x: Points) -> list[tuple[Fraction, ...]]:
    return [tuple(Fraction(float(v)) for v in row) for row in x]


def crossings_seen_along_z(p: Points, q: Points, skip: set[tuple[int, int]]) -> list[Place]:
    """Return edge and place on p, edge and place on q, whether p is above, and the sign, of all crossings seen."""
    x, y, found = exact(p), exact(q), []
    for i in range(len(x)):
        for j in range(len(y)):
            if (i, j) in skip:
                continue
            a, b, c, d = x[i], x[(i + 1) % len(x)], y[j], y[(j + 1) % len(y)]
            e, f, r = ([v - u for u, v in zip(*ends, strict=True)] for ends in ((a, b), (c, d), (a, c)))
            turn = e[0] * f[1] - e[1] * f[0]
            if turn == 0:
                continue  # parallel in projection: they pass each other by
            s, t = (r[0] * f[1] - r[1] * f[0]) / turn, (r[0] * e[1] - r[1] * e[0]) / turn
            if 0 <= s <= 1 and 0 <= t <= 1:
                assert not {s, t} & {0, 1}
                height = a[2] + s * e[2] - c[2] - t * f[2]
                assert height != 0
                found.append((i, s, j, t, height > 0, 1 if turn * height > 0 else -1))
    return found


def linking_seen(p: Points, q: Points) -> Fraction:
    return Fraction(sum(place[5] for place in crossings_seen_along_z(p, q, set())), 2)


def determinant_of_fractions(rows: list[list[Fraction]]) -> Fraction:
    value, rows = Fraction(1), [row[:] for row in rows]
    for k in range(len(rows)):
        pivot = next((i for i in range(k, len(rows)) if rows[i][k]), None)
        if pivot is None:
            return Fraction(0)
        if pivot != k:
            rows[k], rows[pivot], value = rows[pivot], rows[k], -value
        value *= rows[k][k]
        for i in range(k + 1, len(rows)):
            if rows[i][k]:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [u - factor * v for u, v in zip(rows[i], rows[k], strict=True)]
    return value
