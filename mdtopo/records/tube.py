"""The tube about a smooth curve: how thick it may be, and what forbids more."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class TubeLimit(IntEnum):
    """What limits the radius of a tube.

    CURVATURE: 1/κ_max. SELF: half the least distance of a doubly normal pair of one strand. STRANDS: half the least
    distance of two strands. END_BODY: half the distance of an open strand's end to a point of its body whose tangent is
    normal to the line between them. END_END: half the distance of an open strand's two ends.
    """

    CURVATURE = 0
    SELF = 1
    STRANDS = 2
    END_BODY = 3
    END_END = 4


@dataclass(frozen=True, slots=True)
class TubeTerm:
    """One limit of a tube's radius.

    Attributes
    ----------
    limit : TubeLimit
    radius : float
        The radius that it allows, Å; infinite where it forbids nothing.
    least, found : float
        For `CURVATURE` the bounds of the radius of curvature 1/κ_max, for the others those of the distance, Å: the true
        value is at least `least`, and at most `found`, which was met at `where` (inf where nothing was met).
    where : tuple of float
        One parameter, or two. On Bezier segments a parameter is the segment plus u; of an end it is that end's.
    """

    limit: TubeLimit
    radius: float
    least: float
    found: float
    where: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Tube:
    """The greatest radius at which the tube about a curve does not meet itself.

    Attributes
    ----------
    terms : tuple of TubeTerm
        Every limit that the curve has.
    is_proven : bool
        Whether the radius is a proven lower bound, or one from samples of a curve that is known by functions only.
    """

    terms: tuple[TubeTerm, ...]
    is_proven: bool

    @property
    def ruling(self) -> TubeTerm:
        """The term that allows least."""
        return min(self.terms, key=lambda term: term.radius)

    @property
    def radius(self) -> float:
        """Radius, Å: the least that a term allows."""
        return self.ruling.radius

    @property
    def radius_at_most(self) -> float:
        """Upper bound of the radius, Å, by what was found."""
        return min(t.found if t.limit is TubeLimit.CURVATURE else 0.5 * t.found for t in self.terms)

    @property
    def kappa_max(self) -> float:
        """An upper bound of the greatest curvature, 1/Å."""
        least = self.term(TubeLimit.CURVATURE).least
        return 1.0 / least if least > 0.0 else np.inf

    @property
    def self_distance(self) -> float:
        """A lower bound of the least distance of doubly normal pairs, Å; infinite where there is none."""
        return self.term(TubeLimit.SELF).least

    def term(self, limit: TubeLimit) -> TubeTerm:
        """Return one limit; where the curve has no such, a term that forbids nothing."""
        nothing = TubeTerm(limit, np.inf, np.inf, np.inf, ())
        return next((term for term in self.terms if term.limit is limit), nothing)
