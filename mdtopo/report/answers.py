"""Five questions about a run, each with its answer in a sentence or two."""

from mdtopo.records import Grade, Severity
from mdtopo.report.cards import pair_in_words
from mdtopo.report.events import Event
from mdtopo.report.interval import IntervalAdvice, percent
from mdtopo.report.rundata import RunData


def unread_frames(run: RunData) -> str:
    """Return which frames of the trajectory the counts do not cover, in words; empty where the run came to its end."""
    if run.results.complete and not run.in_progress:
        return ""
    frames = f"the frames after frame {int(run.columns['frame_t1'][-1])}" if run.n_steps else "the frames of the file"
    if run.in_progress:
        return f"{frames} are not measured yet"
    return f"{frames} {'could not be read' if run.summary.stopped else 'were not read'}"


def answers(run: RunData, events: list[Event], advice: IntervalAdvice | None) -> list[tuple[str, str, str]]:
    """Return for each question of the page the answer, and the section that says more."""
    return [
        ("Did anything pass?", _passed(run), "alerts"),
        ("How close was it?", _closeness(run), "time"),
        ("Where should I look?", _worst(run, events), "alerts"),
        ("Is the save interval good enough?", _interval_words(run, advice), "interval"),
        ("What was not checked?", _unchecked(run), "unchecked"),
    ]


def _passed(run: RunData) -> str:
    summary, counts = run.summary, run.summary.counts
    if not counts.steps:
        return "Unknown: a step needs two frames."
    found = [f"{n} {grade.name.lower()}" for grade, n in sorted(summary.crossings.items(), reverse=True) if n]
    unread = unread_frames(run)
    rest = f" {unread[0].upper()}{unread[1:]}, so nothing is known of them." if unread else ""
    broke = (
        f" {summary.n_fractures} edge{'s' if summary.n_fractures != 1 else ''} broke." if summary.n_fractures else ""
    )
    if found:
        only = not (summary.crossings[Grade.PROVEN] or summary.crossings[Grade.RESOLVED])
        word = "Perhaps" if only else "Yes"
        return f"{word}: crossings of straight paths in {counts.crossed} steps ({', '.join(found)}).{broke}{rest}"
    if counts.unresolved:
        return f"Not that we know, but {counts.unresolved} of {counts.steps} steps are undecided.{broke}{rest}"
    if unread:
        return (
            f"Not in the part that was read: proved in its {counts.steps} steps, for straight paths between the "
            f"frames.{broke}{rest}"
        )
    return f"No: proved in all {counts.steps} steps, for straight paths between the frames.{broke}"


def _closeness(run: RunData) -> str:
    summary = run.summary
    if summary.clearance_step < 0:
        return "Not known: no step was proved."
    row = run.row(summary.clearance_step)
    pair = pair_in_words(run, run.columns["clearance_pair"][row])
    between = f" between {pair}" if pair else ""
    if summary.clearance == 0.0:
        return f"Proved never to meet, but too close to say how far apart (step {summary.clearance_step}{between})."
    return f"In proved steps at least {summary.clearance:.4g} Å apart (step {summary.clearance_step}{between})."


def _worst(run: RunData, events: list[Event]) -> str:
    unread = unread_frames(run)
    shown = next((event for event in events if event.alert.severity is not Severity.INFO), None)
    if shown is None and unread:
        return f"At the trajectory: {unread}. In what was read there is no warning."
    if shown is None:
        return "Nowhere in particular: there is no warning."
    alert = shown.alert
    place = f"{shown.name.capitalize()} in {_frames(shown)}, {', '.join(alert.residues) or 'no residue named'}."
    return f"{place} Also at the trajectory: {unread}." if unread else place


def _frames(event: Event) -> str:
    """Return the frames of an alert in words, from its first step to its last."""
    if event.frames is None:
        return "the input"
    worst = f" (worst in {event.frames[0]}–{event.frames[1]})" if event.frames != event.span else ""
    return f"frames {event.span[0]}–{event.span[1]}{worst}"


def _interval_words(run: RunData, advice: IntervalAdvice | None) -> str:
    if advice is None:
        return "Unknown: the trajectory holds no times."
    return (
        f"At {advice.spacing:.3g} ps, {percent(advice.now_by_ball)} of the steps are within the paper's bound, "
        f"{percent(advice.now_by_pairs)} within the bound of pairs."
    )


def _unchecked(run: RunData) -> str:
    unread = unread_frames(run)
    words = [f"{unread[0].upper()}{unread[1:]}"] if unread else []
    words += [f"{'w' if words else 'W'}hat happened between the frames off the straight paths"]
    words += [f"{len(run.results.strands.gaps)} gaps in strands"] if run.results.strands.gaps else []
    words += [f"{run.summary.counts.unresolved} undecided steps"] if run.summary.counts.unresolved else []
    if run.summary.curve is not None and run.summary.curve.unresolved:
        n = run.summary.curve.unresolved
        words.append(f"{n} step{'' if n == 1 else 's'} of the smooth curve undecided")
    return f"{'; '.join(words)}."
