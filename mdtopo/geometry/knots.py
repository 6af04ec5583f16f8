"""Which knot a closed polygon is in one frame, as far as the knot determinant tells.

Computed from the positions of a single frame, without any motion; it shares no code with the search for passages, which
it audits: a polygon whose determinant changes between two frames has passed through itself.
"""

import numpy as np

from mdtopo.errors import AuditError, InputError
from mdtopo.geometry.diagram import gauss_code, rotation
from mdtopo.geometry.modular import exact_determinant
from mdtopo.geometry.polygons import checked_polygon, unit_scale
from mdtopo.typing import Flags, Indices, Points

N_DIRECTIONS = 24
"""Projections tried. A direction fails by chance with a probability near n²·1e-12, so only contacts exhaust them."""


def knot_determinant(p: Points, most_crossings: int | None = None) -> int:
    """Return the knot determinant |Δ(-1)| of a closed polygon: 1 for the unknot, 3 for the trefoil, 5 for 4₁.

    The polygon is projected along a fixed sequence of directions until one gives a diagram in which every crossing,
    what lies over what, and the order along each edge are beyond rounding. Reidemeister moves that remove one or two
    crossings are applied where the Gauss code shows them. The determinant of the colouring matrix without one row and
    column is computed modulo as many primes as Hadamard's bound asks for.

    Parameters
    ----------
    p : ndarray, shape (n, 3)
        Vertices in order, Å; the last is joined to the first.
    most_crossings : int, optional
        Give up where the diagram keeps more crossings than this: the time grows with their third power at worst.

    Returns
    -------
    int
        Odd and positive. Two polygons with different determinants are different knots; the converse does not hold.

    Guarantee
    ---------
    Proven for the stored coordinates: no decision within rounding is taken, and the determinant is exact.

    Raises
    ------
    InputError
        The polygon touches itself, to rounding, the array cannot be used, or there are too many crossings.
    AuditError
        The determinant came out even, which no knot has: a bug.

    Notes
    -----
    Livingston, Knot Theory (1993), chapter 3. Virtual equivalence (Goussarov, Polyak and Viro, Topology 39 (2000) 1045)
    makes the moves on the Gauss code right without a look at the plane.
    """
    vertices = checked_polygon(p, "p", 3)
    vertices = vertices[np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)]
    if len(vertices) < 3:
        raise InputError("p has fewer than 3 distinct vertices in a row; such a polygon has no knot type.")
    vertices = (vertices - vertices[0]) * unit_scale(vertices - vertices[0])
    for k in range(N_DIRECTIONS):
        code = gauss_code(vertices @ rotation(k))
        if code is not None:
            n_crossings = len(code[0]) // 2
            if most_crossings is not None and n_crossings > most_crossings:
                raise InputError(
                    f"The diagram of p keeps {n_crossings} crossings, more than most_crossings = {most_crossings}; "
                    "allow more, and time for it."
                )
            value = abs(exact_determinant(_colouring_minor(*code)))
            if value % 2 == 0:
                raise AuditError(
                    f"The knot determinant of a polygon of {len(p)} vertices came out as {value}, not odd."
                )
            return value
    raise InputError(
        f"p has no clear projection in {N_DIRECTIONS} directions; a polygon that touches itself, to rounding, has no "
        "knot type. Check for vertices that coincide and for edges that meet."
    )


def _colouring_minor(crossing: Indices, over: Flags) -> Indices:
    """Return the colouring matrix without its last row and column.

    An arc runs from one lower passage to the next. The row of a crossing holds 2 for the arc above and -1 for each of
    the two that end below it.
    """
    n = len(crossing) // 2
    if n < 2:
        return np.empty((0, 0), np.int64)
    under = np.logical_not(over)
    arc: Indices = (np.cumsum(under) - under) % n  # the arc that arrives at a passage
    matrix = np.zeros((n, n), np.int64)
    np.add.at(matrix, (crossing[over], arc[over]), 2)
    np.add.at(matrix, (crossing[under], arc[under]), -1)
    np.add.at(matrix, (crossing[under], (arc[under] + 1) % n), -1)
    return matrix[:-1, :-1].copy()
