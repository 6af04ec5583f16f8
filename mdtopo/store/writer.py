"""Writing a results file: under a temporary name until it is whole."""

import json
import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from mdtopo.bonds import BondState
from mdtopo.errors import OutputError
from mdtopo.records import Alert, BrokenEdge, MonitorConfig, ReferenceLengths, StepTable, Strands
from mdtopo.store.atomic import check_target, failed, partial_name, sync_directory
from mdtopo.store.bondstates import bonds_to_mapping
from mdtopo.store.columns import (
    AlertColumns,
    CrossingColumns,
    ProblemColumns,
    StepColumns,
    StretchColumns,
    create_column,
    extend,
    storable_text,
    write_columns,
)
from mdtopo.store.guard import GuardedFile
from mdtopo.store.profile import ProfileColumns
from mdtopo.store.provenance import Provenance
from mdtopo.store.schema import (
    BROKEN,
    REFERENCE,
    SCHEMA,
    STRANDS,
    VERTEX_TEXTS,
    Layout,
)


class ResultsWriter:
    """A results file that is being written; made by `create`.

    The file grows under the name ``.<name>.<pid>.<random>.partial`` beside its target and gets its own name
    in `finish`, so that nobody ever meets half a file. Memory is bounded: rows are held back until they fill
    a chunk.

    Left as a context manager without `finish`, it keeps the rows that it has and marks them as not complete;
    without any row, or after a failed write, nothing stays behind.
    """

    def __init__(
        self,
        path: Path,
        partial: Path,
        descriptor: int,
        strands: Strands,
        provenance: Provenance,
        overwrite: bool,
    ) -> None:
        self._path = path
        self._partial = partial
        self._descriptor = descriptor
        self._strands = strands
        self._provenance = provenance
        self._overwrite = overwrite
        self._broken: list[BrokenEdge] = []
        self._is_open = True
        self._guard = GuardedFile(descriptor)
        self._file = h5py.File(self._guard, "w")
        self._steps = StepColumns(self._file.create_group("steps"))
        self._crossings = CrossingColumns(self._file.create_group("crossings"))
        self._alerts = AlertColumns(self._file.create_group("alerts"))
        self._stretches = StretchColumns(self._file.create_group("stretches"))
        self._problems = ProblemColumns(self._file.create_group("problems"))
        self._profile = ProfileColumns(self._file.create_group("profile"), strands.n_vertices)

    @classmethod
    def create(
        cls,
        path: Path,
        strands: Strands,
        config: MonitorConfig,
        provenance: Provenance,
        *,
        request: Mapping[str, Any] | None = None,
        overwrite: bool = False,
        folder: Path | None = None,
    ) -> Self:
        """Return a writer for a new file.

        Parameters
        ----------
        path : Path
            The file; it appears when it is whole.
        strands, config, provenance
            What the results are about, how they are made, and where from.
        request : mapping, optional
            What was asked of the input beside its files, so that it can be opened again: ``select``, ``frames``
            (start, stop, step), ``reader`` and ``reader_options``. Values that JSON does not know are stored as text.
        overwrite : bool
            Whether a file of that name may be replaced.
        folder : Path, optional
            Where the file grows until it is whole, a directory of the same file system; by default beside it.

        Raises
        ------
        OutputError
            If the target exists and may not be replaced, or its directory is missing or cannot be written to.
        """
        check_target(path, overwrite=overwrite)
        partial = partial_name(path, folder)
        try:
            descriptor = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise failed(path, error) from error
        writer = cls(path, partial, descriptor, strands, provenance, overwrite)
        try:
            writer._begin(config, request or {})
        except BaseException:
            writer.abort()
            raise
        return writer

    def _begin(self, config: MonitorConfig, request: Mapping[str, Any]) -> None:
        attributes = self._file.attrs
        attributes["schema"] = SCHEMA
        attributes["config"] = json.dumps(config.to_mapping())
        attributes["request"] = json.dumps(request, default=str)
        attributes["provenance"] = json.dumps(self._provenance.to_mapping())
        attributes["complete"] = False
        _write_strands(self._file.create_group("strands"), self._strands)
        self._flush()

    def append(self, table: StepTable) -> None:
        """Add the steps of a table, their crossings (polyline and curve in one list) and profile, and edges that broke.

        Raises
        ------
        OutputError
            If they cannot be written; nothing stays behind then.
        AuditError
            If the table's steps do not follow those that are there.
        """
        self._check_open()
        written = self._steps.append(table) | self._crossings.append(table.crossings.and_then(table.curve_crossings))
        written |= self._stretches.append(table.stretches) | self._problems.append(table)
        self._profile.append(table.profile)
        self._broken.extend(table.broken)
        if written:
            self._flush()

    def append_alert(self, alert: Alert) -> None:
        """Add an alert.

        Raises
        ------
        OutputError
            If it cannot be written; nothing stays behind then.
        """
        self._check_open()
        if self._alerts.append(alert):
            self._flush()

    def add_reference(self, reference: ReferenceLengths) -> None:
        """Store the reference lengths of the edges, once in a run.

        Raises
        ------
        OutputError
            If they cannot be written; nothing stays behind then.
        """
        self._check_open()
        group = self._file["strands"]
        write_columns(group, REFERENCE, {"edge": self._strands.edges, "reference_length": reference.lengths})
        for name in ("median", "spread", "n_frames"):
            group["reference_length"].attrs[name] = getattr(reference, name)
        self._flush()

    def add_bonds(self, start: BondState, end: BondState) -> None:
        """Store which edges were broken, or on the way to it, after the first and after the last frame of the steps.

        Who goes on behind the last frame, or joins two files there, must know it.

        Raises
        ------
        OutputError
            If it cannot be written; nothing stays behind then.
        """
        self._check_open()
        for name, state in (("bonds_start", start), ("bonds_end", end)):
            self._file["strands"].attrs[name] = json.dumps(bonds_to_mapping(state))

    def inherit(self, broken: Iterable[BrokenEdge]) -> None:
        """Add edges that had broken before the first step; they are stored as of step -1."""
        self._broken.extend(replace(edge, step=-1) for edge in broken)

    @property
    def partial(self) -> Path:
        """Where the file is until it has its name."""
        return self._partial

    @property
    def is_open(self) -> bool:
        """Whether the file is being written still."""
        return self._is_open

    def rename(self, path: Path, *, overwrite: bool) -> None:
        """Let the file get another name in the end, in a directory of the same file system.

        Raises
        ------
        OutputError
            As `create`.
        """
        check_target(path, overwrite=overwrite)
        self._path, self._overwrite = path, overwrite

    def finish(self, summary: Mapping[str, Any], *, complete: bool = True) -> None:
        """Write what is held back, then `complete`, then give the file its name.

        When this returns, the file is on the disk under its name, and stays there if the machine stops.

        Parameters
        ----------
        summary : mapping
            What the run comes to; values that JSON does not know are stored as their text.
        complete : bool
            Whether every step was measured. A file that is not complete holds all steps that were appended.

        Raises
        ------
        OutputError
            If the file cannot be written (nothing stays behind then), or if its name was taken meanwhile (the
            temporary file stays then, and the message names it).
        """
        self._check_open()
        with ThreadPoolExecutor(1) as other:  # the profile is most of a short run's file, and zlib runs beside Python
            packing = other.submit(self._profile.pack)
            self._steps.flush()
            self._crossings.flush()
            self._alerts.flush()
            self._stretches.flush()
            self._problems.flush()
        packing.result()
        self._profile.flush()
        write_columns(self._file["strands"], BROKEN, _broken_columns(self._broken))
        # default=str: a value that JSON does not know must not cost the run
        self._file.attrs["summary"] = json.dumps(summary, default=str)
        self._file.attrs["provenance"] = json.dumps(self._provenance.ended_now().to_mapping())
        self._flush()
        self._file.attrs["complete"] = complete
        self._close()
        self._publish()

    def abort(self) -> None:
        """Remove the temporary file. After `finish`, or a second time, it does nothing."""
        if self._is_open:
            self._is_open = False
            try:
                self._file.close()
            finally:
                os.close(self._descriptor)
                self._partial.unlink(missing_ok=True)

    def _check_open(self) -> None:
        if not self._is_open:
            raise ValueError(f"{self._path} is not being written any more.")

    def _flush(self) -> None:
        self._file.flush()
        self._check_disk()

    def _check_disk(self) -> None:
        if self._guard.error is not None:
            self.abort()
            raise failed(self._path, self._guard.error) from self._guard.error

    def _close(self) -> None:
        self._file.close()
        if self._guard.error is None:
            try:
                os.fsync(self._descriptor)
            except OSError as error:
                self._guard.error = error
        self._check_disk()
        self._is_open = False
        os.close(self._descriptor)

    def _publish(self) -> None:
        if self._path.exists() and not self._overwrite:
            raise OutputError(
                f"{self._path} appeared while this run was going on and is kept; the results are in {self._partial}."
            )
        try:
            self._partial.replace(self._path)
        except OSError as error:
            raise OutputError(f"{failed(self._path, error)} The results are in {self._partial}.") from error
        sync_directory(self._path.parent)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._is_open and self._steps.n_rows:
            self.finish({}, complete=False)
        self.abort()


def _write_strands(group: h5py.Group, strands: Strands) -> None:
    labels = strands.labels
    columns: dict[str, Iterable[Any]] = {
        "offsets": strands.offsets,
        "closed": strands.closed,
        "names": [storable_text(name) for name in strands.names],
        "vertex_atom": labels.atom_index,
        "vertex_resid": labels.resid,
        "gap_vertices": [gap.vertices for gap in strands.gaps],
        "gap_reason": [storable_text(gap.reason) for gap in strands.gaps],
    }
    write_columns(group, STRANDS, columns)
    texts = {
        "vertex_label": np.array(labels.texts()),
        "vertex_chain": labels.chain,
        "vertex_icode": labels.icode,
        "vertex_resname": labels.resname,
        "vertex_name": labels.atom,
    }
    for name, description in VERTEX_TEXTS.items():
        encoded = _encoded(texts[name])
        layout = Layout(h5py.string_dtype("utf-8", max(1, encoded.itemsize)), description)
        column = np.empty(len(encoded), layout.dtype)  # the dtype tells h5py that these bytes are UTF-8
        column[:] = encoded
        extend(create_column(group, name, layout), column)


def _encoded(texts: NDArray[np.str_]) -> NDArray[np.bytes_]:
    """Return texts in UTF-8, as wide as the longest."""
    width = max(1, int(np.strings.str_len(texts).max(initial=0)))
    try:
        return texts.astype(f"S{width}")  # at once, where all is ASCII
    except UnicodeEncodeError:
        return np.char.encode(texts, "utf-8", "backslashreplace")


def _broken_columns(broken: Iterable[BrokenEdge]) -> dict[str, list[Any]]:
    edges = list(broken)
    return {name: [getattr(edge, name.removeprefix("broken_")) for edge in edges] for name in BROKEN}
