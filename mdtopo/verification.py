"""Results against the referee: a sample of steps is worked out again from the trajectory, by slow code of its own."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdtopo.curvechecks import curve_differences
from mdtopo.errors import InputError
from mdtopo.profilechecks import profile_differences, profile_file_differences
from mdtopo.readers import Reader
from mdtopo.records import Crossing, Crossings, Frame, MonitorConfig, Rung, Verdict
from mdtopo.referee import FoundContact, FoundCrossing, StepCase, open_step
from mdtopo.reopening import frames_at, input_files, open_again
from mdtopo.store import Results, read_so_far
from mdtopo.typing import Flags, Indices, Lengths

SAME_NUMBER = 1e-9
"""Relative difference up to which ν and displacement agree: sums of a million terms, and near-parallel edges."""

ROUNDING = 1e-12
"""And this multiple of the greatest coordinate, which is 4500 units in the last place."""

SAME_TIME = 1e-7
"""Difference of the time of a crossing. A rotated coordinate is off by 1e-15, a time near a double root by its root."""

SAME_PARAMETER = 1e-6
"""Difference of the place of a crossing on its edges."""

SAME_ANGLE = 1e-5
"""Degrees."""

CLASSES = ("clearance_local", "clearance_self", "clearance_inter")


@dataclass(frozen=True, slots=True)
class Sampling:
    """Which steps are checked.

    Attributes
    ----------
    nearest : int
        That many of the certified steps, those with the least clearance; and at most so many, at random, of those in
        which the smooth curve alone passes.
    share : float
        That share of the other certified steps, at random; from 0 to 1.
    seed : int
        Of the random choice.
    steps : tuple of int or None
        These steps and no others. By default all with a crossing, all that are unresolved, and the two samples.
    most : int or None
        At most this many steps, in the order crossing, nearest, unresolved, curve, random.
    """

    nearest: int = 10
    share: float = 0.01
    seed: int = 0
    steps: tuple[int, ...] | None = None
    most: int | None = None


@dataclass(frozen=True, slots=True)
class StepCheck:
    """What the referee says of one step.

    Attributes
    ----------
    step : int
    kind : str
        Why it was chosen: ``crossing``, ``unresolved``, ``nearest``, ``curve``, ``random`` or ``named``.
    verdict : Verdict
        In the results.
    differences : tuple of str
        One sentence for each; empty where all agrees.
    note : str
        What the referee finds in a step that the results leave open, or that hangs on rounding; else empty.
    """

    step: int
    kind: str
    verdict: Verdict
    differences: tuple[str, ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Verification:
    """What the referee says of a results file.

    Attributes
    ----------
    n_steps : int
        Steps in the file.
    checks : tuple of StepCheck
        In step order.
    left_out : int
        Steps that were chosen, but are beyond `Sampling.most`.
    differences : tuple of str
        Where the file contradicts itself.
    notes : tuple of str
        What a reader should know.
    """

    n_steps: int
    checks: tuple[StepCheck, ...]
    left_out: int
    differences: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether nothing differs."""
        return not self.differences and not any(check.differences for check in self.checks)


def verify(
    results: Path,
    inputs: Sequence[Path] = (),
    sampling: Sampling | None = None,
    on_check: Callable[[int, int, int], None] | None = None,
) -> Verification:
    """Return what the referee says of a sample of the steps of a results file.

    Parameters
    ----------
    results : Path
        The file; of a run that has not ended, its finished parts are looked at, and a note says so.
    inputs : sequence of Path
        Topology and trajectory, where they have moved; by default the stored paths.
    sampling : Sampling, optional
    on_check : callable, optional
        Called after each step with the number of steps checked, of all that will be, and of those that differ.

    Raises
    ------
    InputError
        If a file is missing, or the input has changed since.

    Guarantee
    ---------
    Exact where it speaks of crossings: they are decided in integers. Distances are sampled, so a clearance that is too
    large can be shown by it, and never be proved right. The curve is not decided again: see `curve_differences`.
    """
    sampling = sampling or Sampling()
    found = read_so_far(results)
    paths, notes = input_files(results, found, inputs)
    if found.in_progress:
        notes.append("in progress: the run has not ended, and only its finished parts were looked at")
    chosen, left_out = chosen_steps(results, found, sampling)
    with open_again(results, found, paths) as reader:
        checks: list[StepCheck] = []
        differ = 0
        for check in _checks(found, reader, chosen):
            checks.append(check)
            differ += bool(check.differences)
            if on_check is not None:
                on_check(len(checks), len(chosen), differ)
    return Verification(
        len(found.steps["verdict"]), tuple(checks), left_out, tuple(file_differences(found)), tuple(notes)
    )


def chosen_steps(results: Path, found: Results, sampling: Sampling) -> tuple[dict[int, str], int]:
    """Return the steps to check with the reason for each, in step order, and how many were left out.

    Raises
    ------
    InputError
        If a named step is not in the file.
    """
    verdict, first = found.steps["verdict"], found.first_step
    if sampling.steps is not None:
        for step in sampling.steps:
            if not first <= step < first + len(verdict):
                raise InputError(f"{results} has no step {step}; it holds {len(verdict)} steps from {first} on.")
        return dict.fromkeys(sorted(set(sampling.steps)), "named"), 0
    crossed = (verdict == Verdict.CROSSING) | (found.steps["n_crossings"] > 0)
    crossed[np.unique(found.crossings.step) - first] = True
    curve = np.zeros(len(verdict), dtype=np.bool_)
    curve[_of_curve(found, crossed, sampling)] = True
    certified = np.flatnonzero((verdict == Verdict.CERTIFIED) & ~crossed & ~curve)
    order = certified[np.argsort(found.steps["clearance"][certified], kind="stable")]
    near, rest = order[: sampling.nearest], np.sort(order[sampling.nearest :])
    count = int(np.ceil(sampling.share * len(rest)))
    kinds = {
        "crossing": np.flatnonzero(crossed),
        "nearest": near,
        "unresolved": np.flatnonzero((verdict != Verdict.CERTIFIED) & ~crossed & ~curve),
        "curve": np.flatnonzero(curve),
        "random": np.random.default_rng(sampling.seed).choice(rest, count, replace=False),
    }
    every = [(first + int(row), kind) for kind, rows in kinds.items() for row in rows]
    kept = every if sampling.most is None else every[: sampling.most]
    return dict(sorted(kept)), len(every) - len(kept)


def _of_curve(found: Results, crossed: Flags, sampling: Sampling) -> Indices:
    """Return the rows of some steps, at random, in which the curve passes and the polyline does not."""
    rows = np.unique(found.curve_crossings.step) - found.first_step
    rows = rows[~crossed[rows]]
    generator = np.random.default_rng(sampling.seed)
    return generator.choice(rows, min(sampling.nearest, len(rows)), replace=False)


def file_differences(found: Results) -> Iterator[str]:
    """Yield where a results file contradicts itself."""
    steps = found.steps
    yield from _uncounted(found, found.crossings, "n_crossings", "crossings")
    if "curve_n_crossings" in steps:
        yield from _uncounted(found, found.curve_crossings, "curve_n_crossings", "crossings of the curve")
    yield from profile_file_differences(found)
    counts = found.summary.get("counts")
    if not counts:  # a run that did not come to its end has none
        return
    proved = counts["ball"] + counts["pairs"] + counts["near_limit"]
    for number, verdict in ((proved, 1), (counts["unresolved"], 0), (counts["crossed"], 2)):
        rows = int((steps["verdict"] == verdict).sum())
        if number != rows:
            yield f"the summary counts {number} steps that are {Verdict(verdict).name}, and the steps are {rows}"


def _uncounted(found: Results, crossings: Crossings, column: str, what: str) -> Iterator[str]:
    """Yield the steps whose number of crossings is not that of the list."""
    said = found.steps[column]
    counted = np.bincount(crossings.step - found.first_step, minlength=len(said))
    for row in np.flatnonzero(counted != said):
        listed = f"{counted[row]} {'is' if counted[row] == 1 else 'are'} listed"
        yield f"step {found.first_step + row} is said to have {said[row]} {what}, and {listed}"


def _checks(found: Results, reader: Reader, chosen: dict[int, str]) -> Iterator[StepCheck]:
    rows = [step - found.first_step for step in chosen]
    frames = found.steps["frame_t0"][rows], found.steps["frame_t1"][rows]
    # whether a run is periodic is decided by its trajectory's first frame
    stream = frames_at(reader, sorted({0, *np.concatenate(frames).tolist()}))
    held = {0: (first := next(stream))}
    for (step, kind), t0, t1 in zip(chosen.items(), *(column.tolist() for column in frames), strict=True):
        held = {index: frame for index, frame in held.items() if index >= t0}
        while t1 not in held:
            frame = next(stream)
            held[frame.index] = frame
        yield check_step(found, step, kind, held[t0], held[t1], periodic=first.cell is not None)


def check_step(found: Results, step: int, kind: str, frame0: Frame, frame1: Frame, *, periodic: bool) -> StepCheck:
    """Return how one step of the results compares with what the referee finds between its two frames."""
    row = step - found.first_step
    verdict = Verdict(int(found.steps["verdict"][row]))
    # an edge that the step's first frame showed to be broken is no edge of the step
    broken = [edge.edge for edge in found.broken if edge.frame <= frame0.index]
    rigid = MonitorConfig.from_mapping(found.config).motion == "rigid"
    case = open_step(frame0, frame1, found.strands, broken, rigid=rigid, periodic=periodic)
    if isinstance(case, str):
        wrong = (f"it is {verdict.name}, but {case}",) if verdict is not Verdict.UNRESOLVED else ()
        return StepCheck(step, kind, verdict, wrong, "" if wrong else case)
    meetings = case.meetings
    if meetings is None:
        wrong = (f"it is {verdict.name}, but its images cannot be counted",) if verdict.value else ()
        return StepCheck(step, kind, verdict, wrong, "" if wrong else "images cannot be counted")
    crossings, contacts = meetings
    note = _open_note(crossings, contacts) if verdict is Verdict.UNRESOLVED else ""
    if verdict is Verdict.CERTIFIED and (crossings or contacts) and rigid and _is_rounding(found, row, case):
        note = (
            f"{_open_note(crossings, contacts)}, but its clearance is no more than the rounding of turned coordinates"
        )
        crossings, contacts = (), ()
    differences = [
        *_verdict_differences(found, step, verdict, crossings, contacts),
        *_number_differences(found, row, verdict, case, bool(crossings)),
        *curve_differences(found, step, case),
        *profile_differences(found, step, case),
    ]
    return StepCheck(step, kind, verdict, tuple(differences), note)


def _is_rounding(found: Results, row: int, case: StepCase) -> bool:
    """Return whether a clearance is so small that turning the coordinates in another order may undo it."""
    return bool(0.0 < found.steps["clearance"][row] <= ROUNDING * case.scale)


def _verdict_differences(
    found: Results,
    step: int,
    verdict: Verdict,
    crossings: Sequence[FoundCrossing],
    contacts: Sequence[FoundContact],
) -> Iterator[str]:
    stored = list(found.crossings.of_step(step))
    if verdict is Verdict.CROSSING and not stored:
        yield "it is CROSSING, but the file lists no crossing of it"
    if verdict is Verdict.CERTIFIED and stored:
        yield f"it is CERTIFIED, but the file lists a crossing of it: {_stored_words(found, stored[0])}"
    left = list(crossings)
    for crossing in stored:
        match = next((other for other in left if _is_same(crossing, other)), None)
        if match is None:
            yield f"the referee does not find this crossing of the file: {_stored_words(found, crossing)}"
        else:
            left.remove(match)
    if verdict is Verdict.UNRESOLVED:
        return
    for other in left:
        words = _found_words(found, other)
        yield f"it is {verdict.name}, but the referee finds a crossing that is not in the file: {words}"
    if verdict is Verdict.CERTIFIED:
        for contact in contacts:
            one, two = (found.strands.describe_edge(edge) for edge in contact.edges)
            yield f"it is CERTIFIED, but {one} and {two} meet at t = {contact.t:.9g} ({contact.kind})"


def _is_same(stored: Crossing, other: FoundCrossing) -> bool:
    return (
        stored.edges.tolist() == [list(edge) for edge in other.edges]
        and stored.image.tolist() == list(other.image)
        and stored.sign == other.sign
        and abs(stored.t - other.t) <= SAME_TIME
        and bool((np.abs(stored.parameters - other.parameters) <= SAME_PARAMETER).all())
    )


def _stored_words(found: Results, crossing: Crossing) -> str:
    one, two = crossing.edges.tolist()
    image = (int(crossing.image[0]), int(crossing.image[1]), int(crossing.image[2]))
    s, r = crossing.parameters.tolist()
    return _found_words(found, FoundCrossing(crossing.t, (tuple(one), tuple(two)), (s, r), crossing.sign, image))


def _found_words(found: Results, crossing: FoundCrossing) -> str:
    one, two = (found.strands.describe_edge(edge) for edge in crossing.edges)
    image = " ".join(map(str, crossing.image))
    s, r = crossing.parameters
    place = f"{s:.7g} and {r:.7g} along, sign {crossing.sign:+d}, image {image}"
    return f"{one} through {two} at t = {crossing.t:.9g} ({place})"


def _number_differences(found: Results, row: int, verdict: Verdict, case: StepCase, crosses: bool) -> Iterator[str]:
    steps = found.steps
    rounding = ROUNDING * case.scale
    separation = case.separation
    angle = float(steps["rotation_angle"][row])
    if not np.isnan(angle) and not abs(angle - case.angle) <= SAME_ANGLE:
        yield f"rotation_angle is {angle:.9g} degrees in the file, and {case.angle:.9g} by the referee"
    for name, ours in (("displacement_max", case.displacement), ("nu", separation)):
        theirs = float(steps[name][row])
        if ours is None or (verdict is Verdict.UNRESOLVED and np.isnan(theirs)):
            continue
        same = theirs == ours or abs(theirs - ours) <= SAME_NUMBER * abs(ours) + rounding
        if not same:
            yield f"{name} is {theirs:.12g} Å in the file, and {ours:.12g} Å by the referee"
    yield from _clearance_differences(found, row, verdict, case, crosses, rounding)


def _clearance_differences(
    found: Results, row: int, verdict: Verdict, case: StepCase, crosses: bool, rounding: float
) -> Iterator[str]:
    steps = found.steps
    least = float(steps["clearance"][row])
    exact = int(steps["rung"][row]) == Rung.EXACT  # shown never to meet, by which distance is not known
    if verdict is Verdict.CERTIFIED and (least < 0.0 or (least == 0.0 and not exact)):
        yield f"it is CERTIFIED with a clearance of {least:.9g} Å, which proves nothing"
    if crosses and least > 0.0:
        yield f"clearance is {least:.9g} Å, but edges pass through each other"
    claimed: Lengths = np.array([float(steps[name][row]) for name in CLASSES])
    near = case.least_distances(np.fmax(claimed, least) + rounding)
    if near is None:
        return
    for name, claim, distance in zip((*CLASSES, "clearance"), [*claimed, least], [*near, near.min()], strict=True):
        if claim > distance + SAME_NUMBER * distance + rounding:
            yield f"{name} is {claim:.9g} Å in the file, but such a pair comes within {distance:.9g} Å"


def _open_note(crossings: Sequence[FoundCrossing], contacts: Sequence[FoundContact]) -> str:
    """Return in words what the referee finds in a step that the results leave open."""
    if not crossings and not contacts:
        return "the referee finds no crossing and no contact"
    found = [f"{len(crossings)} {'crossing' if len(crossings) == 1 else 'crossings'}"] if crossings else []
    kinds = ", ".join(sorted({contact.kind for contact in contacts}))
    found += [f"{len(contacts)} {'contact' if len(contacts) == 1 else 'contacts'} ({kinds})"] if contacts else []
    return f"the referee finds {' and '.join(found)}"
