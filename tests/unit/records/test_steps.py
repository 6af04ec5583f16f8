"""Tables of steps, and one row as an object."""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from mdtopo.records import Crossings, StepReport, StepTable, Stretches


def table(n: int) -> StepTable:
    """Return a table of which no two numbers are equal; codes are what each enum names last."""
    rng = np.random.default_rng(4)

    def column(shape: tuple[int, ...], dtype: type[np.generic]) -> NDArray[np.generic]:
        return rng.permutation(10_000)[: int(np.prod((n, *shape)))].reshape(n, *shape).astype(dtype)

    columns = {
        c.name: np.full(n, list(c.enum)[-1], dtype=np.int8) if c.enum else column(c.shape, c.dtype)
        for c in StepTable.columns()
    }
    none = Crossings.none()
    return StepTable(0, Stretches.none(), (), tuple(f"problem {k}" for k in range(n)), none, none, **columns)


def test_a_report_has_the_columns_of_the_table_in_their_order() -> None:
    names = [entry.name for entry in fields(StepReport)]
    assert names == ["step", "problem", "crossings", "curve_crossings", *(c.name for c in StepTable.columns())]


def test_a_report_holds_what_stands_in_its_row() -> None:
    steps = table(3)
    for row in range(3):
        report = steps.report(row)
        assert (report.step, report.problem) == (row, f"problem {row}")
        for column in StepTable.columns():
            value, stored = getattr(report, column.name), getattr(steps, column.name)[row]
            if column.enum is not None:
                assert value is column.enum(int(stored)), column.name
            elif column.shape:
                assert value.tolist() == stored.tolist(), column.name
            else:
                assert value == stored, column.name
                assert type(value) in (int, float), column.name


def test_a_report_does_not_change_with_the_table_or_the_table_with_it() -> None:
    steps = table(2)
    report = steps.report(1)
    before = steps.nu_pair.copy()
    report.nu_pair[:] = -7
    np.testing.assert_array_equal(steps.nu_pair, before)
