"""Alerts under another threshold, against a run with that threshold."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mdtopo
from mdtopo import rethresholding
from mdtopo.alerts import AlertStream
from mdtopo.records import (
    Alert,
    AlertKind,
    BrokenEdge,
    Crossings,
    Gap,
    Grade,
    MonitorConfig,
    Reason,
    StepTable,
    Strands,
    Stretches,
    Verdict,
)
from mdtopo.rethresholding import needed_columns, rethresholded
from mdtopo.store import Results, read_results

ROOT = Path(__file__).parents[2]
STRANDS = replace(Strands.from_lengths([4, 4], names=["one", "two"]), gaps=(Gap((3, 4), "why"), Gap((2, 3), "so")))


def random_table(seed: int, n: int) -> StepTable:
    """Steps of every kind, quiet ones between them; values lie on a grid, so that some meet a limit exactly."""
    random = np.random.default_rng(seed)
    values: dict[str, Any] = {c.name: np.zeros((n, *c.shape), dtype=c.dtype) for c in StepTable.columns()}
    steps = np.arange(n)
    values |= {"frame_t0": 3 * steps, "frame_t1": 3 * steps + 3, "time_t0": 0.5 * steps, "time_t1": 0.5 * steps + 0.5}
    for name in ("pair_ratio", "nu_ratio", "clearance"):
        values[name] = random.choice([0.25, 0.5, 0.75, 1.0, np.inf, np.nan], size=n)
        pairs = {"pair_ratio": "pair_ratio_pair", "nu_ratio": "nu_pair", "clearance": "clearance_pair"}
        values[pairs[name]] = random.choice([-1, 0], size=(n, 1, 1)) + np.zeros((n, 2, 2), dtype=np.int64)
        values[pairs[name]][random.random(n) < 0.5] = [[0, 1], [4, 5]]
    values["verdict"] = random.choice([int(v) for v in Verdict], size=n).astype(np.int8)
    values["reason"] = random.choice([int(Reason.LADDER), int(Reason.BAD_DATA), int(Reason.TOUCH)], n).astype(np.int8)
    values["image_jumps"] = random.choice([0, 0, 2], size=n)
    crossed = np.flatnonzero(values["verdict"] == Verdict.CROSSING)
    stretched = np.flatnonzero(random.random(n) < 0.3)
    m = len(crossed)
    crossings = Crossings(
        STRANDS, crossed, crossed, crossed + 1, np.full(m, 0.5), np.tile([[0, 1], [4, 5]], (m, 1, 1)),
        np.full((m, 2), 0.5), np.zeros((m, 3)), np.ones(m, dtype=np.int64), np.zeros((m, 3), dtype=np.int64),
        random.choice([int(g) for g in Grade], m).astype(np.int8), np.zeros(m, dtype=np.int8), np.ones(m), np.ones(m),
    )  # fmt: skip
    return StepTable(
        first_step=0,
        stretches=Stretches(
            stretched, np.tile([1, 2], (len(stretched), 1)), np.full(len(stretched), 1.3), np.full(len(stretched), 1.2)
        ),
        broken=(BrokenEdge(n // 2, n // 2 + 1, (2, 3), 1.7, 1.5),),
        problems=("a reason",) * n,
        crossings=crossings,
        curve_crossings=Crossings.none(),
        **values,
    )


def alerts_of(table: StepTable, config: MonitorConfig) -> list[Alert]:
    stream = AlertStream(STRANDS, config)
    return [*stream.opening(), *stream.after(table), *stream.finish()]


def stored(table: StepTable, config: MonitorConfig) -> Results:
    columns = {name: getattr(table, name) for name in needed_columns(config)}
    return Results(
        schema=1, complete=True, config=config.to_mapping(), request={}, provenance={}, summary={},
        first_step=table.first_step, steps=columns, crossings=table.crossings, alerts=tuple(alerts_of(table, config)),
        strands=STRANDS, reference=None, broken=table.broken,
    )  # fmt: skip


def lines(alerts: list[Alert] | tuple[Alert, ...]) -> list[dict[str, Any]]:
    return [alert.to_mapping() for alert in alerts]


LIMITS = {"pair": (0.25, 0.6, 1.0), "nu": (0.25, 0.6, 1.0, 7.0), "clearance": (0.0, 0.25, 0.6, 1.0, 7.0)}
"""Those that a configuration allows, some of them values of the table."""

CONFIGS = st.builds(
    lambda limit, merge_steps: MonitorConfig(criterion=limit[0], near_limit=limit[1], merge_steps=merge_steps),
    st.sampled_from([(criterion, limit) for criterion, limits in LIMITS.items() for limit in limits]),
    st.integers(0, 2),
)


@given(seed=st.integers(0, 2**31), n=st.integers(1, 25), config=CONFIGS, rows=st.integers(1, 30))
def test_with_the_stored_threshold_the_alerts_are_the_stored_ones(
    seed: int, n: int, config: MonitorConfig, rows: int
) -> None:
    results = stored(random_table(seed, n), config)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rethresholding, "BLOCK_ROWS", rows)
        assert lines(rethresholded(results, config)) == lines(results.alerts)


@given(seed=st.integers(0, 2**31), n=st.integers(1, 25), config=CONFIGS, other=CONFIGS)
def test_with_another_threshold_they_are_those_of_a_run_with_it(
    seed: int, n: int, config: MonitorConfig, other: MonitorConfig
) -> None:
    table = random_table(seed, n)
    wanted = replace(config, criterion=other.criterion, near_limit=other.near_limit)
    results = replace(stored(table, config), steps={name: getattr(table, name) for name in needed_columns(wanted)})
    assert lines(rethresholded(results, wanted)) == lines(alerts_of(table, wanted))


def test_the_limit_itself_is_near_and_its_neighbour_is_not() -> None:
    table = random_table(0, 1)
    values = replace(table, pair_ratio=np.array([0.75]), verdict=np.array([Verdict.CERTIFIED], dtype=np.int8))
    for limit, found in ((0.75, 1), (np.nextafter(0.75, 1), 0)):
        config = MonitorConfig(near_limit=float(limit))
        alerts = rethresholded(stored(values, MonitorConfig()), config)
        assert sum(alert.kind is AlertKind.NEAR_LIMIT for alert in alerts) == found


@pytest.mark.parametrize("change", [{}, {"near_limit": 0.05}, {"criterion": "nu", "near_limit": 0.15}])
def test_real_results_under_a_threshold_equal_a_run_under_it(tmp_path: Path, change: dict[str, Any]) -> None:
    data = ROOT.parent / "shared" / "data" / "fracture"
    if not data.is_dir():
        pytest.skip(f"the trajectories of shared/data are not beside the repository: {data} is missing")
    inputs, frames, config = (data / "duplex.data", data / "dup_pull.dcd"), slice(320, 420), MonitorConfig(motion="lab")
    mdtopo.monitor(*inputs, out=tmp_path / "a.h5", frames=frames, config=config)
    mdtopo.monitor(*inputs, out=tmp_path / "b.h5", frames=frames, config=replace(config, **change))
    wanted = MonitorConfig.from_mapping(read_results(tmp_path / "b.h5").config)
    again = lines(rethresholded(read_results(tmp_path / "a.h5"), wanted))
    assert again == lines(read_results(tmp_path / "b.h5").alerts)
    assert {alert["kind"] for alert in again} >= {"fracture", "stretch"}
    assert ("near-limit" in {alert["kind"] for alert in again}) == bool(change)
