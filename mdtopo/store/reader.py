"""Reading a results file."""

import json
import math
import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from mdtopo.bonds import BondState
from mdtopo.errors import InputError, MissingFileError
from mdtopo.notebook import html_table, plot_profile, plot_steps, profile_dataframe, steps_dataframe
from mdtopo.records import (
    Alert,
    AlertKind,
    BrokenEdge,
    Crossings,
    Gap,
    MonitorConfig,
    Profile,
    ReferenceLengths,
    Severity,
    Shape,
    Strands,
    VertexLabels,
)
from mdtopo.store.bondstates import bonds_from_mapping
from mdtopo.store.profile import stored_profile
from mdtopo.store.schema import ALERTS, BROKEN, CROSSINGS, OLDEST_SCHEMA, SCHEMA, TEXT
from mdtopo.typing import JsonObject

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIGNATURE = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Results:
    """What a results file holds.

    Attributes
    ----------
    schema : int
        Number of the file's layout.
    complete : bool
        Whether the run came to its end.
    config, request, provenance, summary : mapping
        The knobs, what was asked of the input beside its files, where the results come from, and what the run comes to
        (empty in a run that did not end).
    first_step : int
        The step of row 0.
    steps : mapping of str to ndarray, shape (n_steps, ...)
        The columns by name; `StepTable` says what they mean. Enum columns are int8 codes.
    crossings : Crossings
        Of the polyline, by step and time.
    alerts : tuple of Alert
        In the order in which they were given.
    strands : Strands
        Which vertices form which strand.
    reference : ReferenceLengths or None
        Lengths of the edges at the start, where the file has them.
    broken : tuple of BrokenEdge
        Edges that broke; of step -1 where that was before the first step.
    bonds : tuple of BondState, or None
        Which edges were broken, or on the way to it, after the first frame and after the last one; None where the file
        does not say.
    curve_crossings : Crossings
        Of the smooth curve, by step and time.
    in_progress : bool
        Whether these are the finished parts of a run that has not ended.
    stored : range
        The steps that the file holds, of which some alone may have been read.
    profile : Profile or None
        How close every vertex came, window by window; None where the file holds none, or step columns were named to
        `read_results`.
    """

    schema: int
    complete: bool
    config: JsonObject
    request: JsonObject
    provenance: JsonObject
    summary: JsonObject
    first_step: int
    steps: Mapping[str, NDArray[Any]]
    crossings: Crossings
    alerts: tuple[Alert, ...]
    strands: Strands
    reference: ReferenceLengths | None
    broken: tuple[BrokenEdge, ...]
    bonds: tuple[BondState, BondState] | None = None
    curve_crossings: Crossings = field(default_factory=Crossings.none)
    in_progress: bool = False
    stored: range = range(0)
    profile: Profile | None = None

    @property
    def n_steps(self) -> int:
        """Number of steps, by the columns that were read."""
        return len(next(iter(self.steps.values()), ()))

    def plot(self, ax: Any = None) -> "Axes":
        """Return matplotlib axes with clearance, ratio, limit and alerts over time; see `plot_steps`."""
        return plot_steps(self.steps, self.first_step, MonitorConfig.from_mapping(self.config), self.alerts, ax)

    def to_dataframe(self) -> Any:
        """Return the step columns as a pandas DataFrame; see `steps_dataframe`."""
        return steps_dataframe(self.steps, self.first_step)

    def plot_profile(self, ax: Any = None) -> "Axes":
        """Return matplotlib axes with a heat map of the clearance, vertices by time; see `plot_profile`.

        Raises
        ------
        InputError
            If the file holds no profile, or it was not read.
        """
        return plot_profile(self._known_profile(), self.steps, self.first_step, ax)

    def profile_dataframe(self) -> Any:
        """Return the profile as a pandas DataFrame, windows by vertices; see `profile_dataframe`.

        Raises
        ------
        InputError
            If the file holds no profile, or it was not read.
        """
        return profile_dataframe(self._known_profile(), self.strands)

    def _known_profile(self) -> Profile:
        if self.profile is None:
            raise InputError("These results hold no profile: read the file with all its columns, or run it again.")
        return self.profile

    @property
    def _state(self) -> str:
        return "in progress" if self.in_progress else "complete" if self.complete else "not complete"

    def __repr__(self) -> str:
        """Return the run in one line: its columns are no help at a prompt."""
        held = f"{len(self.stored)} steps, {self.strands.n_strands} strands, {len(self.alerts)} alerts"
        return f"<Results: {self.summary.get('verdict', 'no verdict yet')}, {self._state}, {held}>"

    def _repr_html_(self) -> str:
        """Return a table for a notebook."""
        state = self._state
        strands, severities = self.strands, Counter(alert.severity for alert in self.alerts)
        kinds = ", ".join(f"{n} {severity.name.lower()}" for severity, n in sorted(severities.items(), reverse=True))
        rows: list[tuple[str, object]] = [
            ("verdict", self.summary.get("verdict", "none yet")),
            ("run", state),
            ("steps", len(self.stored)),
            (
                "strands",
                f"{strands.n_strands} ({', '.join(strands.names[:5])}{', …' if strands.n_strands > 5 else ''})",
            ),
            ("crossings", len(self.crossings)),
            ("alerts", f"{len(self.alerts)} ({kinds})" if kinds else 0),
        ]
        return html_table("mdtopo results", rows)


def read_results(
    path: str | os.PathLike[str],
    *,
    columns: Collection[str] | None = None,
    optional: Collection[str] = (),
    steps: range | None = None,
    profile: bool | None = None,
) -> Results:
    """Return the contents of a results file. The file is not locked, which shared file systems often cannot.

    Parameters
    ----------
    path : path
        The file.
    columns : collection of str, optional
        Names of the step columns to read; all by default. Every row is held in memory.
    optional : collection of str
        More of them, that are read where the file has them.
    steps : range, optional
        The consecutive steps whose rows are read; all by default, and of these those that the file holds.

    profile : bool, optional
        Whether the profile is read too; by default where all columns are.

    Raises
    ------
    MissingFileError
        If there is no such file.
    InputError
        If it is no results file, is damaged, has a newer schema, or has no column of that name.
    """
    path = Path(path)
    with opened_results(path) as file:
        if columns is not None:
            columns = [*columns, *(name for name in optional if name in file["steps"])]
        return _contents(path, file, columns, steps, columns is None if profile is None else profile)


@contextmanager
def opened_results(path: Path) -> Iterator[h5py.File]:
    """Open a results file for reading, without a lock; what goes wrong with it meanwhile is said in one sentence.

    Raises
    ------
    InputError
        As `read_results`.
    """
    _check_is_hdf5(path)
    try:
        with h5py.File(path, "r", locking=False) as file:
            _check_schema(path, file)
            yield file
    except InputError:  # is an OSError or ValueError too, and says more
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path} is truncated or damaged ({error}).") from error


def _check_is_hdf5(path: Path) -> None:
    if not path.exists():
        raise MissingFileError(f"{path} does not exist.")
    try:
        with path.open("rb") as file:
            found = file.read(len(_SIGNATURE))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}).") from error
    if found != _SIGNATURE:
        raise InputError(f"{path} is not an HDF5 file; a results file of mdtopo was expected.")


def _check_schema(path: Path, file: h5py.File) -> None:
    found = file.attrs.get("schema")
    if not isinstance(found, np.integer) or not {"config", "provenance", "complete"} <= set(file.attrs):
        raise InputError(f"{path} is an HDF5 file, but not a results file of mdtopo.")
    if found > SCHEMA:
        raise InputError(f"{path} has schema {found}, and this mdtopo reads up to {SCHEMA}; use a newer mdtopo.")
    if found < OLDEST_SCHEMA:
        raise InputError(
            f"{path} has schema {found}, and this mdtopo reads from {OLDEST_SCHEMA} on; run 'mdtopo monitor' again."
        )


def _contents(
    path: Path, file: h5py.File, columns: Collection[str] | None, steps: range | None, profile: bool
) -> Results:
    strands = stored_strands(file["strands"])
    first = int(file["steps"].attrs["first_step"])
    stored = range(first, first + len(file["steps/frame_t0"]))
    read = stored if steps is None else _common(stored, steps)
    crossings = _crossings(file.get("crossings"), strands)
    return Results(
        schema=int(file.attrs["schema"]),
        complete=bool(file.attrs["complete"]),
        config=json.loads(file.attrs["config"]),
        request=json.loads(file.attrs.get("request", "{}")),
        provenance=json.loads(file.attrs["provenance"]),
        summary=json.loads(file.attrs.get("summary", "{}")),
        first_step=read.start,
        steps=_steps(path, file["steps"], columns, slice(read.start - first, read.stop - first)),
        crossings=crossings.of(Shape.POLYLINE),
        curve_crossings=crossings.of(Shape.CURVE),
        alerts=_alerts(file["alerts"]),
        strands=strands,
        reference=_reference(file["strands"]),
        broken=broken_edges(file["strands"]),
        bonds=_bonds(file["strands"], len(strands.edges)),
        stored=stored,
        profile=_profile(file, read) if profile else None,
    )


def _profile(file: h5py.File, steps: range) -> Profile | None:
    return stored_profile(file["profile"]).between(steps.start, steps.stop) if "profile" in file else None


def _common(stored: range, wanted: range) -> range:
    """Return the steps of both; where there are none, an empty range within those that are stored."""
    start = min(max(stored.start, wanted.start), stored.stop)
    return range(start, max(start, min(stored.stop, wanted.stop)))


def _steps(path: Path, group: h5py.Group, columns: Collection[str] | None, rows: slice) -> dict[str, NDArray[Any]]:
    wanted = list(group) if columns is None else list(columns)
    for name in wanted:
        if name not in group:
            raise InputError(f"{path} has no step column {name!r}; it has {', '.join(group)}.")
    return {name: plain_values(group[name], rows) for name in wanted}


def plain_values(dataset: h5py.Dataset, rows: slice = slice(None)) -> NDArray[Any]:
    """Return rows of a dataset, enums as int8 codes."""
    values: NDArray[Any] = dataset[rows]
    return values.view(np.int8) if h5py.check_enum_dtype(dataset.dtype) else values


def _crossings(group: h5py.Group | None, strands: Strands) -> Crossings:
    if group is None:  # written by a version that located none
        return Crossings.none()
    return Crossings(strands=strands, **{name: plain_values(group[name]) for name in CROSSINGS})


def _texts(dataset: h5py.Dataset) -> list[str]:
    texts: list[str] = dataset.asstr()[()].tolist()
    return texts


def _alerts(group: h5py.Group) -> tuple[Alert, ...]:
    columns = {
        name: _texts(group[name]) if layout.dtype is TEXT else group[name][()].tolist()
        for name, layout in ALERTS.items()
        if name != "object" or name in group  # an older version knew none
    }
    rows = zip(*columns.values(), strict=True)
    return tuple(_alert(dict(zip(columns, row, strict=True))) for row in rows)


def _alert(row: dict[str, Any]) -> Alert:
    lists = {name: tuple(json.loads(row[name])) for name in ("strands", "residues")}
    numbers = {name: None if math.isnan(row[name]) else row[name] for name in ("value", "limit")}
    enums = {"kind": AlertKind(row["kind"]), "severity": Severity[row["severity"].upper()]}
    shape = Shape[row.get("object", "polyline").upper()]
    return Alert(**{**row, **lists, **numbers, **enums, "object": shape})


def stored_strands(group: h5py.Group) -> Strands:
    """Return the strands of a results file."""
    texts = {
        name: np.array(_texts(group[f"vertex_{name}"]), dtype=np.str_) for name in ("chain", "icode", "resname", "name")
    }
    labels = VertexLabels(
        chain=texts["chain"],
        resid=group["vertex_resid"][()],
        icode=texts["icode"],
        resname=texts["resname"],
        atom=texts["name"],
        atom_index=group["vertex_atom"][()],
    )
    gaps = zip(group["gap_vertices"][()].tolist(), _texts(group["gap_reason"]), strict=True)
    return Strands(
        offsets=group["offsets"][()],
        closed=group["closed"][()],
        names=tuple(_texts(group["names"])),
        labels=labels,
        gaps=tuple(Gap((before, after), reason) for (before, after), reason in gaps),
    )


def _reference(group: h5py.Group) -> ReferenceLengths | None:
    if "reference_length" not in group:
        return None
    dataset = group["reference_length"]
    median, spread, n_frames = (dataset.attrs[name] for name in ("median", "spread", "n_frames"))
    return ReferenceLengths(dataset[()], float(median), float(spread), int(n_frames))


def _bonds(group: h5py.Group, n_edges: int) -> tuple[BondState, BondState] | None:
    if "bonds_end" not in group.attrs:
        return None
    start, end = (bonds_from_mapping(json.loads(group.attrs[name]), n_edges) for name in ("bonds_start", "bonds_end"))
    return start, end


def broken_edges(group: h5py.Group) -> tuple[BrokenEdge, ...]:
    """Return the edges that broke; of step -1 where that was before the first step."""
    columns = [group[name][()].tolist() for name in BROKEN]
    return tuple(
        BrokenEdge(step, frame, tuple(edge), ratio, limit)
        for step, frame, edge, ratio, limit in zip(*columns, strict=True)
    )
