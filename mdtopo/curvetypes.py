"""Whether the drawn curve of an alert's strands has their own type, in both frames of the alert's worst step.

Alerts are said as they happen, and shards are merged without their trajectory. So this is worked out where somebody
asks for it with the trajectory at hand: for the events that a report shows, and by ``mdtopo alerts --curve-type``.
"""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

import numpy as np

from mdtopo.curves import StepMotion
from mdtopo.errors import InputError, MdtopoError
from mdtopo.records import Alert, AlertKind, Frame, Isotopy, MonitorConfig, Strands, Traces
from mdtopo.reopening import frames_at, input_files, open_again
from mdtopo.report import step_path
from mdtopo.sametype import SameType, same_type
from mdtopo.smooth import CurveKind
from mdtopo.store import Results
from mdtopo.typing import Indices, Points

MOST_VERTICES = 600
"""Vertices of the strands of one alert: the search for their tube takes a second for some hundreds."""

Types = tuple[SameType, SameType]


def step_types(motion: StepMotion, traces: Traces, strands: Strands, names: Collection[str], kind: CurveKind) -> Types:
    """Return whether the curve of some strands has their type at the start and at the end of a step.

    Parameters
    ----------
    motion, traces
        As `mdtopo.report.step_path` returns them; broken edges are no edges.
    strands : Strands
    names : collection of str
        Which strands.
    kind : str
        The curve.

    Guarantee
    ---------
    Proven, where it is not `NOT_KNOWN`: see `same_type`. It is said of these strands alone, as they lie when they are
    made whole; other strands, and images in other cells, are not looked at.
    """
    pieces, closed = [], []
    for piece, ring in zip(np.split(traces.vertices, traces.offsets[1:-1]), traces.closed.tolist(), strict=True):
        if len(piece) > 1 and strands.names[strands.strand_of_vertex[piece[0]]] in names:
            pieces.append(piece)
            closed.append(ring)
    start, end = (_type_at(x, pieces, closed, kind) for x in (motion.x0, motion.x1))
    return start, end


def _type_at(x: Points, pieces: Sequence[Indices], closed: Sequence[bool], kind: CurveKind) -> SameType:
    lengths = [len(piece) for piece in pieces]
    if not lengths or sum(lengths) > MOST_VERTICES:
        why = f"its strands have {sum(lengths)} vertices, and of more than {MOST_VERTICES} nobody looked"
        return SameType(Isotopy.NOT_KNOWN, why if lengths else "no edge of its strands is left", np.inf)
    try:
        return same_type(x[np.concatenate(pieces)], Strands.from_lengths(lengths, closed=closed), kind)
    except MdtopoError as problem:
        return SameType(Isotopy.NOT_KNOWN, str(problem).rstrip("."), np.inf)


def types_in_words(types: Types, frames: tuple[int, int]) -> str:
    """Return what is known of the two frames of a step, in one or two sentences."""
    return " ".join(
        f"At frame {frame}: {str(found)[0].lower()}{str(found)[1:]}" for frame, found in zip(frames, types, strict=True)
    )


def alert_types(path: Path, results: Results, alerts: Iterable[Alert], inputs: Sequence[Path] = ()) -> dict[str, Types]:
    """Return the types at both frames of the worst step of each alert, by the alert's id.

    Alerts that are about no step or no strand, and steps with an unusable frame, are left out.

    Parameters
    ----------
    path : Path
        The results file.
    results : Results
        With the columns ``frame_t0`` and ``frame_t1``.
    alerts : iterable of Alert
    inputs : sequence of Path
        Topology and trajectory, where they have moved; by default the stored paths.

    Raises
    ------
    InputError
        If the run looked at no curve, or the trajectory cannot be opened again.
    """
    config = MonitorConfig.from_mapping(results.config)
    if config.curve == "none" or "curve" not in results.config:
        raise InputError(f"{path} is of a run that looked at no smooth curve; run it with --curve interpolating.")
    told = [alert for alert in alerts if alert.strands and alert.kind is not AlertKind.GAP]
    rows = {alert.id: alert.step_peak - results.first_step for alert in told}
    told.sort(key=lambda alert: rows[alert.id])
    if not told:
        return {}
    ends = [results.steps[name] for name in ("frame_t0", "frame_t1")]
    pairs = {key: (int(ends[0][row]), int(ends[1][row])) for key, row in rows.items()}
    found: dict[str, Types] = {}
    known: dict[tuple[tuple[int, int], tuple[str, ...]], Types] = {}
    paths, _ = input_files(path, results, inputs)
    with open_again(path, results, paths) as reader:
        stream = frames_at(reader, sorted({0, *(frame for pair in pairs.values() for frame in pair)}))
        first = next(stream)  # says whether the run is periodic
        held: dict[int, Frame] = {first.index: first}
        for alert in told:
            t0, t1 = pair = pairs[alert.id]
            held = {index: frame for index, frame in held.items() if index >= t0}
            while t1 not in held:
                frame = next(stream)
                held[frame.index] = frame
            if (pair, alert.strands) not in known:
                periodic = first.cell is not None
                motion = step_path((held[t0], held[t1]), results.strands, results.broken, config, periodic)
                if motion is None:
                    continue
                known[pair, alert.strands] = step_types(*motion, results.strands, alert.strands, config.curve)
            found[alert.id] = known[pair, alert.strands]
    return found
