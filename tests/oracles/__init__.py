"""Slow and obvious judges of every kernel, which share no code with the package.

| module | answers |
|---|---|
| `exact` | rational numbers and vectors |
| `polynomials` | real roots by Sturm sequences, and signs at algebraic numbers |
| `distances` | edge-edge distance, distance of the origin to a hull, ν and the terms it runs over |
| `passages` | every contact and every crossing of a linear motion, decided in rational arithmetic |
| `lattice` | nearest images, whole strands, the images within range |
| `invariants` | linking number, writhe, knot determinant, best rotation |
| `beziers` | points, pieces and differences of Bezier curves |
| `zeros` | zeros of polynomial maps on a box |
| `curves` | where a composite curve meets itself, at rest and while it moves |
| `splines` | splines from their definitions |
| `tubes` | thickness of closed curves by dense sampling |

Numbers may come as floats (taken as the dyadic rationals they are), integers, Fractions or strings ("1/3").
"""

from oracles.distances import (
    Separation,
    Term,
    disjoint_terms,
    edge_distance,
    hull_distance,
    least_distance_during,
    nu,
    sampled_distance_during,
    squared_edge_distance_exact,
    squared_hull_distance_exact,
)
from oracles.exact import exact_points, fraction
from oracles.invariants import (
    best_rotation,
    knot_determinant,
    linking_number,
    linking_number_exact,
    writhe,
)
from oracles.lattice import make_whole_brute, nearest_image_brute
from oracles.passages import Contact, Event, Passages, is_free, pair_passages, passages

__all__ = [
    "Contact",
    "Event",
    "Passages",
    "Separation",
    "Term",
    "best_rotation",
    "disjoint_terms",
    "edge_distance",
    "exact_points",
    "fraction",
    "hull_distance",
    "is_free",
    "knot_determinant",
    "least_distance_during",
    "linking_number",
    "linking_number_exact",
    "make_whole_brute",
    "nearest_image_brute",
    "nu",
    "pair_passages",
    "passages",
    "sampled_distance_during",
    "squared_edge_distance_exact",
    "squared_hull_distance_exact",
    "writhe",
]
