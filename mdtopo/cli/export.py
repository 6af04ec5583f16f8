"""``mdtopo export``: strands for other programs: all frames, those of an event, or moments within a step."""

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mdtopo.cli.exits import EXIT_HELP, Exit
from mdtopo.cli.options import VERBOSE, add_options, frame_slice
from mdtopo.errors import InputError, OutputError

if TYPE_CHECKING:
    from mdtopo.export import Snapshot
    from mdtopo.readers import Reader
    from mdtopo.records import Frame
    from mdtopo.store import Results

DESCRIPTION = """\
Write the strands of a run for other programs: whole in their periodic cell, frame by frame (--what polyline), or the
frames of the alerts that touch a step (--what event), or with --between K moments within that step along the motion
that was certified. The trajectory is read again.
"""

EXAMPLE = """\
example:
  mdtopo export run.h5 --what polyline --format vtkhdf --frames ::10 -o run.vtkhdf
  mdtopo export run.h5 --what event --step 489 --format pdb -o event.pdb
  mdtopo export run.h5 --what event --step 12 --between 9 --format pdb -o step.pdb

"""


def add_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = commands.add_parser(
        "export",
        help="write strands as VTKHDF, PDB or XYZ, frames or moments between them",
        usage="mdtopo export [options] RESULTS -o FILE [TOPOLOGY TRAJECTORY ...]",
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("results", metavar="RESULTS", type=Path, help="results file of 'mdtopo monitor'")
    parser.add_argument(
        "inputs",
        metavar="INPUT",
        nargs="*",
        type=Path,
        default=[],
        help="topology and trajectory, where they have moved",
    )
    parser.add_argument("-o", "--out", metavar="FILE", type=Path, required=True, help="file to write")
    parser.add_argument("--what", choices=("polyline", "event"), required=True, help="all frames, or those of an event")
    parser.add_argument("--format", choices=("vtkhdf", "pdb", "xyz"), required=True, help="format of the file")
    parser.add_argument(
        "--frames", metavar="START:STOP:STEP", type=_frames, help="of the analysed frames, in their order"
    )
    parser.add_argument("--step", metavar="N", type=_number, help="the step of the event, counted from 0")
    parser.add_argument("--between", metavar="K", type=_number, help="K moments within the step, and its two frames")
    parser.add_argument(
        "--allow-unproved", action="store_true", help="moments within a step that is not certified too; they are marked"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")
    add_options(parser, (VERBOSE,))
    parser.set_defaults(run=run, parser=parser)


def _number(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 0 or more")
    return int(text)


def _frames(text: str) -> slice:
    try:
        return frame_slice(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(arguments: argparse.Namespace) -> Exit:
    """Write the file."""
    _refuse_odd_words(arguments)
    from mdtopo.reopening import input_files, open_again
    from mdtopo.store import read_results

    found = read_results(arguments.results)
    job = _Job(found, arguments.step, arguments.between, arguments.frames, arguments.allow_unproved)
    frames = job.frames()
    paths, _ = input_files(arguments.results, found, arguments.inputs)
    _refuse_target(arguments, [arguments.results, *paths])
    with open_again(arguments.results, found, paths) as reader:
        count = _write(arguments.out, arguments.format, job, reader, frames)
    sys.stdout.write(f"{arguments.out}: {count} {'time' if count == 1 else 'times'}\n")
    return Exit.DONE


def _refuse_odd_words(arguments: argparse.Namespace) -> None:
    event = arguments.what == "event"
    if event != (arguments.step is not None):
        arguments.parser.error("--what event needs --step, and --what polyline takes none")
    if event and arguments.frames is not None:
        arguments.parser.error("--frames is for --what polyline; an event has its own frames")
    if arguments.between is not None and not event:
        arguments.parser.error("--between needs --what event and --step: moments lie within one step")


def _refuse_target(arguments: argparse.Namespace, taken: list[Path]) -> None:
    out: Path = arguments.out
    if out.resolve() in {path.resolve() for path in taken}:
        raise OutputError(f"{out} is a file that is read here; choose another name.")
    if out.exists() and not arguments.overwrite:
        raise OutputError(f"{out} exists already; choose another name, or pass --overwrite.")


@dataclass(frozen=True, slots=True)
class _Job:
    """What is to be exported of which results."""

    found: "Results"
    step: int | None
    between: int | None
    chosen: slice | None
    allow_unproved: bool

    def frames(self) -> list[int]:
        """Return the indices of the frames, in order; refuse what must not be exported."""
        from mdtopo.explanation import touches
        from mdtopo.records import Verdict

        steps, first = self.found.steps, self.found.first_step
        count = len(steps["frame_t0"])
        if not count:
            raise InputError("The results hold no step, so there is nothing to export.")
        every: list[int] = [*steps["frame_t0"].tolist(), int(steps["frame_t1"][-1])]
        if self.step is None:
            wanted = every[self.chosen] if self.chosen is not None else every
            if not wanted:
                raise InputError(f"The range selects none of the {len(every)} analysed frames.")
            return wanted
        if not first <= self.step < first + count:
            raise InputError(
                f"The results have no step {self.step}; they hold the steps {first} to {first + count - 1}."
            )
        row = self.step - first
        verdict = Verdict(int(steps["verdict"][row]))
        if self.between is not None:
            if verdict is not Verdict.CERTIFIED and not self.allow_unproved:
                raise InputError(
                    f"Step {self.step} is {verdict.name}: what happens between its frames is not proved to keep the "
                    "topology. Pass --allow-unproved to write it all the same; it is marked."
                )
            return every[row : row + 2]
        near = [alert for alert in self.found.alerts if touches(alert, self.step)]
        start = min([self.step, *(alert.step_start for alert in near)]) - first
        stop = max([self.step, *(alert.step_end for alert in near)]) - first
        return every[start : stop + 2]

    def content(self, frames: list[int]) -> str:
        """Return what the file holds, in words, and whether it is proved."""
        from mdtopo.records import Verdict

        if self.between is None:
            return f"Stored frames, in order: {' '.join(map(str, frames))}."
        told = f"{self.between + 2} moments of step {self.step}, frames {frames[0]} to {frames[1]}, evenly spaced"
        row = self._row(frames[0])
        if row is not None and self.found.steps["verdict"][row] == Verdict.CERTIFIED:
            return f"{told}, along the certified motion."
        return f"{told}. NOT PROVED: the step is not certified, and what lies between its frames is a guess."

    def broken(self, frame: int) -> list[int]:
        """Return the edges that are broken at a frame, by index."""
        edges = [edge.edge for edge in self.found.broken if edge.frame <= frame]
        return [k for k, edge in enumerate(map(tuple, self.found.strands.edges.tolist())) if edge in edges]

    def snapshots(self, reader: "Reader", frames: list[int]) -> "Iterator[Snapshot]":
        """Yield the strands at each time."""
        from mdtopo.export import whole_positions
        from mdtopo.reopening import frames_at

        if self.between is not None:
            pair = frames_at(reader, frames)
            yield from self._moments(next(pair), next(pair))
            return
        stream = frames_at(reader, frames)
        for index in frames:
            frame = next(stream)
            positions = whole_positions(frame, self.found.strands, self.broken(index))
            yield self._snapshot(f"frame {index}", frame.time, positions, self._row(index), True)

    def _moments(self, frame0: "Frame", frame1: "Frame") -> "Iterator[Snapshot]":
        from mdtopo.export import in_between
        from mdtopo.records import Verdict

        rigid = self.found.config["motion"] == "rigid"
        n, broken, row = self.between or 0, self.broken(frame0.index), self._row(frame0.index)
        proved = row is not None and self.found.steps["verdict"][row] == Verdict.CERTIFIED
        moments = in_between(frame0, frame1, self.found.strands, broken, n, rigid=rigid)
        for k, positions in enumerate(moments):
            t = k / (n + 1)
            time = (1.0 - t) * frame0.time + t * frame1.time
            yield self._snapshot(f"step {self.step}, t = {t:.6g}", time, positions, row, bool(proved))

    def _row(self, frame: int) -> int | None:
        rows = np.flatnonzero(self.found.steps["frame_t0"] == frame)
        return int(rows[0]) if len(rows) else None

    def _snapshot(self, title: str, time: float, positions: np.ndarray, row: int | None, proved: bool) -> "Snapshot":
        from mdtopo.export import Snapshot
        from mdtopo.records import Verdict

        steps, closest = self.found.steps, np.zeros(len(positions), dtype=np.bool_)
        clearance, verdict = np.nan, -1
        if row is not None:
            verdict = int(steps["verdict"][row])
            clearance = float(steps["clearance"][row]) if verdict == Verdict.CERTIFIED else np.nan
            pair = steps["clearance_pair"][row].ravel()
            closest[pair[pair >= 0]] = True
        return Snapshot(title, time, positions, clearance, closest, verdict, proved)


def _write(out: Path, form: str, job: _Job, reader: "Reader", frames: list[int]) -> int:
    """Write under a temporary name, then rename: nobody meets half a file."""
    from mdtopo.export import write_pdb, write_vtkhdf, write_xyz
    from mdtopo.records import Traces

    strands = job.found.strands
    traces = Traces.of(strands, job.broken(frames[0] if job.between is not None else frames[-1]))
    remarks = [
        "Strands of mdtopo, whole in their cell. Coordinates are rounded as this format does; certificates are not "
        "about the rounded ones.",
        job.content(frames),
    ]
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        snapshots = job.snapshots(reader, frames)
        if form == "vtkhdf":
            count = write_vtkhdf(temporary, strands, traces, snapshots, remarks)
        elif form == "pdb":
            count = write_pdb(temporary, strands, traces.edges, snapshots, remarks)
        else:
            count = write_xyz(temporary, strands, snapshots)
        temporary.replace(out)
    except OSError as error:
        if isinstance(error, InputError | OutputError):
            raise
        raise OutputError(f"{out} cannot be written: {error.strerror or error}.") from error
    finally:
        temporary.unlink(missing_ok=True)
    return count
