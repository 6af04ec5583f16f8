"""The story of one step in words: what moved, how near what came, which rule decided, what would have settled it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdtopo.alerts import UNDECIDED, crossing_in_words
from mdtopo.curvestory import CURVE_REASONS, curve_story
from mdtopo.errors import InputError
from mdtopo.records import Alert, Crossing, Grade, MonitorConfig, PairClass, Reason, Rung, Scope, Verdict
from mdtopo.store import Results

VERDICTS = {
    Verdict.CERTIFIED: "CERTIFIED: proved that nothing passes through anything on straight paths between the frames.",
    Verdict.CROSSING: "CROSSING: proved that an edge passes through another on straight paths between the frames.",
    Verdict.UNRESOLVED: "UNRESOLVED: it is not known whether anything passed.",
}

RUNGS = {
    Rung.BALL: "the paper's ball: no vertex moves half of ν, so no two pieces can reach each other",
    Rung.TWO_FRAME_BALL: "the ball of both frames: no vertex moves the mean of ν before and after",
    Rung.BROAD_PHASE: "the broad phase: the spheres, or slabs, that the edges of each pair sweep stay apart",
    Rung.RELATIVE_MOTION: "relative motion: each pair moves less than its distances before and after, added up",
    Rung.DIRECTION: "a direction: a fixed plane keeps the edges of the pair apart during the whole step",
    Rung.HULL: "the hull: the convex hull of the pair's differences, before and after, leaves out zero",
    Rung.BISECTION: "bisection: the step was cut into pieces, and each piece was proved by relative motion",
    Rung.EXACT: "exact arithmetic: the times at which the edges lie in one plane were found and looked at",
    Rung.OPEN: "none: no rule settles every pair",
}

CLASSES = {
    PairClass.LOCAL: "neighbours on a strand",
    PairClass.SELF: "one strand, further apart",
    PairClass.INTER: "different strands",
}

REASONS = {
    Reason.LADDER: "no rung of the ladder settles every pair, and rounding hides what exact arithmetic would say",
    Reason.BAD_DATA: "one of the two frames cannot be used",
    Reason.CELL: "the periodic cell changes too much within the step to count images",
    Reason.IMAGE_JUMP: "an edge of about half a cell jumps by a lattice vector; nobody can tell which image it joins",
    Reason.FOLD: CURVE_REASONS[Reason.FOLD],
    **UNDECIDED,
}

CURES = {
    Reason.BAD_DATA: "Only a readable frame with the box of the others, and a time that increases, would settle it.",
    Reason.CELL: "Frames so close that the cell hardly changes between them would settle it.",
    Reason.IMAGE_JUMP: "A box more than three times as long as the edge would settle it; a finer spacing hardly.",
    Reason.FRAME: "Nothing that is measured between these frames settles it: edges touch in a stored frame.",
}


@dataclass(frozen=True, slots=True)
class Section:
    """A heading and its sentences."""

    title: str
    sentences: tuple[str, ...]


def step_of_frame(results: Results, frame: int) -> int:
    """Return the step that begins at a frame of the trajectory; of the last frame the step that ends there.

    Raises
    ------
    InputError
        If no step of the results begins or ends at this frame.
    """
    for name in ("frame_t0", "frame_t1"):
        rows = np.flatnonzero(results.steps[name] == frame)
        if len(rows):
            return results.first_step + int(rows[0])
    first, last = int(results.steps["frame_t0"].min(initial=0)), int(results.steps["frame_t1"].max(initial=0))
    raise InputError(f"No step begins or ends at frame {frame}; the analysed frames lie from {first} to {last}.")


def explain(results: Results, step: int) -> list[Section]:
    """Return the story of one step, every number of it from the results.

    Parameters
    ----------
    results : Results
        With all columns, and the row of the step if not others.
    step : int
        Its number.

    Raises
    ------
    InputError
        If the results hold no such step.
    """
    stored = results.stored
    if step not in stored:
        held = f"they hold the steps {stored.start} to {stored.stop - 1}" if stored else "they hold no step"
        raise InputError(f"The results have no step {step}; {held}.")
    return list(_Story(results, step).sections())


class _Story:
    """One row of the step columns, with what is needed to put it in words."""

    def __init__(self, results: Results, step: int) -> None:
        self.results, self.step = results, step
        self.row = {name: column[step - results.first_step] for name, column in results.steps.items()}
        self.config = MonitorConfig.from_mapping(results.config)
        self.verdict = Verdict(int(self.row["verdict"]))
        self.spacing = float(self.row["time_t1"]) - float(self.row["time_t0"])

    def sections(self) -> Iterator[Section]:
        """Yield the parts of the story, the verdict first."""
        measured = not np.isnan(self.row["displacement_max"])
        parts = [("Verdict", self._decision())]
        if measured:
            parts += [
                ("What moved", self._motion()),
                ("The paper's comparison", self._paper()),
                ("How near pairs came", self._pairs()),
                ("What decided", self._rung()),
            ]
        certified = self.verdict is Verdict.CERTIFIED
        title = "Up to which frame spacing" if certified else "What would settle it"
        parts += [
            ("Crossings", self._crossings()),
            (title, self._cure()),
            ("The smooth curve", curve_story(self.results, self.step, self.row, self.config.curve)),
            ("Alerts that touch the step", self._alerts()),
        ]
        for title, sentences in parts:
            told = tuple(sentences)
            if told:
                yield Section(title, told)

    def _decision(self) -> Iterator[str]:
        r = self.row
        clock = f", {r['time_t0']:g} to {r['time_t1']:g} ps" if math.isfinite(self.spacing) else ""
        yield f"Step {self.step} joins the frames {r['frame_t0']} and {r['frame_t1']}{clock}."
        yield VERDICTS[self.verdict]
        reason = Reason(int(r["reason"]))
        if reason is not Reason.NONE:
            yield f"Reason {reason.name}: {REASONS[reason]}."
        scope = Scope(int(r["scope"]))
        if scope is Scope.MOTION:
            yield "The certificate holds for the motion before the file rounded its coordinates too."
        if scope is Scope.STORED:
            error = self.config.coordinate_error or 0.0
            yield (
                "The certificate holds for the stored data only: the clearance is no more than twice the coordinate "
                f"error ({error:.3g} Å, and the rounding of arithmetic)."
            )
        if r["image_jumps"]:
            yield f"Stored edges that jump to another periodic image: {r['image_jumps']}; strands were made whole."

    def _motion(self) -> Iterator[str]:
        r = self.row
        vertex = int(r["displacement_vertex"])
        name = self._label(vertex)
        yield f"The vertex that moved most is {name}: {r['displacement_max']:.4g} Å."
        if self.config.motion == "lab":
            yield (
                "No rigid motion was taken out (--motion lab): these are the stored coordinates, each strand in the "
                "periodic image that is nearest to where it was."
            )
        else:
            shift = float(np.linalg.norm(r["translation"]))
            yield (
                f"Before that, one turn by {r['rotation_angle']:.4g} degrees and one shift of {shift:.4g} Å, the same "
                "for all strands, were taken out."
            )
        edge = r["bond_stretch_edge"]
        if (edge >= 0).all():
            place = self.results.strands.describe_edge(edge)
            yield f"The edge that is stretched most at the end is {place}: {r['bond_stretch']:.4g} of its reference."

    def _paper(self) -> Iterator[str]:
        r = self.row
        kind = CLASSES.get(PairClass(int(r["nu_class"])), "no pair")
        pair = f"{self._pair(r['nu_pair'])} ({kind})"
        yield f"ν, the least distance of disjoint pieces at the start, is {r['nu']:.4g} Å: {pair}."
        says = "not below 1, so it proves nothing here"
        if r["nu_ratio"] < 1.0:
            says = "below 1" + (", which alone proves the step" if r["rung"] == Rung.BALL else "")
        yield f"2m/ν = 2 x {r['displacement_max']:.4g} / {r['nu']:.4g} = {r['nu_ratio']:.4g}; {says}."

    def _pairs(self) -> Iterator[str]:
        r = self.row
        for kind, words in CLASSES.items():
            name = f"clearance_{kind.name.lower()}"
            value, pair = float(r[name]), r[f"{name}_pair"]
            if math.isnan(value):
                yield f"{words}: there is no such pair."
            elif (pair < 0).any():
                yield f"{words}: at least {value:.4g} Å apart; nobody looked further."
            elif value > 0.0:
                yield f"{words}: proved to stay at least {value:.4g} Å apart, {self._pair(pair)}."
            else:
                yield f"{words}: no distance is proved, {self._pair(pair)}."
        if not (r["pair_ratio_pair"] < 0).any():
            below = (
                "below 1 every pair is proved by it" if r["pair_ratio"] < 1.0 else "not below 1: this pair needs more"
            )
            yield (
                f"The sharp comparison (motion of two edges over their distances) is at most {r['pair_ratio']:.4g}, at "
                f"{self._pair(r['pair_ratio_pair'])}; {below}."
            )

    def _rung(self) -> Iterator[str]:
        rung = Rung(int(self.row["rung"]))
        yield f"The costliest rule that a pair needed is rung {int(rung)}, {RUNGS[rung]}."
        counts = [(Rung(k), int(n)) for k, n in enumerate(self.row["rung_pairs"]) if n]
        if counts:
            named = ", ".join(f"{n} {rung.name.lower().replace('_', ' ')}" for rung, n in counts)
            yield f"Pairs that the broad phase left, by the rule that settled them: {named}."

    def _crossings(self) -> Iterator[str]:
        for crossing in self.results.crossings.of_step(self.step):
            yield from self._crossing(crossing)

    def _crossing(self, crossing: Crossing) -> Iterator[str]:
        yield f"{crossing_in_words(crossing, self.spacing)}."
        s, r = (float(x) for x in crossing.parameters)
        x, y, z = (float(v) for v in crossing.point)
        time = float(self.row["time_t0"]) + crossing.t * self.spacing
        clock = f"at {time:g} ps, " if math.isfinite(time) else ""
        image = f", second edge in image {crossing.image.tolist()}" if crossing.image.any() else ""
        yield f"  {clock}{s:.3f} and {r:.3f} along the edges, at ({x:.4g}, {y:.4g}, {z:.4g}) Å{image}."

    def _cure(self) -> Iterator[str]:
        r = self.row
        reason, interval = Reason(int(r["reason"])), float(r["certifiable_interval"])
        if reason in CURES:
            yield CURES[reason]
            return
        if self.verdict is Verdict.CROSSING:
            yield from self._crossing_cure()
            return
        if not (math.isfinite(interval) and self.spacing > 0.0):
            return
        by_paper = self.spacing / r["nu_ratio"] if r["nu_ratio"] else math.inf
        yield (
            f"The frames are {self.spacing:.4g} ps apart. By the sharp comparison alone the step could be proved up to "
            f"about {interval:.4g} ps, by the paper's up to about {by_paper:.4g} ps (estimates: they let the "
            "displacement grow in proportion to the time)."
        )
        if self.verdict is Verdict.UNRESOLVED:
            yield "A contact without passing may stay one at any spacing."

    def _crossing_cure(self) -> Iterator[str]:
        found = list(self.results.crossings.of_step(self.step))
        coarse = [c.resolution / c.motion for c in found if c.grade is Grade.UNDERSAMPLED and c.motion > 0.0]
        if coarse:
            when = f"every {self.spacing * min(coarse):.3g} ps" if math.isfinite(self.spacing) else "closer together"
            yield f"Frames {when} would tell whether the undersampled crossings are passages or detours (an estimate)."
        if any(crossing.grade is Grade.RESOLVED for crossing in found):
            yield "Of a resolved crossing little is open: its edges move less than the resolution length (convention)."
        if any(crossing.grade is Grade.PROVEN for crossing in found):
            yield "Of a proven crossing nothing is open: every path between the two frames passes."

    def _alerts(self) -> Iterator[str]:
        for alert in self.results.alerts:
            if touches(alert, self.step):
                yield f"{alert.severity.name.lower()}, {alert.kind.value}: {alert.message}"

    def _pair(self, pair: Any) -> str:
        return "no pair in reach" if (pair < 0).any() else self.results.strands.describe_pair(pair)

    def _label(self, vertex: int) -> str:
        strands = self.results.strands
        return f"{strands.labels.text(vertex)} of {strands.names[strands.strand_of_vertex[vertex]]}"


def touches(alert: Alert, step: int) -> bool:
    """Return whether a step is among those of an alert; a gap belongs to no step."""
    return alert.frame_start >= 0 and alert.step_start <= step <= alert.step_end
