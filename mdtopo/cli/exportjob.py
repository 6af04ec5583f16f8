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

NEEDED = ("frame_t0", "frame_t1", "verdict", "clearance", "clearance_pair")
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

    def curves(
        self, reader: "Reader", frames: list[int], kind: "CurveKind", tolerance: float
    ) -> "Iterator[CurveSnapshot]":
        """Yield the polyline of the curve at each frame."""
        from mdtopo.export import curve_snapshot, whole_positions
        from mdtopo.records import Traces
        from mdtopo.reopening import frames_at

        stream, strands = frames_at(reader, frames), self.found.strands
        for index in frames:
            frame, broken = next(stream), self.broken(index)
            yield curve_snapshot(
                whole_positions(frame, strands, broken),
                strands,
                Traces.of(strands, broken),
                kind,
                tolerance,
                title=f"frame {index}",
                time=frame.time,
                polyline_clearance=self._clearance(self._row(index)),
            )

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

    def _clearance(self, row: int | None) -> float:
        """Return what is proved of the step of a row, NaN where nothing is."""
        from mdtopo.records import Verdict

        steps = self.found.steps
        if row is None or steps["verdict"][row] != Verdict.CERTIFIED:
            return float(np.nan)
        return float(steps["clearance"][row])

    def _snapshot(self, title: str, time: float, positions: np.ndarray, row: int | None, proved: bool) -> "Snapshot":
        from mdtopo.export import Snapshot

        steps, closest, verdict = self.found.steps, np.zeros(len(positions), dtype=np.bool_), -1
        if row is not None:
            verdict = int(steps["verdict"][row])
            pair = steps["clearance_pair"][row].ravel()
            closest[pair[pair >= 0]] = True
        return Snapshot(title, time, positions, self._clearance(row), closest, verdict, proved)


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
