"""Is the save interval good enough? The share of the steps that could be proved, against the spacing of the frames."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mdtopo.report.rundata import RunData
from mdtopo.typing import Times

N_SPACINGS = 60


@dataclass(frozen=True, slots=True, eq=False)
class IntervalAdvice:
    """Shares of the steps that would be proved at some spacings; an estimate, see `interval_advice`.

    Attributes
    ----------
    spacings : ndarray, shape (m,)
        ps.
    by_ball, by_pairs : ndarray, shape (m,)
        Shares from 0 to 1, by the paper's bound and pair by pair.
    spacing : float
        The spacing of the run, ps.
    now_by_ball, now_by_pairs : float
        The shares at that spacing.
    longest : float
        The greatest spacing at which every step would be proved by pairs, ps.
    """

    spacings: Times
    by_ball: NDArray[np.float64]
    by_pairs: NDArray[np.float64]
    spacing: float
    now_by_ball: float
    now_by_pairs: float
    longest: float


def interval_advice(run: RunData) -> IntervalAdvice | None:
    """Return the advice for a run; None where its frames have no times.

    Guarantee
    ---------
    Heuristic: displacements are taken to grow in proportion to the spacing, which free diffusion does not do. A step
    that was not measured counts as one that would not be proved.
    """
    spacing = run.spacing
    if not np.isfinite(spacing) or not run.n_steps:
        return None
    gaps = run.columns["time_t1"] - run.columns["time_t0"]
    pairs = np.nan_to_num(run.columns["certifiable_interval"], nan=0.0, posinf=np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        ball = np.nan_to_num(gaps / run.columns["nu_ratio"], nan=0.0, posinf=np.inf)
    finite = np.concatenate([pairs[np.isfinite(pairs) & (pairs > 0)], ball[np.isfinite(ball) & (ball > 0)], [spacing]])
    low, high = min(finite.min(), spacing) / 2.0, max(np.quantile(finite, 0.999), spacing) * 2.0
    spacings = np.geomspace(low, high, N_SPACINGS)
    return IntervalAdvice(
        spacings,
        share_above(ball, spacings),
        share_above(pairs, spacings),
        spacing,
        now_by_ball=float(share_above(ball, np.array([spacing]))[0]),
        now_by_pairs=float(share_above(pairs, np.array([spacing]))[0]),
        longest=float(pairs.min()),
    )


def share_above(intervals: Times, spacings: Times) -> NDArray[np.float64]:
    """Return the share of the intervals that are longer than each spacing.

    Examples
    --------
    >>> share_above(np.array([1.0, 2.0, 4.0, 8.0]), np.array([2.0, 5.0])).tolist()
    [0.5, 0.25]
    """
    return 1.0 - np.searchsorted(np.sort(intervals), spacings, side="right") / len(intervals)


def percent(share: float) -> str:
    """Return a share in words; only what is exactly all is 100 %.

    Examples
    --------
    >>> percent(1.0), percent(0.99999), percent(0.5)
    ('100 %', '99.9 %', '50 %')
    """
    if share in (0.0, 1.0):
        return f"{share * 100:.0f} %"
    floored = np.floor(share * 1000.0) / 10.0
    return f"{floored:g} %" if floored else "under 0.1 %"
