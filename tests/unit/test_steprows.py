"""The record of a step: what its fields are before anything is known, and whose columns they are."""

import numpy as np
import pytest

from mdtopo.records import PairClass, Reason, Rung, Scope, StepTable, Verdict
from mdtopo.steprows import ROW, columns_of, settle, unmeasured

COUNTS = {"n_crossings", "image_jumps", "rung_pairs"}
CODES = {
    "nu_class": PairClass.NONE,
    "verdict": Verdict.UNRESOLVED,
    "scope": Scope.NONE,
    "rung": Rung.OPEN,
    "reason": Reason.NONE,
}


def test_the_columns_are_those_of_the_step_table_that_are_about_the_polyline() -> None:
    found = columns_of(unmeasured(3))
    wanted = {c.name: c for c in StepTable.columns() if not c.name.startswith(("curve_", "frame_", "time_"))}
    assert list(found) == list(wanted)
    for name, column in found.items():
        assert column.dtype == wanted[name].dtype
        assert column.shape == (3, *wanted[name].shape)


def test_of_steps_that_were_not_measured_nothing_is_known() -> None:
    for name, column in columns_of(unmeasured(3)).items():
        if name in CODES:
            assert (column == CODES[name]).all(), name
        elif name in COUNTS:
            assert (column == 0).all(), name
        elif column.dtype == np.float64:
            assert np.isnan(column).all(), name
        else:
            assert (column == -1).all(), name
    rows = unmeasured(3)
    assert rows["cell_ok"].all()
    assert (rows["jumping_edge"] == -1).all()
    assert not rows["is_turned"].any()


def test_rows_are_their_own_memory_and_can_be_written_to() -> None:
    one, other = unmeasured(2), unmeasured(2)
    one[1]["nu"] = 1.0
    assert one["nu"][1] == 1.0
    assert np.isnan([one["nu"][0], *other["nu"]]).all()
    assert ROW.isalignedstruct
    assert one.flags.aligned


@pytest.mark.parametrize(
    ("undecided", "still_open", "rung"), [(3, 0, Rung.EXACT), (3, 1, Rung.OPEN), (0, 0, Rung.BALL)]
)
def test_pairs_that_exact_arithmetic_decides_are_counted_under_its_rung(
    undecided: int, still_open: int, rung: Rung
) -> None:
    row = unmeasured(1)[0]
    row["rung"], row["rung_pairs"] = Rung.OPEN if undecided else Rung.BALL, [0, 0, 0, 5, 0, 2, 0, 1, undecided]
    settle(row, undecided, still_open)
    assert row["rung"] == rung
    assert row["rung_pairs"].tolist() == [0, 0, 0, 5, 0, 2, 0, 1 + undecided - still_open, still_open]
