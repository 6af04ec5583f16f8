"""A polyline that stands for a smooth curve, and how far it is from it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.typing import Points


@dataclass(frozen=True, slots=True, eq=False)
class Approximation:
    """The vertices of a polyline on a curve.

    Attributes
    ----------
    parameters : ndarray, shape (N + 1,)
        Where on the curve the vertices lie, rising from 0 to 1.
    points : ndarray, shape (N + 1, 3)
        The vertices, Å. Those of a closed curve end with the first one again.
    epsilon : float
        The ε of the rule that placed them, Å.
    chord_error : float
        Greatest distance of the curve from its chords that was found, Å.
    chord_bound : float
        What |c''| allows this distance to be, Å; at most ε.
    """

    parameters: NDArray[np.float64]
    points: Points
    epsilon: float
    chord_error: float
    chord_bound: float

    @property
    def n_chords(self) -> int:
        """N, the number of chords."""
        return len(self.parameters) - 1
