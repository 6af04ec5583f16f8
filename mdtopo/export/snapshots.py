"""What is exported: the strands at one time, and what the results say of the step that begins there."""

from dataclasses import dataclass

from mdtopo.typing import Flags, Lengths, Points


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Whole strands at one time.

    Attributes
    ----------
    title : str
        Which frame, or which moment of which step, in words.
    time : float
        ps; NaN where the trajectory holds none.
    positions : ndarray, shape (n, 3)
        Å.
    clearance : ndarray, shape (n,)
        How close the edges of each vertex come to any other in the step that begins there, at least, Å; 0 where they
        cross, or nothing is proved; NaN where that step was not measured, or the vertex has no pair.
    closest : ndarray of bool, shape (n,)
        The vertices of the pair that holds the step's clearance.
    verdict : int
        Code of the step's `Verdict`; -1 where no step begins.
    is_proved : bool
        False for a moment between frames of a step that is not certified.
    """

    title: str
    time: float
    positions: Points
    clearance: Lengths
    closest: Flags
    verdict: int
    is_proved: bool = True
