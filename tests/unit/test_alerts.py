"""Alerts: limits on both sides, merging of neighbouring steps, and an order that no block size changes."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdtopo.alerts import AlertStream, count_steps
from mdtopo.records import (
    Alert,
    AlertKind,
    BrokenEdge,
    Crossings,
    CurveVerdict,
    Gap,
    Grade,
    MonitorConfig,
    Reason,
    Rung,
    Severity,
    StepTable,
    Strands,
    Stretches,
    Verdict,
    VertexLabels,
)

STRANDS = Strands.from_lengths([4, 4], names=["one", "two"])
PAIR = np.array([[0, 1], [4, 5]])


def table(
    n: int,
    *,
    first_step: int = 0,
    stretched: tuple[tuple[int, float], ...] = (),
    crossings: Crossings | None = None,
    **columns: Any,
) -> StepTable:
    """Return n certified steps with nothing near a limit, except for what the columns say."""
    values = {c.name: np.zeros((n, *c.shape), dtype=c.dtype) for c in StepTable.columns()}
    steps = np.arange(first_step, first_step + n)
    values |= {"frame_t0": steps, "frame_t1": steps + 1, "time_t0": 2.0 * steps, "time_t1": 2.0 * steps + 2.0}
    values["verdict"][:] = Verdict.CERTIFIED
    values["curve_verdict"][:] = CurveVerdict.NONE
    values["clearance"][:] = 9.0
    values["pair_ratio_pair"][:] = values["nu_pair"][:] = values["clearance_pair"][:] = PAIR
    values |= {name: np.asarray(column, dtype=values[name].dtype) for name, column in columns.items()}
    stretches = Stretches(
        np.array([step for step, _ in stretched], dtype=np.int64),
        np.array([[1, 2]] * len(stretched), dtype=np.int64).reshape(-1, 2),
        np.array([ratio for _, ratio in stretched]),
        np.full(len(stretched), 1.2),
    )
    broken: tuple[BrokenEdge, ...] = ()
    return StepTable(
        first_step=first_step,
        stretches=stretches,
        broken=broken,
        problems=("",) * n,
        crossings=Crossings.none() if crossings is None else crossings,
        curve_crossings=Crossings.none(),
        **values,  # type: ignore[arg-type]
    )


def passing(step: int, grade: Grade, *, edges: object = PAIR, image: tuple[int, int, int] = (0, 0, 0)) -> Crossings:
    """Return one crossing of a step, in which the edges move 2.5 Å; the resolution length is 1 Å."""
    return Crossings(
        strands=STRANDS,
        step=np.array([step]),
        frame_t0=np.array([step]),
        frame_t1=np.array([step + 1]),
        t=np.array([0.25]),
        edges=np.array([edges]),
        parameters=np.array([[0.5, 0.5]]),
        point=np.zeros((1, 3)),
        sign=np.array([-1]),
        image=np.array([image]),
        grade=np.array([grade], dtype=np.int8),
        object=np.zeros(1, dtype=np.int8),
        motion=np.array([2.5]),
        resolution=np.array([1.0]),
    )


def crossed(*found: Crossings, n: int = 4) -> StepTable:
    joined = Crossings.joined(found)
    verdict = np.where(np.isin(np.arange(n), joined.step), Verdict.CROSSING, Verdict.CERTIFIED)
    return table(n, crossings=joined, verdict=verdict, n_crossings=np.bincount(joined.step, minlength=n))


def alerts_of(*tables: StepTable, config: MonitorConfig | None = None, strands: Strands = STRANDS) -> list[Alert]:
    stream = AlertStream(strands, config or MonitorConfig())
    said = list(stream.opening())
    for one in tables:
        said += stream.after(one)
    return said + list(stream.finish())


@pytest.mark.parametrize(
    ("criterion", "column", "limit", "near", "clear"),
    [
        ("pair", "pair_ratio", 0.8, 0.8, np.nextafter(0.8, 0)),
        ("nu", "nu_ratio", 0.8, 0.8, np.nextafter(0.8, 0)),
        ("clearance", "clearance", 2.0, 2.0, np.nextafter(2.0, 3)),
    ],
)
def test_a_step_is_near_limit_from_the_limit_on(
    criterion: str, column: str, limit: float, near: float, clear: float
) -> None:
    config = MonitorConfig(criterion=criterion, near_limit=limit)  # type: ignore[arg-type]
    (alert,) = alerts_of(table(1, **{column: [near]}), config=config)
    assert (alert.kind, alert.severity, alert.value) == (AlertKind.NEAR_LIMIT, Severity.WARNING, near)
    assert "near the limit (a possible strand passage or fracture between the frames)" in alert.message
    assert alerts_of(table(1, **{column: [clear]}), config=config) == []


def test_neighbouring_steps_are_one_event_with_start_peak_and_end() -> None:
    (alert,) = alerts_of(table(6, pair_ratio=[0, 0.9, 0.95, 0, 0.85, 0]))
    assert (alert.step_start, alert.step_peak, alert.step_end, alert.value) == (1, 2, 4, 0.95)
    assert (alert.frame_start, alert.frame_end, alert.time_start, alert.time_end) == (1, 5, 2.0, 10.0)
    assert alert.strands == ("one", "two")


def test_two_quiet_steps_part_two_events() -> None:
    alerts = alerts_of(table(6, pair_ratio=[0.9, 0, 0, 0.9, 0, 0]))
    assert [a.id for a in alerts] == ["near-limit-0", "near-limit-3"]


def test_the_least_clearance_is_the_peak() -> None:
    config = MonitorConfig(criterion="clearance", near_limit=1.0)
    (alert,) = alerts_of(table(3, clearance=[0.5, 0.2, 0.9]), config=config)
    assert (alert.step_peak, alert.value) == (1, 0.2)


def test_undecided_and_unusable_steps_have_alerts_of_their_own() -> None:
    verdict = [Verdict.UNRESOLVED, Verdict.CERTIFIED, Verdict.CERTIFIED, Verdict.UNRESOLVED]
    reason = [Reason.LADDER, Reason.NONE, Reason.NONE, Reason.BAD_DATA]
    alerts = alerts_of(table(4, verdict=verdict, reason=reason, pair_ratio=[0.7, 0, 0, np.nan]))
    assert [a.kind for a in alerts] == [AlertKind.UNRESOLVED, AlertKind.BAD_DATA]


def test_the_onset_of_a_stretch_is_said_before_the_event_has_ended() -> None:
    stream = AlertStream(STRANDS, MonitorConfig())
    said = list(stream.after(table(3, stretched=((1, 1.25), (2, 1.3)))))
    assert [a.id for a in said] == ["stretch-1-1-2-onset"]
    (ended,) = stream.finish()
    assert (ended.id, ended.value, ended.step_end) == ("stretch-1-1-2", 1.3, 2)


def test_a_gap_is_said_before_the_first_step() -> None:
    strands = Strands(
        STRANDS.offsets, STRANDS.closed, STRANDS.names, STRANDS.labels, gaps=(Gap((3, 4), "7.1 Å apart"),)
    )
    (alert,) = alerts_of(strands=strands)
    assert (alert.kind, alert.severity) == (AlertKind.GAP, Severity.INFO)
    assert "7.1 Å apart" in alert.message


def test_every_alert_is_valid_json_whatever_the_names_and_values() -> None:
    hostile = '<script>"\n{}'
    labels = VertexLabels.unknown(8)
    names = Strands(STRANDS.offsets, STRANDS.closed, (hostile, hostile), labels)
    verdict, reason = [Verdict.UNRESOLVED], [Reason.LADDER]
    times = {"time_t0": [np.nan], "time_t1": [np.nan]}
    alerts = alerts_of(table(1, pair_ratio=[np.inf], verdict=verdict, reason=reason, **times), strands=names)
    assert len(alerts) == 2
    for alert in alerts:
        line = json.dumps(alert.to_mapping(), allow_nan=False)
        assert "\n" not in line
        assert json.loads(line)["strands"] == [hostile, hostile]


STEP = st.tuples(
    st.sampled_from(list(Verdict)), st.sampled_from([Rung.BALL, Rung.HULL, Rung.OPEN]), st.floats(0.0, 1.5)
)


def table_of(steps: list[tuple[Verdict, Rung, float]], first_step: int = 0) -> StepTable:
    verdict, rung, ratio = zip(*steps, strict=True)
    reason = [Reason.LADDER if v is Verdict.UNRESOLVED else Reason.NONE for v in verdict]
    return table(len(steps), first_step=first_step, verdict=verdict, rung=rung, pair_ratio=ratio, reason=reason)


@given(st.lists(STEP, min_size=1, max_size=40))
def test_the_five_counts_always_add_up(steps: list[tuple[Verdict, Rung, float]]) -> None:
    counts = count_steps(table_of(steps), MonitorConfig())
    assert counts.steps == len(steps)
    assert counts.crossed == sum(v is Verdict.CROSSING for v, _, _ in steps)
    assert counts.unresolved == sum(v is Verdict.UNRESOLVED for v, _, _ in steps)


@given(st.lists(STEP, min_size=1, max_size=40), st.integers(1, 7), st.integers(0, 3))
def test_alerts_do_not_depend_on_how_steps_are_cut_into_blocks(
    steps: list[tuple[Verdict, Rung, float]], size: int, merge: int
) -> None:
    config = MonitorConfig(merge_steps=merge)
    blocks = [table_of(steps[k : k + size], k) for k in range(0, len(steps), size)]
    whole = alerts_of(table_of(steps), config=config)
    assert alerts_of(*blocks, config=config) == whole
    assert len({alert.id for alert in whole}) == len(whole)


# --- crossings and image jumps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("grade", "severity", "words"),
    [
        (Grade.PROVEN, Severity.CRITICAL, "proven: the linking number changes between the frames"),
        (Grade.RESOLVED, Severity.CRITICAL, "less than the resolution length 1 Å"),
        (Grade.UNDERSAMPLED, Severity.WARNING, "it may be a detour; frames every 0.8 ps would tell"),
    ],
)
def test_a_crossing_is_an_alert_that_says_its_grade(grade: Grade, severity: Severity, words: str) -> None:
    (alert,) = alerts_of(crossed(passing(2, grade)))
    assert (alert.kind, alert.severity, alert.id) == (AlertKind.CROSSING, severity, "crossing-2-0-4")
    assert (alert.step_start, alert.step_end, alert.value, alert.limit) == (2, 2, 2.5, 1.0)
    assert alert.strands == ("one", "two")
    assert "one passes through two at" in alert.message
    assert "t = 0.25 of the step, sign -1" in alert.message
    assert words in alert.message


def test_a_proven_self_crossing_speaks_of_the_knot_and_one_with_an_image_of_the_link() -> None:
    own = np.array([[0, 1], [2, 3]])
    (knotted,) = alerts_of(crossed(passing(1, Grade.PROVEN, edges=own)))
    (linked,) = alerts_of(crossed(passing(1, Grade.PROVEN, edges=own, image=(1, 0, 0))))
    assert "one passes through itself" in knotted.message
    assert "the knot determinant changes" in knotted.message
    assert "the linking number changes" in linked.message


def test_every_crossing_is_an_alert_of_its_own() -> None:
    pair = passing(1, Grade.RESOLVED)
    alerts = alerts_of(crossed(pair, pair, passing(2, Grade.RESOLVED)))
    assert [alert.id for alert in alerts] == ["crossing-1-0-4", "crossing-1-0-4-1", "crossing-2-0-4"]


def test_repaired_image_jumps_are_one_piece_of_information() -> None:
    (alert,) = alerts_of(table(5, image_jumps=[0, 1, 3, 0, 0]))
    assert (alert.kind, alert.severity) == (AlertKind.IMAGE_JUMP, Severity.INFO)
    assert (alert.step_start, alert.step_peak, alert.step_end, alert.value) == (1, 2, 2, 3.0)


def test_a_jump_that_nobody_can_repair_is_a_warning() -> None:
    one = table(1, verdict=[Verdict.UNRESOLVED], reason=[Reason.IMAGE_JUMP])
    (alert,) = alerts_of(one)
    assert (alert.kind, alert.severity, alert.id) == (AlertKind.IMAGE_JUMP, Severity.WARNING, "image-jump-0-lost")


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        (Reason.TOUCH, "two edges touch, and neither passes"),
        (Reason.VERTEX, "two edges meet at a vertex"),
        (Reason.SLIDING, "stay in one plane"),
        (Reason.FRAME, "touch in one of the two frames"),
        (Reason.LADDER, "no rung settles 1 pair of edges"),
        (Reason.CELL, "the periodic cell changes too much"),
    ],
)
def test_an_undecided_step_says_why(reason: Reason, words: str) -> None:
    rungs = np.zeros((1, len(Rung)))
    rungs[0, Rung.OPEN] = 1
    (alert,) = alerts_of(table(1, verdict=[Verdict.UNRESOLVED], reason=[reason], rung_pairs=rungs))
    assert alert.kind is AlertKind.UNRESOLVED
    assert words in alert.message
