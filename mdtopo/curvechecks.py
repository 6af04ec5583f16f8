"""What the referee says of the smooth curve in one step of a results file."""

from collections.abc import Iterator

import numpy as np

from mdtopo.records import CurveVerdict, MonitorConfig
from mdtopo.referee import CurveCase, StepCase
from mdtopo.store import Results

SAME_PLACE = 1e-8
"""Two places of a crossing coincide up to this multiple of the greatest length: t, u and v are right to some 1e-11."""

CLEAR_TURN = 1e-6
"""Below this, relative to the lengths of the three vectors, the sign of a passage is not held against the file."""

ROUNDING = 1e-12
"""And a clearance may exceed a sampled distance by this multiple of the greatest length."""


def curve_differences(found: Results, step: int, case: StepCase) -> Iterator[str]:
    """Yield where a step's curve in a results file contradicts the splines that SciPy makes of the same path.

    Guarantee
    ---------
    Each crossing that the file lists is looked at: whether the two places coincide at its time, and its sign.
    Clearances of certified steps are held against sampled distances. Crossings that the file lacks are not looked for.
    """
    row, steps = step - found.first_step, found.steps
    if "curve_verdict" not in steps or steps["curve_verdict"][row] == CurveVerdict.NONE:
        return
    verdict = CurveVerdict(int(steps["curve_verdict"][row]))
    stored = list(found.curve_crossings.of_step(step))
    if (verdict is CurveVerdict.CROSSING) != bool(stored):
        yield f"the curve is {verdict.name}, and the file lists {len(stored)} crossings of it"
    curve = CurveCase.of(case, MonitorConfig.from_mapping(found.config).curve)
    for crossing in stored:
        (a, b), (c, d) = crossing.edges.tolist()
        s, r = crossing.parameters.tolist()
        x, y, z = crossing.image.tolist()
        gap, turn = curve.gap(crossing.t, ((a, b), (c, d)), (s, r), (x, y, z))
        words = f"{crossing.residues[0]} through {crossing.residues[1]} at t = {crossing.t:.9g}"
        if not gap <= SAME_PLACE * case.scale:
            yield f"the curve does not pass {words}: its two places are {gap:.6g} Å apart by the referee"
        elif abs(turn) > CLEAR_TURN and np.sign(turn) != crossing.sign:
            yield f"the curve passes {words} with the sign {-crossing.sign:+d} by the referee"
    claimed = float(steps["curve_clearance"][row])
    if verdict is CurveVerdict.CERTIFIED and claimed > 0.0:
        distance = curve.least_distance(claimed)
        if distance is not None and claimed > distance + ROUNDING * case.scale:
            yield f"curve_clearance is {claimed:.9g} Å in the file, but such segments come within {distance:.9g} Å"
