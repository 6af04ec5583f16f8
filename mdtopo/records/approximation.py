"""A polyline that stands for a smooth curve, how far it is from it, and whether it has its type."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from mdtopo.typing import Indices, Points


class Isotopy(IntEnum):
    """Whether a polyline is ambient isotopic to its curve, and by which argument.

    NOT_KNOWN: nothing is claimed. TUBE: every chord lies in the tube about the curve, and every chord and the tangents
    of its arc make acute angles, so each normal disk of the tube meets the polyline once; proven. TUBE_SAMPLED: the
    same, seen at samples of a curve that is known by functions only; heuristic. HOMOTOPY: a finer polyline has the
    curve's type by its tube, and moves to the polyline without passing through itself; proven.
    """

    NOT_KNOWN = 0
    TUBE = 1
    TUBE_SAMPLED = 2
    HOMOTOPY = 3


@dataclass(frozen=True, slots=True, eq=False)
class Approximation:
    """The vertices of a polyline on a curve.

    Attributes
    ----------
    parameters : ndarray, shape (n,)
        Where on their strand the vertices lie, rising from 0 to 1; N + 1 values for one strand of N chords.
    points : ndarray, shape (n, 3)
        The vertices, Å. Those of a closed strand end with its first one again.
    offsets : ndarray of int, shape (n_strands + 1,)
        Strand s has the vertices ``offsets[s]`` … ``offsets[s + 1] - 1``.
    epsilon : float
        The ε of the rule that placed them, Å.
    chord_error : float
        Greatest distance of the curve from its chords, Å: proven for Bezier curves, where it is an upper bound; the
        greatest that was found, where the curve is known by functions only.
    chord_bound : float
        What |c''| allows this distance to be, Å; at most ε.
    isotopy : Isotopy
    reason : str
        Why `isotopy` is what it is, in words.
    """

    parameters: NDArray[np.float64]
    points: Points
    offsets: Indices
    epsilon: float
    chord_error: float
    chord_bound: float
    isotopy: Isotopy
    reason: str

    @property
    def n_chords(self) -> int:
        """N, the number of chords."""
        return len(self.parameters) - len(self.offsets) + 1
