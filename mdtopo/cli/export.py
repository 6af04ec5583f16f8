"""``mdtopo export``: strands or their curves for other programs: all frames, those of an event, or within a step."""

import argparse
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from mdtopo.cli.exits import Exit, say
from mdtopo.cli.exportjob import NEEDED, IsotopyTally, Job
from mdtopo.cli.options import VERBOSE, add_options, frame_slice, whole_number
from mdtopo.cli.resultsfile import add_inputs, add_results_command, say_if_unfinished
from mdtopo.errors import InputError, OutputError

if TYPE_CHECKING:
    from mdtopo.readers import Reader
    from mdtopo.smooth import CurveKind

DESCRIPTION = """\
Write the strands of a run for other programs: whole in their periodic cell, frame by frame (--what polyline), or the
frames of the alerts that touch a step (--what event), or with --between K moments within that step along the motion
that was certified. --what curve writes the smooth curve as a polyline that stays within --tolerance of it, and says at
which frames this is proved to be isotopic to the curve. The trajectory is read again.
"""

FORMATS = ("vtkhdf", "pdb", "xyz")

EXTENSIONS = {".vtkhdf": "vtkhdf", ".hdf": "vtkhdf", ".pdb": "pdb", ".ent": "pdb", ".xyz": "xyz"}
"""Which format the extension of a file means."""

CURVES = ("interpolating", "bspline", "catmull-rom", "bezier", "bezier-through")

TOLERANCE = 0.1
"""Å: less than a hair's breadth in a picture of a protein."""

ROUNDED = "Coordinates are rounded as this format does; certificates are not about the rounded ones."

EXAMPLE = """\
example:
  mdtopo export run.h5 --what polyline --format vtkhdf --frames ::10 -o run.vtkhdf
  mdtopo export run.h5 --what curve --tolerance 0.05 --format vtkhdf -o curve.vtkhdf
  mdtopo export run.h5 --what event --step 489 --format pdb -o event.pdb
  mdtopo export run.h5 --what event --step 12 --between 9 --format pdb -o step.pdb

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = add_results_command(
        commands,
        "export",
        "write strands, or their smooth curves, as VTKHDF, PDB or XYZ",
        "[options] RESULTS -o FILE [TOPOLOGY TRAJECTORY ...]",
        DESCRIPTION,
        EXAMPLE,
    )
    add_inputs(parser)
    parser.add_argument("-o", "--out", metavar="FILE", type=Path, required=True, help="file to write")
    parser.add_argument(
        "--what",
        choices=("polyline", "curve", "event"),
        help="strands or their smooth curve in all frames, or an event (default: polyline, or event with --step)",
    )
    parser.add_argument(
        "--format", choices=FORMATS, help="format of the file (default: what the extension of --out says)"
    )
    parser.add_argument(
        "--frames", metavar="START:STOP:STEP", type=_frames, help="of the analysed frames, in their order"
    )
    parser.add_argument("--step", metavar="N", type=whole_number, help="the step of the event, counted from 0")
    parser.add_argument(
        "--between", metavar="K", type=whole_number, help="K moments within the step, and its two frames"
    )
    parser.add_argument(
        "--allow-unproved", action="store_true", help="moments within a step that is not certified too; they are marked"
    )
    parser.add_argument(
        "--curve", metavar="KIND", choices=CURVES, help=f"which curve: {', '.join(CURVES)} (default: {CURVES[0]})"
    )
    parser.add_argument(
        "--tolerance",
        metavar="LENGTH",
        type=_length,
        help=f"how far the curve may be from its polyline, Å (default: {TOLERANCE:g})",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")
    add_options(parser, (VERBOSE,))
    parser.set_defaults(run=run, parser=parser)


def _length(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a length greater than 0, in Å")
    return value


def _frames(text: str) -> slice:
    try:
        return frame_slice(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(arguments: argparse.Namespace) -> Exit:
    """Write the file."""
    _settle_what(arguments)
    _settle_format(arguments)
    _refuse_odd_words(arguments)
    from mdtopo.reopening import input_files, open_again
    from mdtopo.store import read_so_far

    found = read_so_far(arguments.results, columns=NEEDED)
    say_if_unfinished(arguments.results, found)
    has_clearance = arguments.format == "vtkhdf"  # no other format holds it
    job = Job(found, arguments.step, arguments.between, arguments.frames, arguments.allow_unproved, has_clearance)
    frames = job.frames()
    paths, _ = input_files(arguments.results, found, arguments.inputs)
    _refuse_target(arguments, [arguments.results, *paths])
    with open_again(arguments.results, found, paths) as reader:
        told = _write(arguments, job, reader, frames)
    sys.stdout.write(f"{arguments.out}: {told}\n")
    return Exit.DONE


def _settle_what(arguments: argparse.Namespace) -> None:
    if arguments.what is None:
        arguments.what = "polyline" if arguments.step is None else "event"


def _settle_format(arguments: argparse.Namespace) -> None:
    """Take the format from the extension where none is given, and refuse one that the extension contradicts."""
    meant = EXTENSIONS.get(arguments.out.suffix.lower())
    if arguments.format is None and meant is None:
        arguments.parser.error(
            f"the extension of {arguments.out} names no format; give --format with one of: {', '.join(FORMATS)}"
        )
    if arguments.format is None:
        arguments.format = meant
    elif meant not in (None, arguments.format):
        arguments.parser.error(
            f"--format {arguments.format} contradicts {arguments.out}, whose extension means {meant}; leave out "
            "--format, or choose another name"
        )


def _refuse_odd_words(arguments: argparse.Namespace) -> None:
    event = arguments.what == "event"
    if event != (arguments.step is not None):
        arguments.parser.error("--what event needs --step, and the others take none")
    if event and arguments.frames is not None:
        arguments.parser.error("--frames is for --what polyline and curve; an event has its own frames")
    if arguments.what != "curve" and (arguments.curve or arguments.tolerance):
        arguments.parser.error("--curve and --tolerance are for --what curve")
    if arguments.between is not None and not event:
        arguments.parser.error("--between needs --what event and --step: moments lie within one step")


def _refuse_target(arguments: argparse.Namespace, taken: list[Path]) -> None:
    out: Path = arguments.out
    if out.resolve() in {path.resolve() for path in taken}:
        raise OutputError(f"{out} is a file that is read here; choose another name.")
    if not out.parent.is_dir():
        raise OutputError(f"{out} cannot be written: there is no directory {out.parent}.")
    if out.exists() and not arguments.overwrite:
        raise OutputError(f"{out} exists already; choose another name, or pass --overwrite.")


def _write(arguments: argparse.Namespace, job: Job, reader: "Reader", frames: list[int]) -> str:
    """Write under a temporary name, then rename: nobody meets half a file. Return what was written, in words."""
    out: Path = arguments.out
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        if arguments.what == "curve":
            told = _write_curve(temporary, arguments, job, reader, frames)
        else:
            count = _write_strands(temporary, arguments.format, job, reader, frames)
            told = f"{count} {'time' if count == 1 else 'times'}"
        temporary.replace(out)
    except OSError as error:
        if isinstance(error, InputError | OutputError):
            raise
        raise OutputError(f"{out} cannot be written: {error.strerror or error}.") from error
    finally:
        temporary.unlink(missing_ok=True)
    return told


def _write_strands(path: Path, form: str, job: Job, reader: "Reader", frames: list[int]) -> int:
    from mdtopo.export import write_pdb, write_vtkhdf, write_xyz
    from mdtopo.records import Traces

    strands = job.found.strands
    traces = Traces.of(strands, job.broken(frames[0] if job.between is not None else frames[-1]))
    remarks = [f"Strands of mdtopo, whole in their cell. {ROUNDED}", job.content(frames)]
    snapshots = job.snapshots(reader, frames)
    if form == "vtkhdf":
        return write_vtkhdf(path, strands, traces, snapshots, remarks)
    if form == "pdb":
        return write_pdb(path, strands, traces.edges, snapshots, remarks)
    return write_xyz(path, strands, snapshots)


def _write_curve(path: Path, arguments: argparse.Namespace, job: Job, reader: "Reader", frames: list[int]) -> str:
    from mdtopo.export import write_curve_pdb, write_curve_vtkhdf, write_curve_xyz

    form, tolerance = arguments.format, arguments.tolerance or TOLERANCE
    kind: CurveKind = arguments.curve or "interpolating"
    if form == "pdb" and len(frames) > 1:
        raise InputError(
            f"A PDB file cannot hold the curve of {len(frames)} frames: its models share their atoms, and the curve's "
            "polyline has other points in each frame. Choose one frame with --frames, or --format vtkhdf or xyz."
        )
    remarks = [
        f"Polylines on the {kind} curve of the strands, at most {tolerance:g} Å from it; strands whole in their cell, "
        f"images in other cells not looked at. {ROUNDED}",
        job.content(frames),
    ]
    tally = IsotopyTally()
    snapshots = tally.counted(job.curves(reader, frames, kind, tolerance))
    if form == "vtkhdf":
        write_curve_vtkhdf(path, snapshots, remarks)
    elif form == "xyz":
        write_curve_xyz(path, snapshots)
    else:
        write_curve_pdb(path, next(snapshots), remarks)
    if tally.doubtful:
        say(tally.doubts())
    return tally.summary()
