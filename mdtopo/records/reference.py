"""How long each edge was at the start of the trajectory."""

from dataclasses import dataclass

from mdtopo.typing import Lengths


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceLengths:
    """Edge lengths of the trajectory's first frames, whichever range is analysed.

    Attributes
    ----------
    lengths : ndarray, shape (n_edges,)
        Median length of each edge over the reference frames, Å.
    median, spread : float
        Median and spread (half the width of the middle 68 %) of all edges in all reference frames together, Å.
    n_frames : int
        How many frames they come from.
    """

    lengths: Lengths
    median: float
    spread: float
    n_frames: int
