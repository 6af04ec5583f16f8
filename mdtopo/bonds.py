"""Edges against their own reference length: which are stretched, and which have broken.

Limits are chosen so that thermal motion never meets them and a break always does. An edge is *stretched* when it is
1.2 times its reference length and also ten standard deviations beyond the lengths that the run's edges had at its
start. The first number alone would fire on soft springs, which double their length at equilibrium; the second alone
would fire on stiff ones, for which ten deviations are a few per cent. A *fracture* (1.5 times, fifteen deviations)
must last for several frames, because one frame may be damaged.
"""

from dataclasses import dataclass

import numpy as np

from mdtopo.records import MonitorConfig, ReferenceLengths
from mdtopo.typing import Flags, Indices, Lengths, Ratios


def reference_lengths(samples: Lengths) -> ReferenceLengths:
    """Return the reference of each edge from its lengths in the first frames.

    Parameters
    ----------
    samples : ndarray, shape (n_frames, n_edges)
        Edge lengths, Å; rows of frames that could not be used are NaN.

    Notes
    -----
    Medians, and for the spread half the width of the middle 68 % (the standard deviation where lengths are normal), so
    that neither a damaged frame nor a bond that breaks at once makes the limits blunt. Without a usable
    frame every reference is NaN, and no edge is ever called stretched.
    """
    usable = samples[np.isfinite(samples).all(axis=1)]
    if not usable.size:
        return ReferenceLengths(np.full(samples.shape[1], np.nan), np.nan, np.nan, 0)
    low, middle, high = np.quantile(usable, [0.1587, 0.5, 0.8413])
    return ReferenceLengths(np.median(usable, axis=0), float(middle), float(0.5 * (high - low)), len(usable))


def lengths_to_divide_by(lengths: Lengths) -> Lengths:
    """Return the lengths as they are, NaN in the place of 0."""
    if lengths.min(initial=np.inf) > 0.0:  # nearly always, and much cheaper
        return lengths
    return np.where(lengths > 0.0, lengths, np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class BondLimits:
    """The ratio to its reference length at which each edge counts as stretched, and as broken.

    Attributes
    ----------
    reference : ndarray, shape (n_edges,)
        Reference lengths, Å.
    stretch, fracture : ndarray, shape (n_edges,)
        Dimensionless; NaN (never met) where the reference is unknown.
    """

    reference: Lengths
    stretch: Ratios
    fracture: Ratios

    @classmethod
    def of(cls, reference: ReferenceLengths, config: MonitorConfig) -> "BondLimits":
        """Return the limits that a configuration sets for a reference."""
        lengths = lengths_to_divide_by(reference.lengths)

        def limit(factor: float, spreads: float) -> Ratios:
            """Return the ratio from which on a bond is too long: by the factor, or by the spread where that is more."""
            beyond_spread = (reference.median + spreads * reference.spread) / lengths
            return np.maximum(factor, beyond_spread)  # NaN stays NaN

        return cls(
            lengths,
            limit(config.stretch_limit, config.stretch_spreads),
            limit(config.fracture_limit, config.fracture_spreads),
        )


@dataclass(frozen=True, slots=True, eq=False)
class BondState:
    """What is handed from step to step: which edges are broken, and for how many frames others have been too long.

    Attributes
    ----------
    broken : ndarray of bool, shape (n_edges,)
    streak : ndarray of int, shape (n_edges,)
        Consecutive frames beyond the fracture limit, up to and including the last one seen.
    """

    broken: Flags
    streak: Indices

    @classmethod
    def intact(cls, n_edges: int) -> "BondState":
        """Return the state at the start of a run."""
        return cls(np.zeros(n_edges, dtype=np.bool_), np.zeros(n_edges, dtype=np.int64))

    @property
    def is_intact(self) -> bool:
        """Whether no edge is broken, and none is on the way to it."""
        return not (self.broken.any() or self.streak.any())

    def after(self, ratios: Ratios, limits: BondLimits, n_frames: int) -> "BondState":
        """Return the state after one more frame.

        Parameters
        ----------
        ratios : ndarray, shape (n_edges,)
            Length over reference length; NaN for edges that are broken, or in a frame that cannot be used (such a frame
            neither adds to a streak nor ends it).
        limits : BondLimits
        n_frames : int
            Streak at which an edge is broken.
        """
        seen = np.isfinite(ratios)
        streak = np.where(seen, np.where(ratios >= limits.fracture, self.streak + 1, 0), self.streak)
        return BondState(self.broken | (streak >= n_frames), streak)
