"""``mdtopo verify``: a sample of the steps worked out again, slowly, by code that shares nothing with the job's."""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from mdtopo.cli.exits import Exit
from mdtopo.cli.options import VERBOSE, add_options, given_options, settled, whole_number
from mdtopo.cli.progress import ProgressDisplay
from mdtopo.cli.resultsfile import add_inputs, add_results_command

if TYPE_CHECKING:
    from mdtopo.verification import Sampling, Verification

DESCRIPTION = """\
Work out a sample of the steps of a results file again from the trajectory, and report where the two disagree. Every
pair of edges is looked at, crossings are decided in whole numbers without rounding, and ν, displacement and
clearances, those of every vertex in the profile too, are held against distances found by trying. The code is slow and
shares nothing with that of the job but the rotation that is taken out of a step. Of the smooth curve, the crossings
and clearances of the file are held against splines that SciPy makes; crossings that the file lacks are not looked
for.
"""

EXAMPLE = """\
By default all steps with a crossing and all unresolved ones are checked, the
10 nearest of the certified ones, 10 in which the curve alone passes, and one in
a hundred of the rest.

example:
  mdtopo verify run.h5
  mdtopo verify run.h5 top.pdb moved/traj.xtc --nearest 50 --share 0.1

"""

KINDS = ("crossing", "unresolved", "nearest", "curve", "random", "named")

SHOWN_DIFFERENCES = 50
"""Lines of differences that are printed; more help nobody."""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = add_results_command(
        commands,
        "verify",
        "work out a sample of steps again by independent, slow code, and compare",
        "[options] RESULTS [TOPOLOGY TRAJECTORY ...]",
        DESCRIPTION,
        EXAMPLE,
    )
    add_inputs(parser)
    group = parser.add_argument_group("sample")
    group.add_argument(
        "--nearest",
        metavar="N",
        type=whole_number,
        default=10,
        help="certified steps with the least clearance, and at most so many where the curve alone passes (default: 10)",
    )
    group.add_argument(
        "--share", metavar="X", type=_share, default=0.01, help="random share of the other ones, 0 to 1 (default: 0.01)"
    )
    group.add_argument(
        "--seed", metavar="N", type=whole_number, default=0, help="seed of the random choice (default: 0)"
    )
    group.add_argument(
        "--steps",
        metavar="LIST",
        type=_steps,
        help="check these steps and no others, such as 3,17,100-120; counted from 0",
    )
    group.add_argument(
        "--max-steps", metavar="N", type=whole_number, help="check at most this many; crossings come first"
    )
    add_options(parser, (VERBOSE,))
    parser.set_defaults(run=run, parser=parser)


def _share(text: str) -> float:
    try:
        share = float(text)
    except ValueError:
        share = -1.0
    if not 0.0 <= share <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to 1")
    return share


def _steps(text: str) -> tuple[int, ...]:
    """Return the steps of a list such as 3,17,100-120, both ends of a range included."""
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.strip().isdecimal() or (dash and not last.strip().isdecimal()):
            raise argparse.ArgumentTypeError(f"{text!r} is not a list of steps, such as 3,17,100-120")
        found += range(int(first), int(last if dash else first) + 1)
    return tuple(found)


def run(arguments: argparse.Namespace) -> Exit:
    """Check the sample, and print what came of it."""
    from mdtopo.cli.monitor import logging_to_stderr
    from mdtopo.pipeline import Progress
    from mdtopo.verification import Sampling, verify

    sampling = Sampling(
        nearest=arguments.nearest,
        share=arguments.share,
        seed=arguments.seed,
        steps=arguments.steps,
        most=arguments.max_steps,
    )
    verbose = settled((VERBOSE,), given_options(arguments, (VERBOSE,)))
    with ProgressDisplay() as display, logging_to_stderr({**verbose, "quiet": True}, display):

        def show(done: int, total: int, differ: int) -> None:
            """Show how far the check is."""
            display.show(Progress(done, total, differ, "difference"))

        found = verify(arguments.results, arguments.inputs, sampling, show)
    sys.stdout.write("\n".join(_lines(arguments.results, found, sampling)) + "\n")
    return Exit.DONE if found.agrees else Exit.DIFFERS


def _lines(results: Path, found: "Verification", sampling: "Sampling") -> Iterator[str]:
    yield _headline(found)
    yield ""
    yield f"  {results}: {found.n_steps} steps"
    yield f"  {'checked':<12}{'steps':>8}{'agree':>8}{'differ':>8}"
    for kind in KINDS:
        checks = [check for check in found.checks if check.kind == kind]
        if checks or (kind not in ("named", "curve") and sampling.steps is None):
            yield _row(kind, len(checks), sum(bool(check.differences) for check in checks))
    yield _row("all", len(found.checks), sum(bool(check.differences) for check in found.checks))
    sentences = [f"the file: {text}" for text in found.differences]
    sentences += [f"step {check.step}: {text}" for check in found.checks for text in check.differences]
    if sentences:
        yield ""
        yield from (f"  {text}" for text in sentences[:SHOWN_DIFFERENCES])
    if len(sentences) > SHOWN_DIFFERENCES:
        yield f"  and {len(sentences) - SHOWN_DIFFERENCES} more differences"
    notes = [f"{check.kind} step {check.step}: {check.note}" for check in found.checks if check.note]
    notes = notes[:SHOWN_DIFFERENCES] + ([f"and so on, {len(notes)} steps"] if len(notes) > SHOWN_DIFFERENCES else [])
    notes += [*found.notes, *([f"{found.left_out} more were left out (--max-steps)"] if found.left_out else [])]
    if notes:
        yield ""
        yield from (f"  note: {text}" for text in notes)


def _headline(found: "Verification") -> str:
    wrong = sum(bool(check.differences) for check in found.checks)
    if wrong:
        return f"DIFFERS: {wrong} of the {len(found.checks)} steps that were checked."
    if found.differences:
        return "DIFFERS: the results file contradicts itself."
    if not found.checks:
        return "AGREES: but no step was checked."
    if len(found.checks) == 1:
        return "AGREES: the one step that was checked."
    return f"AGREES: all of the {len(found.checks)} steps that were checked."


def _row(kind: str, steps: int, differ: int) -> str:
    return f"  {kind:<12}{steps:>8}{steps - differ:>8}{differ:>8}"
