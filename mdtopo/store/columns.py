"""The datasets of a results file: made empty, filled a chunk of rows at a time."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import AuditError
from mdtopo.records import Alert, Crossings, StepTable, Stretches
from mdtopo.records.alerts import SCHEMA as ALERT_SCHEMA
from mdtopo.store.schema import ALERTS, CHUNK_ROWS, CROSSINGS, PROBLEMS, STRETCHES, Layout, column_dtype


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
            extend(self._group[name], buffer[: self._held])
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
        for name in CROSSINGS:
            extend(self._group[name], getattr(held, name))
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
            extend(self._group[name], np.array([_alert_value(row[name]) for row in self._held], layout.dtype))
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
            extend(self._group[name], np.concatenate([getattr(table, name) for table in self._held]))
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
            extend(self._group[name], np.array(values, PROBLEMS[name].dtype))
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


def create_column(group: h5py.Group, name: str, layout: Layout) -> h5py.Dataset:
    """Return a new dataset without rows."""
    dataset = group.create_dataset(
        name,
        shape=(0, *layout.row_shape),
        maxshape=(None, *layout.row_shape),
        chunks=(CHUNK_ROWS, *layout.row_shape),
        dtype=layout.dtype,
        compression="gzip",
        shuffle=True,
        track_times=False,  # equal runs write equal bytes
    )
    dataset.attrs["unit"] = layout.unit
    dataset.attrs["description"] = layout.description
    return dataset


def extend(dataset: h5py.Dataset, values: NDArray[Any]) -> None:
    """Add rows at the end of a dataset.

    Whoever adds to many lets go of each: HDF5 keeps megabytes of chunks for every dataset that is open.
    """
    if len(values):
        start = len(dataset)
        dataset.resize(start + len(values), axis=0)
        dataset[start:] = values


def write_columns(group: h5py.Group, layouts: Mapping[str, Layout], values: Mapping[str, Iterable[Any]]) -> None:
    """Make and fill one dataset for each layout."""
    for name, layout in layouts.items():
        column = np.asarray(values[name], layout.dtype).reshape(-1, *layout.row_shape)
        extend(create_column(group, name, layout), column)
