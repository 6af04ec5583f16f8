"""What the referee says of the profile in a results file: how close the edges of every vertex came."""

from collections.abc import Iterator

import numpy as np

from mdtopo.records import Reason
from mdtopo.referee import StepCase
from mdtopo.store import Results

SAME_NUMBER = 1e-9
"""A bound may exceed a sampled distance by this share of it …"""

ROUNDING = 1e-12
"""… and by this multiple of the greatest length."""

UNMEASURED = (Reason.BAD_DATA, Reason.CELL, Reason.IMAGE_JUMP)


def profile_differences(found: Results, step: int, case: StepCase) -> Iterator[str]:
    """Yield where the profile's row of a step, if it has one, contradicts what the referee finds.

    Guarantee
    ---------
    Distances are sampled, so a bound that is too large can be shown by it, and never be proved right.
    """
    profile, labels = found.profile, found.strands.labels
    if profile is None or step not in profile.step:
        return
    claimed = profile.clearance[int(np.flatnonzero(profile.step == step)[0])].astype(np.float64)
    near = case.vertex_distances(float(np.nanmax(claimed, initial=0.0)))
    if near is None:
        return
    excess = claimed - near * (1.0 + SAME_NUMBER) - ROUNDING * case.scale
    if (excess > 0.0).any():
        v = int(np.nanargmax(excess))
        yield f"the profile has {claimed[v]:.9g} Å at {labels.text(v)}, but its edges come within {near[v]:.9g} Å"
    for v in np.flatnonzero(np.isnan(claimed) & np.isfinite(near))[:1].tolist():
        yield f"the profile says that {labels.text(v)} has no pair, but its edges come within {near[v]:.9g} Å of others"


def profile_file_differences(found: Results) -> Iterator[str]:
    """Yield where the profile of a results file contradicts its step columns."""
    profile, steps = found.profile, found.steps
    if profile is None or not len(profile):
        return
    measured = np.isfinite(steps["clearance"]) & ~np.isin(steps["reason"], UNMEASURED)
    clearance = np.where(measured, steps["clearance"], np.inf)
    window = steps["frame_t0"] // profile.window_frames
    order = np.lexsort((np.arange(len(window)), clearance, window))
    windows, first = np.unique(window[order], return_index=True)
    rows = order[first]
    windows, rows = windows[measured[rows]], rows[measured[rows]]
    if windows.tolist() != profile.window.tolist():
        yield f"the profile has {len(profile)} windows, and the steps that were measured lie in {len(windows)} others"
        return
    wrong = (rows + found.first_step != profile.step) | (clearance[rows] != profile.least)
    for k in np.flatnonzero(wrong)[:1].tolist():
        yield (
            f"window {windows[k]} of the profile is of step {profile.step[k]} with {profile.least[k]:.9g} Å, and the "
            f"closest step in it is {rows[k] + found.first_step} with {clearance[rows[k]]:.9g} Å"
        )
