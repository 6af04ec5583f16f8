"""What ``mdtopo export`` takes from a results file and its trajectory, time by time."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mdtopo.errors import InputError

if TYPE_CHECKING:
    from mdtopo.export import CurveSnapshot, Snapshot
    from mdtopo.readers import Reader
    from mdtopo.records import Frame
    from mdtopo.smooth import CurveKind
    from mdtopo.store import Results

NEEDED = ("frame_t0", "frame_t1", "verdict", "reason", "clearance", "clearance_pair")
"""Step columns that an export needs."""

SHOWN_FRAMES = 5
"""Names of frames in one sentence."""


@dataclass(frozen=True, slots=True)
class Job:
    """What is to be exported of which results."""

    found: "Results"
    step: int | None
    between: int | None
    chosen: slice | None
    allow_unproved: bool
    has_clearance: bool = True

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
        for frame, end in self._with_ends(reader, frames):
            positions = whole_positions(frame, self.found.strands, self.broken(frame.index))
            clearance = self._clearance(frame, end)
            yield self._snapshot(f"frame {frame.index}", frame.time, positions, clearance, self._row(frame.index), True)

    def curves(
        self, reader: "Reader", frames: list[int], kind: "CurveKind", tolerance: float
    ) -> "Iterator[CurveSnapshot]":
        """Yield the polyline of the curve at each frame."""
        from mdtopo.export import curve_snapshot, whole_positions
        from mdtopo.records import Traces

        strands = self.found.strands
        for frame, end in self._with_ends(reader, frames):
            broken = self.broken(frame.index)
            yield curve_snapshot(
                whole_positions(frame, strands, broken),
                strands,
                Traces.of(strands, broken),
                kind,
                tolerance,
                title=f"frame {frame.index}",
                time=frame.time,
                polyline_clearance=self._clearance(frame, end),
            )

    def _moments(self, frame0: "Frame", frame1: "Frame") -> "Iterator[Snapshot]":
        from mdtopo.export import in_between
        from mdtopo.records import Verdict

        rigid = self.found.config["motion"] == "rigid"
        n, broken, row = self.between or 0, self.broken(frame0.index), self._row(frame0.index)
        proved = row is not None and self.found.steps["verdict"][row] == Verdict.CERTIFIED
        moments = in_between(frame0, frame1, self.found.strands, broken, n, rigid=rigid)
        clearance = self._clearance(frame0, frame1 if self._is_measured(row) else None)
        for k, positions in enumerate(moments):
            t = k / (n + 1)
            time = (1.0 - t) * frame0.time + t * frame1.time
            yield self._snapshot(f"step {self.step}, t = {t:.6g}", time, positions, clearance, row, bool(proved))

    def _row(self, frame: int) -> int | None:
        rows = np.flatnonzero(self.found.steps["frame_t0"] == frame)
        return int(rows[0]) if len(rows) else None

    def _is_measured(self, row: int | None) -> bool:
        """Return whether the clearance of a row's step is wanted, and can be told vertex by vertex."""
        from mdtopo.records import Reason

        if row is None or not self.has_clearance:
            return False
        steps = self.found.steps
        unmeasured = (Reason.BAD_DATA, Reason.CELL, Reason.IMAGE_JUMP)
        return bool(np.isfinite(steps["clearance"][row])) and int(steps["reason"][row]) not in unmeasured

    def _with_ends(self, reader: "Reader", frames: list[int]) -> "Iterator[tuple[Frame, Frame | None]]":
        """Yield each frame with the one that ends its step, None where the step's clearance is not asked for."""
        from mdtopo.reopening import frames_at

        rows = [self._row(index) for index in frames]
        ends = [int(self.found.steps["frame_t1"][row]) if self._is_measured(row) else -1 for row in rows]
        wanted = sorted({*frames, *ends} - {-1})
        stream, held = frames_at(reader, wanted), dict[int, "Frame"]()
        for index, end in zip(frames, ends, strict=True):
            while max(index, end) not in held:
                frame = next(stream)
                held[frame.index] = frame
            yield held[index], held.get(end)
            held = {number: frame for number, frame in held.items() if number > index}

    def _clearance(self, frame: "Frame", end: "Frame | None") -> np.ndarray:
        """Return what is proved of each vertex in the step between two frames, NaN where the second is not known."""
        from mdtopo.export import vertex_bounds

        strands, row = self.found.strands, self._row(frame.index)
        if end is None or row is None:
            return np.full(strands.n_vertices, np.nan)
        least, rigid = float(self.found.steps["clearance"][row]), self.found.config["motion"] == "rigid"
        return vertex_bounds(frame, end, strands, self.broken(frame.index), least, rigid=rigid)

    def _snapshot(
        self, title: str, time: float, positions: np.ndarray, clearance: np.ndarray, row: int | None, proved: bool
    ) -> "Snapshot":
        from mdtopo.export import Snapshot

        steps, closest, verdict = self.found.steps, np.zeros(len(positions), dtype=np.bool_), -1
        if row is not None:
            verdict = int(steps["verdict"][row])
            pair = steps["clearance_pair"][row].ravel()
            closest[pair[pair >= 0]] = True
        return Snapshot(title, time, positions, clearance, closest, verdict, proved)


class IsotopyTally:
    """Counts at how many times the polyline of a curve is proved to be isotopic to it."""

    def __init__(self) -> None:
        self.count = 0
        self.doubtful: list[str] = []
        self.reason = ""

    def counted(self, snapshots: "Iterator[CurveSnapshot]") -> "Iterator[CurveSnapshot]":
        """Yield them again."""
        for snapshot in snapshots:
            self.count += 1
            if not snapshot.is_isotopic:
                self.doubtful.append(snapshot.title)
                self.reason = self.reason or snapshot.reason
            yield snapshot

    def summary(self) -> str:
        """Return how many there were, in words."""
        proved = self.count - len(self.doubtful)
        if self.count == 1:
            return f"1 time, the polyline is {'proved' if proved else 'not known'} to be isotopic to the curve"
        return f"{self.count} times, the polyline is proved to be isotopic to the curve at {proved} of them"

    def doubts(self) -> str:
        """Return where it is not known, and why at the first such time, in one sentence."""
        shown = ", ".join(self.doubtful[:SHOWN_FRAMES])
        more = f" and {len(self.doubtful) - SHOWN_FRAMES} more" if len(self.doubtful) > SHOWN_FRAMES else ""
        return (
            f"it is not known whether the polyline is isotopic to the curve at {shown}{more} ({self.reason}); it may "
            "be seen with a smaller --tolerance."
        )
