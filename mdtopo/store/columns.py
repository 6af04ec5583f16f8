"""The datasets of a results file: made empty, filled a chunk of rows at a time."""

import json
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t
from numpy.typing import NDArray

from mdtopo.errors import AuditError
from mdtopo.records import Alert, Crossings, StepTable, Stretches
from mdtopo.records.alerts import SCHEMA as ALERT_SCHEMA
from mdtopo.store.packing import GZIP_LEVEL, packed_chunks
from mdtopo.store.schema import ALERTS, CHUNK_ROWS, CROSSINGS, PROBLEMS, STRETCHES, TEXT, Layout, column_dtype


class StepColumns:
    """The datasets of /steps, and one chunk of rows that are not written yet."""

    def __init__(self, group: h5py.Group) -> None:
        self.n_rows = 0
        self._group = group
        self._first_step = 0
        self._held = 0
        self._buffers: dict[str, NDArray[Any]] = {}
        group.attrs["first_step"] = 0
        for column in StepTable.columns():
            layout = Layout(column_dtype(column), column.description, column.unit, column.shape)
            create_column(group, column.name, layout)
            self._buffers[column.name] = np.empty((CHUNK_ROWS, *column.shape), layout.dtype)

    def append(self, table: StepTable) -> bool:
        """Take the rows of a table; True if some of them were written."""
        self._check_order(table)
        done, written = 0, False
        while done < len(table):
            count = min(len(table) - done, CHUNK_ROWS - self._held)
            self._hold(table, done, count)
            done += count
            if self._held == CHUNK_ROWS:
                self.flush()
                written = True
        return written

    def _check_order(self, table: StepTable) -> None:
        if self.n_rows == 0:
            self._group.attrs["first_step"] = self._first_step = table.first_step
        expected = self._first_step + self.n_rows
        if table.first_step != expected:
            raise AuditError(f"Step {table.first_step} was to be stored where step {expected} belongs.")

    def _hold(self, table: StepTable, done: int, count: int) -> None:
        for name, buffer in self._buffers.items():
            values = getattr(table, name)[done : done + count]
            if values.shape != (count, *buffer.shape[1:]):
                raise AuditError(f"The column {name} has shape {values.shape}, not {(count, *buffer.shape[1:])}.")
            np.copyto(buffer[self._held : self._held + count], values, casting="same_kind")
        self._held += count
        self.n_rows += count

    def flush(self) -> None:
        """Write the rows that are held back."""
        for name, buffer in self._buffers.items():
            extend(open_column(self._group, name), buffer[: self._held])
        self._held = 0


class CrossingColumns:
    """The datasets of /crossings, and the crossings that are not written yet."""

    def __init__(self, group: h5py.Group) -> None:
        self._group = group
        self._held: list[Crossings] = []
        for name, layout in CROSSINGS.items():
            create_column(group, name, layout)

    def append(self, crossings: Crossings) -> bool:
        """Take some crossings; True if some were written."""
        if len(crossings):
            self._held.append(crossings)
        if sum(map(len, self._held)) < CHUNK_ROWS:
            return False
        self.flush()
        return True

    def flush(self) -> None:
        """Write the crossings that are held back."""
        held = Crossings.joined(self._held)
        for name in CROSSINGS if self._held else ():
            extend(open_column(self._group, name), getattr(held, name))
        self._held = []


class AlertColumns:
    """The datasets of /alerts, and the alerts that are not written yet."""

    def __init__(self, group: h5py.Group) -> None:
        self._group = group
        self._held: list[dict[str, Any]] = []
        group.attrs["schema"] = ALERT_SCHEMA
        for name, layout in ALERTS.items():
            create_column(group, name, layout)

    def append(self, alert: Alert) -> bool:
        """Take an alert; True if some were written."""
        self._held.append(alert.to_mapping())
        if len(self._held) < CHUNK_ROWS:
            return False
        self.flush()
        return True

    def flush(self) -> None:
        """Write the alerts that are held back."""
        for name, layout in ALERTS.items():
            extend(
                open_column(self._group, name), np.array([_alert_value(row[name]) for row in self._held], layout.dtype)
            )
        self._held = []


class StretchColumns:
    """The datasets of /stretches, and the rows that are not written yet."""

    def __init__(self, group: h5py.Group) -> None:
        self._group = group
        self._held: list[Stretches] = []
        for name, layout in STRETCHES.items():
            create_column(group, name, layout)

    def append(self, stretches: Stretches) -> bool:
        """Take some rows; True if some were written."""
        if len(stretches.step):
            self._held.append(stretches)
        if sum(len(table.step) for table in self._held) < CHUNK_ROWS:
            return False
        self.flush()
        return True

    def flush(self) -> None:
        """Write the rows that are held back."""
        for name in STRETCHES if self._held else ():
            extend(open_column(self._group, name), np.concatenate([getattr(table, name) for table in self._held]))
        self._held = []


class ProblemColumns:
    """The datasets of /problems, and the rows that are not written yet."""

    def __init__(self, group: h5py.Group) -> None:
        self._group = group
        self._held: list[tuple[int, str]] = []
        for name, layout in PROBLEMS.items():
            create_column(group, name, layout)

    def append(self, table: StepTable) -> bool:
        """Take what is wrong with the steps of a table; True if some of it was written."""
        numbered = enumerate(table.problems, start=table.first_step)
        self._held += [(step, storable_text(problem)) for step, problem in numbered if problem]
        if len(self._held) < CHUNK_ROWS:
            return False
        self.flush()
        return True

    def flush(self) -> None:
        """Write the rows that are held back."""
        for name, values in zip(PROBLEMS, zip(*self._held, strict=True), strict=False):
            extend(open_column(self._group, name), np.array(values, PROBLEMS[name].dtype))
        self._held = []


def _alert_value(value: Any) -> Any:
    if value is None:
        return np.nan
    if isinstance(value, str):
        return storable_text(value)
    return json.dumps(value) if isinstance(value, list | tuple) else value


def storable_text(text: str) -> str:
    """Return text that HDF5 takes: a file name may hold bytes that are no UTF-8, and a strand name a NUL."""
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\0")


def create_column(group: h5py.Group, name: str, layout: Layout, chunk_rows: int = CHUNK_ROWS) -> h5d.DatasetID:
    """Return a new dataset without rows, stored in chunks of so many.

    A file has a hundred of them, and `h5py.Group.create_dataset` with attributes takes longer than to fill them: what
    is the same for all is prepared once.
    """
    space = h5s.create_simple((0, *layout.row_shape), (h5s.UNLIMITED, *layout.row_shape))
    kind = h5t.py_create(np.dtype(layout.dtype), logical=True)
    column = h5d.create(group.id, name.encode(), kind, space, dcpl=_creation((chunk_rows, *layout.row_shape)))
    for key, text in ((b"unit", layout.unit), (b"description", layout.description)):
        attribute = h5a.create(column, key, _stored_text(), h5s.create_simple(()))
        attribute.write(np.array(text, TEXT))
    return column


@cache
def _creation(chunk: tuple[int, ...]) -> h5p.PropDCID:
    """Return how a dataset is stored: as `create_dataset` does with gzip and shuffle."""
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_chunk(chunk)
    properties.set_shuffle()
    properties.set_deflate(GZIP_LEVEL)
    properties.set_obj_track_times(False)  # equal runs write equal bytes
    return properties


@cache
def _stored_text() -> h5t.TypeID:
    return h5t.py_create(TEXT, logical=True)


def open_column(group: h5py.Group, name: str) -> h5d.DatasetID:
    """Return a dataset that is there."""
    return h5d.open(group.id, name.encode())


def extend(column: h5d.DatasetID, values: NDArray[Any]) -> None:
    """Add rows at the end of a dataset; texts must have its dtype.

    Whoever adds to many lets go of each: HDF5 keeps megabytes of chunks for every dataset that is open.
    """
    if not len(values):
        return
    is_text = values.dtype.kind == "O"
    rows = np.ascontiguousarray(values) if is_text else np.ascontiguousarray(values, column.dtype)
    start, chunk_rows = column.shape[0], column.get_create_plist().get_chunk()[0]
    if start % chunk_rows == 0 and not is_text:
        extend_packed(column, len(rows), packed_chunks(rows, chunk_rows))
        return
    column.set_extent((start + len(rows), *rows.shape[1:]))
    space = column.get_space()
    space.select_hyperslab((start, *(0,) * (rows.ndim - 1)), rows.shape)
    # an enum in memory is what it is in the file; Python's texts are converted, as their dtype says
    column.write(h5s.create_simple(rows.shape), space, rows, None if is_text else column.get_type())


def extend_packed(column: h5d.DatasetID, n_rows: int, chunks: list[bytes]) -> None:
    """Add so many rows, as `packed_chunks` has packed them, at the end of a dataset, whose last chunk is full."""
    start, *width = column.shape
    chunk_rows = column.get_create_plist().get_chunk()[0]
    column.set_extent((start + n_rows, *width))
    for k, data in enumerate(chunks):
        column.write_direct_chunk((start + k * chunk_rows, *(0 for _ in width)), data)


def write_columns(group: h5py.Group, layouts: Mapping[str, Layout], values: Mapping[str, Iterable[Any]]) -> None:
    """Make and fill one dataset for each layout."""
    for name, layout in layouts.items():
        column = np.asarray(values[name], layout.dtype).reshape(-1, *layout.row_shape)
        extend(create_column(group, name, layout), column)
