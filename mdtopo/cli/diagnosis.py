"""What ``mdtopo doctor`` finds out: how an input is understood, and whether its frames are saved often enough."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from mdtopo.bonds import reference_lengths
from mdtopo.errors import InputError, TrajectoryError
from mdtopo.kernelcache import announce_compilation
from mdtopo.measure import measure_block
from mdtopo.pipeline import block_of, refuse_winding
from mdtopo.planning import Setting, reference_samples
from mdtopo.readers import Reader, installed_readers
from mdtopo.records import Frame, Grade, MonitorConfig, Reason, ReferenceLengths, Rung, StepTable, Strands, Verdict
from mdtopo.typing import Cell

SAMPLE_STEPS = 50
"""Steps that are measured: enough for a median, few enough to answer at once."""

SAMPLE_PLACES = 5
"""Places of a longer trajectory where they are measured, from its first to its last step: a run changes as it goes."""

COMFORT = 0.8
"""Pair ratio below which the save interval is called good: the default of ``--near-limit``."""


@dataclass(frozen=True, slots=True)
class StrandGroup:
    """Neighbouring strands that are alike: names and labels of the first and the last."""

    count: int
    n_vertices: int
    is_closed: bool
    names: tuple[str, str]
    labels: tuple[str, str]


@dataclass(frozen=True, slots=True)
class GapNote:
    """Where a strand was cut, and why."""

    place: str
    reason: str


@dataclass(frozen=True, slots=True)
class Box:
    """A periodic box: lengths in Å, angles in degrees."""

    lengths: tuple[float, float, float]
    angles: tuple[float, float, float]

    @classmethod
    def of(cls, cell: Cell) -> "Box":
        """Return lengths and angles of lattice vectors, given as rows."""
        lengths = np.linalg.norm(cell, axis=1)
        pairs = ((1, 2), (0, 2), (0, 1))
        cosines = [float(cell[i] @ cell[j] / (lengths[i] * lengths[j])) for i, j in pairs]
        angles = [math.degrees(math.acos(max(-1.0, min(1.0, c)))) for c in cosines]
        return cls((float(lengths[0]), float(lengths[1]), float(lengths[2])), (angles[0], angles[1], angles[2]))


@dataclass(frozen=True, slots=True)
class Sample:
    """What a sample of the steps measures.

    Attributes
    ----------
    steps : int
        How many steps.
    rungs : mapping of str to int
        Number of proved steps by the costliest rung that they needed.
    unresolved, bad_data : int
        Steps that are not decided, and those of them whose data are unusable.
    crossed, undersampled : int
        Steps with a crossing, and those of them whose crossings are all of the grade UNDERSAMPLED.
    places : int
        Runs of neighbouring steps that were measured, spread evenly over the trajectory; 1 is its beginning.
    nu_ratio, pair_ratio : tuple of float
        Median and greatest value; NaN where nothing was measured.
    least_interval : float
        Least save interval that would have been certified, ps; NaN without times.
    """

    steps: int
    rungs: dict[str, int]
    unresolved: int
    bad_data: int
    crossed: int
    undersampled: int
    places: int
    nu_ratio: tuple[float, float]
    pair_ratio: tuple[float, float]
    least_interval: float

    @classmethod
    def of(cls, tables: Sequence[StepTable]) -> "Sample":
        """Return the sample of the tables of all places."""
        table = StepTable.joined(tables)
        certified = table.verdict == Verdict.CERTIFIED
        rungs = {rung.name: int((certified & (table.rung == rung)).sum()) for rung in Rung if rung is not Rung.OPEN}
        return cls(
            len(table),
            rungs,
            int((table.verdict == Verdict.UNRESOLVED).sum()),
            int((table.reason == Reason.BAD_DATA).sum()),
            crossed := int((table.verdict == Verdict.CROSSING).sum()),
            crossed - len(np.unique(table.crossings.step[table.crossings.grade != Grade.UNDERSAMPLED])),
            len(tables),
            _median_and_greatest(table.nu_ratio),
            _median_and_greatest(table.pair_ratio),
            _least(table.certifiable_interval),
        )


def _median_and_greatest(values: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (float(np.median(known)), float(known.max())) if len(known) else (math.nan, math.nan)


def _least(values: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> float:
    known = values[np.isfinite(values)]
    return float(known.min()) if len(known) else math.nan


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """How an input is understood.

    Attributes
    ----------
    inputs : str
        The files.
    reader : str
        The reader that opened them.
    n_vertices : int
        Vertices of all strands.
    strands, gaps, notes
        What was understood, and what a user should know of it.
    n_frames : int or None
        Frames in the file; None for a stream.
    time_first, time_last, spacing_least, spacing_greatest : float
        Time in ps of the first and the last frame, and between analysed frames of the sample; NaN where unknown.
    box : Box or None
        Of the first frame; None where there is none.
    coordinate_error : float
        η, Å.
    edge_median, edge_spread, edge_frames : float, float, int
        Lengths of all edges in the first frames, Å, and how many frames these are.
    sample : Sample or None
        What a sample of the steps measures; None where there is no step.
    advice : str
        Whether the frames of the sample are saved often enough, in a sentence or two.
    problems : tuple of str
        What ``mdtopo monitor`` would stop at.
    """

    inputs: str
    reader: str
    n_vertices: int
    strands: tuple[StrandGroup, ...]
    gaps: tuple[GapNote, ...]
    notes: tuple[str, ...]
    n_frames: int | None
    coordinate_error: float
    time_first: float = math.nan
    time_last: float = math.nan
    spacing_least: float = math.nan
    spacing_greatest: float = math.nan
    box: Box | None = None
    edge_median: float = math.nan
    edge_spread: float = math.nan
    edge_frames: int = 0
    sample: Sample | None = None
    advice: str = ""
    problems: tuple[str, ...] = ()


def diagnose(reader: Reader, inputs: str, frames: slice, config: MonitorConfig) -> Diagnosis:
    """Return how an open input is understood, and what a sample of its steps measures.

    What would stop a run is no error here: it is in `problems`, after everything that could still be found out.
    """
    strands = reader.strands
    found = Diagnosis(
        inputs=inputs,
        reader=_name(reader),
        n_vertices=strands.n_vertices,
        strands=tuple(strand_groups(strands)),
        gaps=tuple(GapNote(strands.describe_edge(gap.vertices), gap.reason) for gap in strands.gaps),
        notes=tuple(reader.notes),
        n_frames=reader.n_frames,
        coordinate_error=reader.coordinate_error,
    )
    first, sample, problems = _first_frames(reader, frames, config.reference_frames)
    if first:
        found = _with_frames(found, reader, first, sample)
        places, more = _places(reader, frames, sample)
        problems = list(dict.fromkeys([*problems, *more]))
        found, more = _with_steps(found, strands, first, places, config)
        problems += more
    time_last, more = _last_time(reader)
    problems += [text for text in more if text not in problems]
    return replace(found, time_last=time_last, advice=advice(found.sample), problems=tuple(problems))


def _name(reader: Reader) -> str:
    """Return what the reader is called on the command line."""
    names = (name for name, kind in installed_readers().readers.items() if type(reader) is kind)
    return next(names, type(reader).__name__)


def _first_frames(reader: Reader, frames: slice, n_reference: int) -> tuple[list[Frame], list[Frame], list[str]]:
    """Return the trajectory's first frames, the first analysed frames, and what could not be read."""
    sample, problems = _read(reader, frames, SAMPLE_STEPS + 1)
    from_start = frames.start in (None, 0) and frames.step in (None, 1)
    if reader.n_frames is None or (from_start and len(sample) >= min(n_reference, reader.n_frames)):
        return sample[:n_reference], sample, problems
    first, more = _read(reader, slice(0, n_reference), n_reference)
    return first, sample, problems + [text for text in more if text not in problems]


def _read(reader: Reader, frames: slice, count: int) -> tuple[list[Frame], list[str]]:
    taken: list[Frame] = []
    try:
        taken.extend(islice(reader.frames(frames.start, frames.stop, frames.step), count))
    except TrajectoryError as error:
        return taken, [str(error)]
    return taken, []


def _places(reader: Reader, frames: slice, beginning: list[Frame]) -> tuple[list[list[Frame]], list[str]]:
    """Return the frames of the sample place by place, and what could not be read; a short run is one place."""
    every = range(reader.n_frames or 0)[frames]
    if len(every) <= SAMPLE_STEPS + 1 or len(beginning) <= SAMPLE_STEPS:
        return [beginning], []
    length = SAMPLE_STEPS // SAMPLE_PLACES + 1
    places, problems = [beginning[:length]], []
    for start in np.linspace(0, len(every) - length, SAMPLE_PLACES).round().astype(int).tolist()[1:]:
        chosen = every[start : start + length]
        taken, more = _read(reader, slice(chosen[0], chosen[-1] + 1, every.step), length)
        places.append(taken)
        problems += more
    return [place for place in places if len(place) > 1], problems


def _with_frames(found: Diagnosis, reader: Reader, first: list[Frame], sample: list[Frame]) -> Diagnosis:
    reference = reference_lengths(reference_samples(first, reader.strands))
    spacings = np.diff([frame.time for frame in sample]) if len(sample) > 1 else np.array([math.nan])
    return replace(
        found,
        time_first=first[0].time,
        spacing_least=float(spacings.min()),
        spacing_greatest=float(spacings.max()),
        box=None if first[0].cell is None else Box.of(first[0].cell),
        edge_median=reference.median,
        edge_spread=reference.spread,
        edge_frames=reference.n_frames,
    )


def _with_steps(
    found: Diagnosis, strands: Strands, first: list[Frame], places: list[list[Frame]], config: MonitorConfig
) -> tuple[Diagnosis, list[str]]:
    try:
        refuse_winding(first[0], strands)
    except InputError as error:
        return found, [str(error)]
    if not places or len(places[0]) < 2:
        return found, []
    reference: ReferenceLengths = reference_lengths(reference_samples(first, strands))
    announce_compilation()
    setting = Setting.start(strands, replace(config, profile_steps=0, curve="none"), reference)
    tables, first_step = [], 0
    for place in places:
        block = block_of(place, first_step, periodic=first[0].cell is not None)
        tables.append(measure_block(block, setting)[0])  # what broke between two places is not known
        first_step += len(tables[-1])
    return replace(found, sample=Sample.of(tables)), []


def _last_time(reader: Reader) -> tuple[float, list[str]]:
    """Return the time of the last frame; reading it shows whether the file is whole."""
    if not reader.n_frames:
        return math.nan, []
    taken, problems = _read(reader, slice(reader.n_frames - 1, reader.n_frames), 1)
    return (taken[0].time if taken else math.nan), problems


def strand_groups(strands: Strands) -> Iterator[StrandGroup]:
    """Yield the strands, neighbours of equal length and kind together."""
    lengths = np.diff(strands.offsets)
    start = 0
    for s in range(strands.n_strands):
        alike = s + 1 < strands.n_strands and (lengths[s + 1], strands.closed[s + 1]) == (lengths[s], strands.closed[s])
        if alike:
            continue
        labels = (
            strands.labels.text(int(strands.offsets[start])),
            strands.labels.text(int(strands.offsets[s + 1]) - 1),
        )
        names = (strands.names[start], strands.names[s])
        yield StrandGroup(s + 1 - start, int(lengths[s]), bool(strands.closed[s]), names, labels)
        start = s + 1


def advice(sample: Sample | None) -> str:
    """Return whether the frames of a sample of the steps are saved often enough (heuristic)."""
    if sample is None:
        return "There is no step to judge by: a step needs two frames."
    ratio = sample.pair_ratio[1]
    if math.isnan(ratio):
        return "No step could be measured, so nothing can be said about the save interval."
    undecided, shown = sample.unresolved - sample.bad_data, sample.crossed - sample.undersampled
    if shown:
        return (
            f"Strands pass through each other, and that is proved at this spacing: {_steps_are(shown, sample)} crossed "
            "(proven or resolved). That is not for want of frames; 'mdtopo monitor' says where and when."
            + (f" {_too_coarse(undecided, sample)}" if undecided or sample.undersampled else "")
        )
    if undecided or sample.undersampled:
        return (
            "Strands pass through each other, or the frames are too far apart to tell: "
            f"{_too_coarse(undecided, sample)[:-1]}; {_closer(sample)}."
        )
    if ratio >= COMFORT:
        return f"The save interval is just short enough: the greatest pair ratio is {ratio:.2f}; {_closer(sample)}."
    spare = math.floor(COMFORT / ratio) if ratio > 0.0 else 0
    more = f"; about {spare} times as long would still do" if spare >= 2 else ""
    which = "each of these steps" if sample.places > 1 else f"each of the first {sample.steps} steps"
    return f"The save interval is good in this sample: {which} that could be measured is proved{more}."


def _steps_are(number: int, sample: Sample) -> str:
    return f"{number} of {sample.steps} steps {'is' if number == 1 else 'are'}"


def _too_coarse(undecided: int, sample: Sample) -> str:
    """Return in a sentence how many steps leave a passage open, and why."""
    parts = [f"{_steps_are(undecided, sample)} not decided"] if undecided else []
    if sample.undersampled:
        parts.append(f"{_steps_are(sample.undersampled, sample)} crossed, where a passage cannot be told from a detour")
    return f"{' and '.join(parts)}."


def _closer(sample: Sample) -> str:
    times = max(2, math.ceil(sample.pair_ratio[1] / COMFORT))
    return f"save about {times} times as often"
