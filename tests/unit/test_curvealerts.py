"""Which findings about the smooth curve are said aloud: those that the polyline has not said."""

from typing import Any

import numpy as np
import pytest

from mdtopo.alerts import AlertStream, alert_order
from mdtopo.curvealerts import NEAR, own_crossings
from mdtopo.records import (
    Alert,
    AlertKind,
    Crossings,
    CurveVerdict,
    Grade,
    MonitorConfig,
    Reason,
    Severity,
    Shape,
    StepTable,
    Strands,
    Stretches,
    Verdict,
)

STRANDS = Strands.from_lengths([20, 20], closed=[True, False], names=["ring", "bar"])


def passing(
    edges: Any,
    *,
    step: int = 0,
    sign: int = 1,
    grade: Grade = Grade.RESOLVED,
    shape: Shape = Shape.CURVE,
    t: float = 0.5,
) -> Crossings:
    return Crossings(
        strands=STRANDS,
        step=np.array([step]),
        frame_t0=np.array([step]),
        frame_t1=np.array([step + 1]),
        t=np.array([t]),
        edges=np.array([edges]),
        parameters=np.array([[0.5, 0.5]]),
        point=np.zeros((1, 3)),
        sign=np.array([sign]),
        image=np.zeros((1, 3), dtype=np.int64),
        grade=np.array([grade], dtype=np.int8),
        object=np.array([shape], dtype=np.int8),
        motion=np.array([0.5]),
        resolution=np.array([1.0]),
    )


def table(
    n: int, crossings: Crossings | None = None, curve_crossings: Crossings | None = None, **columns: Any
) -> StepTable:
    values: dict[str, Any] = {c.name: np.zeros((n, *c.shape), dtype=c.dtype) for c in StepTable.columns()}
    steps = np.arange(n)
    values |= {"frame_t0": steps, "frame_t1": steps + 1, "time_t0": 2.0 * steps, "time_t1": 2.0 * steps + 2.0}
    values["verdict"][:] = Verdict.CERTIFIED
    values["clearance"][:] = 9.0
    values["curve_verdict"][:] = CurveVerdict.CERTIFIED
    values |= {name: np.asarray(column, dtype=values[name].dtype) for name, column in columns.items()}
    none = Crossings.none()
    return StepTable(
        first_step=0, stretches=Stretches.none(), broken=(), problems=("",) * n,
        crossings=crossings or none, curve_crossings=curve_crossings or none, **values,
    )  # fmt: skip


def alerts_of(*tables: StepTable) -> list[Alert]:
    stream = AlertStream(STRANDS, MonitorConfig())
    said = [alert for one in tables for alert in stream.after(one)] + list(stream.finish())
    assert said == sorted(said, key=lambda alert: alert_order(alert, MonitorConfig().merge_steps))
    return said


EDGES = [[4, 5], [30, 31]]


@pytest.mark.parametrize(
    ("edges", "sign", "is_same"),
    [
        (EDGES, 1, True),
        ([[4 + NEAR, 5 + NEAR], [30, 31]], 1, True),
        ([[4 + NEAR + 1, 5 + NEAR + 1], [30, 31]], 1, False),
        ([[4, 5], [30 - NEAR, 31 - NEAR]], 1, True),
        ([[4, 5], [30 - NEAR - 1, 30 - NEAR]], 1, False),
        (EDGES, -1, False),  # there and back are two events
        ([[4, 5], [10, 11]], 1, False),  # the same strand, and not another
    ],
)
def test_a_crossing_near_one_of_the_polyline_is_the_same_event(edges: Any, sign: int, is_same: bool) -> None:
    polyline = passing(EDGES, shape=Shape.POLYLINE)
    assert (own_crossings(passing(edges, sign=sign), polyline, STRANDS) == []) == is_same


def test_vertices_are_near_across_the_closing_edge_of_a_ring_alone() -> None:
    ring, bar = [[19, 0], [30, 31]], [[4, 5], [39, 38]]
    assert own_crossings(passing([[0, 1], [30, 31]]), passing(ring, shape=Shape.POLYLINE), STRANDS) == []
    assert len(own_crossings(passing([[4, 5], [20, 21]]), passing(bar, shape=Shape.POLYLINE), STRANDS)) == 1


def test_one_crossing_of_the_polyline_stands_for_one_of_the_curve() -> None:
    twice = Crossings.joined([passing(EDGES, t=0.25), passing(EDGES, t=0.75)])
    assert len(own_crossings(twice, passing(EDGES, shape=Shape.POLYLINE), STRANDS)) == 1


def test_a_curve_that_passes_alone_is_a_warning_whatever_its_grade() -> None:
    for grade in Grade:
        (alert,) = alerts_of(
            table(
                3,
                curve_crossings=passing(EDGES, step=1, grade=grade),
                curve_verdict=[1, 2, 1],
                curve_n_crossings=[0, 1, 0],
            )
        )
        assert (alert.id, alert.kind, alert.object) == ("crossing-1-curve", AlertKind.CROSSING, Shape.CURVE)
        assert alert.severity is Severity.WARNING
        assert set(alert.strands) == {"ring", "bar"}
        assert grade.name.lower() in alert.message
        assert "the smooth curve of ring passes through that of bar at 4-5 x 30-31" in alert.message


def test_neighbouring_steps_are_one_event_with_its_surest_passage_as_peak() -> None:
    found = [passing(EDGES, step=k, grade=Grade.PROVEN if k == 2 else Grade.RESOLVED) for k in (1, 2, 3, 9)]
    columns = {"curve_verdict": [2 if k in (1, 2, 3, 9) else 1 for k in range(12)]}
    one, other = alerts_of(table(12, curve_crossings=Crossings.joined(found), **columns))
    assert (one.step_start, one.step_peak, one.step_end) == (1, 2, 3)
    assert (other.step_start, other.step_end) == (9, 9)


def test_a_passage_that_the_polyline_has_said_is_not_said_again() -> None:
    both = {"verdict": [2], "n_crossings": [1], "curve_verdict": [2], "curve_n_crossings": [1]}
    (alert,) = alerts_of(table(1, passing(EDGES, shape=Shape.POLYLINE), passing(EDGES), **both))
    assert alert.object is Shape.POLYLINE


@pytest.mark.parametrize(
    ("verdict", "said"), [(Verdict.CERTIFIED, 1), (Verdict.UNRESOLVED, 0), (Verdict.CROSSING, 0)], ids=lambda v: str(v)
)
def test_an_undecided_curve_is_said_where_the_polyline_is_certified(verdict: Verdict, said: int) -> None:
    columns = {
        "verdict": [verdict],
        "reason": [Reason.TOUCH if verdict is Verdict.UNRESOLVED else Reason.NONE],
        "curve_verdict": [CurveVerdict.UNRESOLVED],
        "curve_reason": [Reason.FOLD],
        "curve_clearance_pair": [EDGES],
        "curve_place": [[[0.25, 0.5], [0.0, 1.0], [0.0, 1.0]]],
    }
    alerts = [alert for alert in alerts_of(table(1, **columns)) if alert.object is Shape.CURVE]
    assert len(alerts) == said
    for alert in alerts:
        assert (alert.id, alert.severity) == ("unresolved-0-curve", Severity.WARNING)
        assert (
            "the smooth curve may have a cusp, or fold back on itself (4-5 x 30-31, t = 0.25 to 0.5)" in alert.message
        )


def test_a_run_that_looked_at_no_curve_says_nothing_of_it() -> None:
    assert alerts_of(table(3, curve_verdict=[CurveVerdict.NONE] * 3)) == []
