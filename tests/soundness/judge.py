"""What exact arithmetic holds against a step that was measured, and how often it agreed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from oracles import Event, Passages, pair_passages
from oracles.separation import apart
from soundness.families import Points, in_hex

from mdtopo.bonds import reference_lengths
from mdtopo.measure import Setting, measure_block
from mdtopo.records import FrameBlock, MonitorConfig, StepReport, StepTable, Strands, Verdict

LAB = MonitorConfig(motion="lab")

SAME_TIME = 1e-9
"""A crossing is the exact one if their times, as shares of the step, agree to this."""


def measured(
    x0: Points, x1: Points, strands: Strands, cells: tuple[Points, Points] | None = None
) -> tuple[StepTable, NDArray[np.int64]]:
    """Return the table of the steps x0[k] → x1[k], and the row of each; no edge ever counts as broken.

    An unusable frame stands between two steps, so that what leads from one to the next is not measured.
    """
    n = len(x0)
    frames = np.stack([x0, x1, np.zeros_like(x0)], axis=1).reshape(-1, *x0.shape[1:])
    boxes = None if cells is None else np.stack([*cells, cells[1]], axis=1).reshape(-1, 3, 3)
    setting = Setting.start(strands, LAB, reference_lengths(np.full((1, len(strands.edges)), np.nan)))
    problems = ("", "", "it keeps two steps apart") * n
    block = FrameBlock(0, np.arange(3 * n), np.arange(3 * n, dtype=float), frames, boxes, problems)
    return measure_block(block, setting)[0], 3 * np.arange(n)


def free_of_contact(x0: Points, x1: Points) -> NDArray[np.bool_]:
    """Return where the edges (0, 1) and (2, 3) never meet: exact, and the slow judge sees only what is not clear."""
    free = apart(x0, x1, halvings=4)
    for k in np.flatnonzero(~free):
        found = exact_pair(x0[k], x1[k])
        free[k] = not (found.events or found.contacts)
    return free


def exact_pair(x0: Points, x1: Points) -> Passages:
    """Return the crossings and contacts of the edges (0, 1) and (2, 3)."""
    return pair_passages(x0.reshape(2, 2, 3), x1.reshape(2, 2, 3))


def in_order(event: Event) -> Event:
    """Return the event with the edge of the lower first vertex first, as crossings are listed; its sign stays."""
    if event.first[0] <= event.second[0]:
        return event
    opposite = tuple(-n for n in event.shift)
    return replace(
        event,
        first=event.second,
        second=event.first,
        s=event.r,
        r=event.s,
        shift=(opposite[0], opposite[1], opposite[2]),
    )


def complaint(report: StepReport, exact: Passages, rounding: float = 0.0) -> str:
    """Return what is false in a step's verdict or crossings, in a word or two; empty where nothing is.

    `rounding`, in Å, is what positions may be off by once they are placed in a cell: over the motion it is a time.
    """
    if report.verdict is Verdict.CERTIFIED and (exact.events or exact.contacts):
        return "false certificate"
    if (report.verdict is Verdict.CROSSING) != bool(len(report.crossings)) and report.verdict is not Verdict.UNRESOLVED:
        return "verdict and crossings disagree"
    if report.n_crossings != len(report.crossings):
        return "wrong count of crossings"
    left = [in_order(event) for event in exact.events]
    for crossing in report.crossings:
        (a, b), (c, d) = crossing.edges.tolist()
        same = [
            event
            for event in left
            if (event.first, event.second, event.shift) == ((a, b), (c, d), tuple(crossing.image.tolist()))
            and event.sign == crossing.sign
            and abs(event.t - crossing.t) <= SAME_TIME + (rounding / crossing.motion if rounding else 0.0)
        ]
        if not same:
            return "false crossing"
        left.remove(same[0])
    if report.verdict is Verdict.CROSSING and left:
        return "missed crossing"
    return ""


@dataclass(frozen=True, slots=True)
class Count:
    """How many steps were judged, what they were called, and what was false: each a word and the step."""

    steps: int = 0
    certified: int = 0
    crossing: int = 0
    unresolved: int = 0
    false: tuple[str, ...] = ()

    def __add__(self, other: "Count") -> "Count":
        return Count(
            self.steps + other.steps,
            self.certified + other.certified,
            self.crossing + other.crossing,
            self.unresolved + other.unresolved,
            self.false + other.false,
        )

    @classmethod
    def of(cls, verdicts: Iterable[int], false: Sequence[str]) -> "Count":
        seen = np.array(list(verdicts))
        certified, crossing = (int((seen == v).sum()) for v in (Verdict.CERTIFIED, Verdict.CROSSING))
        return cls(len(seen), certified, crossing, len(seen) - certified - crossing, tuple(false))

    def sentence(self, name: str) -> str:
        shares = [n / self.steps for n in (self.certified, self.crossing, self.unresolved)]
        return (
            f"{name}: {self.steps} steps, {shares[0]:.2%} certified, {shares[1]:.2%} crossing, "
            f"{shares[2]:.4%} unresolved, {len(self.false)} false"
        )


def judged_pairs(x0: Points, x1: Points, strands: Strands) -> Count:
    """Return what is false in the steps x0[k] → x1[k] of the edges (0, 1) and (2, 3), each on its own strand."""
    table, rows = measured(x0, x1, strands)
    verdict, nothing = table.verdict[rows], Passages((), ())
    listed = np.isin(rows + table.first_step, table.crossings.step)
    claims = (verdict != Verdict.UNRESOLVED) | listed
    to_certify = np.flatnonzero((verdict == Verdict.CERTIFIED) & ~listed)
    clear = np.zeros(len(x0), dtype=np.bool_)
    clear[to_certify] = apart(x0[to_certify], x1[to_certify], halvings=4)
    false = []
    for k in np.flatnonzero(claims & ~(clear & (table.n_crossings[rows] == 0))):
        wrong = complaint(table.report(rows[k]), nothing if clear[k] else exact_pair(x0[k], x1[k]))
        if wrong:
            false.append(f"{wrong}: {in_hex(x0[k], x1[k])}")
    return Count.of(verdict, false)
