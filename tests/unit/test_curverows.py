"""The smooth curve beside the polyline in a run: verdicts, crossings, counts, and that neither disturbs the other."""

from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

import cases
import numpy as np
import pytest
from numpy.typing import NDArray

import mdtopo
from mdtopo import MonitorConfig, RunSummary, Strands, Verdict, curve_step, spline_curve
from mdtopo.alerts import AlertStream
from mdtopo.curveblocks import Segments
from mdtopo.errors import StrandError
from mdtopo.pipeline.tables import step_tables
from mdtopo.readers.arrays import ArraysReader
from mdtopo.readers.base import ReaderRequest, Source
from mdtopo.records import AlertKind, CurveChoice, CurveVerdict, Grade, Reason, Rung, Severity, Shape, StepTable, Traces
from mdtopo.store import Results, read_results

T9 = cases.curve_cases()["T9"]
KINDS = tuple(kind for kind in get_args(CurveChoice) if kind != "none")
Positions = NDArray[np.float64]


def job(
    folder: Path, frames: Positions, strands: Strands, cells: Any = None, **knobs: Any
) -> tuple[RunSummary, Results]:
    """Return summary and results of a run in the lab frame over frames in a file."""
    path, out = folder / "in.npz", folder / "run.h5"
    extra = {} if cells is None else {"cell": cells}
    np.savez(path, positions=frames, offsets=strands.offsets, closed=strands.closed, **extra)
    config = MonitorConfig(**{"motion": "lab", **knobs})
    summary = mdtopo.monitor(path, out=out, config=config, overwrite=True)
    return summary, read_results(out)


def t9_frames() -> tuple[Positions, Strands]:
    """Return the control polygon of T9 in two frames; the ring's last point is its first."""
    return np.stack([p[:-1] for p in T9.floats]), Strands.from_lengths([6], closed=True)


def loose_rings(seed: int, n_frames: int = 12) -> tuple[Positions, Strands]:
    """Return two rings and an open strand that jiggle and pass through each other now and then."""
    random = np.random.default_rng(seed)
    angle = np.arange(12) * np.pi / 6
    ring = 3.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    other = ring[:, [0, 2, 1]] + [3.0, 0.0, 0.0]
    bar = np.linspace([-4.0, 1.0, 0.4], [4.0, 1.0, 0.6], 9)
    x = np.concatenate([ring, other, bar])
    steps = random.normal(scale=0.25, size=(n_frames, *x.shape))
    return x + np.cumsum(steps, axis=0), Strands.from_lengths([12, 12, 9], closed=[True, True, False])


# --- hand values and exact cases --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_two_bars_pass_half_way_as_curves_too(tmp_path: Path, kind: str) -> None:
    bars = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 1], [0, 1, 1]], dtype=float)
    frames = np.stack([bars, bars - [[0, 0, 0], [0, 0, 0], [0, 0, 2], [0, 0, 2]]])
    summary, results = job(tmp_path, frames, Strands.from_lengths([2, 2]), curve=kind)
    (polyline,), (curve,) = results.crossings, results.curve_crossings
    assert (curve.object, polyline.object) == (Shape.CURVE, Shape.POLYLINE)
    assert (curve.t, curve.sign, curve.grade) == (pytest.approx(0.5, abs=1e-12), polyline.sign, polyline.grade)
    np.testing.assert_allclose(curve.parameters, [0.5, 0.5], atol=1e-12)
    np.testing.assert_allclose(curve.point, polyline.point, atol=1e-12)
    assert curve.edges.tolist() == [[0, 1], [2, 3]]
    assert summary.curve is not None
    assert (summary.curve.crossed, summary.counts.crossed) == (1, 1)
    assert results.steps["n_crossings"].tolist() == results.steps["curve_n_crossings"].tolist() == [1]
    said = [alert.object for alert in results.alerts if alert.kind is AlertKind.CROSSING]
    assert said == [Shape.POLYLINE]  # one event, one alert


def test_the_curve_passes_while_its_polygon_is_certified(tmp_path: Path) -> None:
    frames, ring = t9_frames()
    summary, results = job(tmp_path, frames, ring, curve="bezier")
    assert summary.verdict is mdtopo.RunVerdict.WARN
    assert (summary.counts.crossed, summary.counts.unresolved, sum(summary.crossings.values())) == (0, 0, 0)
    assert results.steps["verdict"].tolist() == [Verdict.CERTIFIED]
    assert results.steps["curve_verdict"].tolist() == [CurveVerdict.CROSSING]
    (crossing,), passage = results.curve_crossings, T9.expect["passage"]
    assert crossing.t == pytest.approx(passage["t"], abs=5e-8 / 22)
    # of one curve of degree 6, the parameter is told by equal shares of the six edges
    along = [6 * float(passage["u"]), 6 * float(passage["v"])]
    assert crossing.edges[:, 0].tolist() == [int(u) for u in along]
    np.testing.assert_allclose(crossing.parameters, [u % 1.0 for u in along], atol=1e-7)
    (alert,) = results.alerts
    assert (alert.kind, alert.severity, alert.object) == (AlertKind.CROSSING, Severity.WARNING, Shape.CURVE)
    assert alert.id == "crossing-0-curve"
    assert "the smooth curve of" in alert.message


def test_the_paper_s_comparison_as_printed_and_in_its_sound_form(tmp_path: Path) -> None:
    frames = np.stack([np.column_stack([p, np.zeros(4)]) for p in cases.curve_cases()["T3"].floats])
    _, results = job(tmp_path, frames, Strands.from_lengths([4]), curve="bezier")
    row = {name: column[0] for name, column in results.steps.items()}
    assert row["curve_d_star"] == pytest.approx(1.0, rel=1e-12)
    assert row["curve_printed_ratio"] == pytest.approx(0.75, rel=1e-12)  # below 1, though the moved curve meets itself
    assert row["curve_bezier_ratio"] == pytest.approx(1.5, rel=1e-12)
    assert row["curve_bezier_margin"] == pytest.approx(-0.5, rel=1e-12)
    assert row["curve_d_star_segment"].tolist() == [0, 3]
    assert row["curve_verdict"] == CurveVerdict.UNRESOLVED
    # in a plane the strand's polygon touches itself too, so that one alert says it
    assert row["verdict"] == Verdict.UNRESOLVED or any(a.object is Shape.CURVE for a in results.alerts)


@pytest.mark.parametrize("kind", ["interpolating", "bspline", "catmull-rom", "bezier"])
def test_the_columns_are_those_of_curve_step(tmp_path: Path, kind: Any) -> None:
    frames, strands = loose_rings(3)
    _, results = job(tmp_path, frames, strands, curve=kind)
    for k, (x0, x1) in enumerate(pairwise(frames)):
        report = curve_step(spline_curve(x0, strands, kind), spline_curve(x1, strands, kind))
        row = {name: column[k] for name, column in results.steps.items()}
        assert row["curve_verdict"] == report.verdict
        assert (row["curve_depth"], row["curve_rung"]) == (report.depth, report.rung)
        found = results.curve_crossings.of_step(k)
        assert [c.t for c in found] == pytest.approx([c.t for c in report.crossings], abs=1e-9)
        assert sorted(c.sign for c in found) == sorted(c.sign for c in report.crossings)
        assert {c.grade for c in found if c.grade is Grade.PROVEN} == {
            c.grade for c in report.crossings if c.grade is Grade.PROVEN
        }
        if kind != "bezier":  # of which parts of a ring are measured here, and the whole there
            numbers = ("d_star", "bezier_ratio", "bezier_margin", "printed_ratio", "clearance")
            for name in numbers:
                assert row[f"curve_{name}"] == pytest.approx(getattr(report, name), rel=1e-9), name
            assert row["curve_d_star_segment"].tolist() == strands.edges[report.d_star_segment].tolist()
    verdicts = set(results.steps["curve_verdict"].tolist())
    assert CurveVerdict.CERTIFIED in verdicts
    assert CurveVerdict.CROSSING in verdicts or kind in ("bspline", "bezier")  # these cut corners


@pytest.mark.parametrize("seed", [1, 2, 11])
def test_proven_is_said_where_the_linking_number_of_the_curves_changes(tmp_path: Path, seed: int) -> None:
    frames, strands = loose_rings(seed, 30)
    _, results = job(tmp_path, frames, strands)
    places = np.arange(24) / 24

    def linking(x: Positions) -> int:
        one, other = (spline_curve(x, strands).points(places)[k : k + 12].reshape(-1, 3) for k in (0, 12))
        return mdtopo.linking_number(one, other)

    changes = 0
    for k, (before, after) in enumerate(pairwise(map(linking, frames))):
        between = [c for c in results.curve_crossings.of_step(k) if c.strands == ("strand 0", "strand 1")]
        if results.steps["curve_verdict"][k] != CurveVerdict.UNRESOLVED:
            assert sum(c.sign for c in between) == after - before
            assert {c.grade is Grade.PROVEN for c in between} <= {after != before}
            changes += after != before
    assert changes


# --- invariance -------------------------------------------------------------------------------------------------------


def columns_of(table: StepTable) -> dict[str, bytes]:
    lists = {name: getattr(table, name) for name in ("crossings", "curve_crossings")}
    values = {f"{name}.{c}": getattr(rows, c).tobytes() for name, rows in lists.items() for c in rows.column_names()}
    return values | {column.name: getattr(table, column.name).tobytes() for column in StepTable.columns()}


def table_of(frames: Positions, strands: Strands, threads: int, **knobs: Any) -> StepTable:
    with ArraysReader.open(Source(object=frames), ReaderRequest(strands=strands)) as reader:
        return StepTable.joined(list(step_tables(reader, config=MonitorConfig(**knobs), threads=threads)))


@pytest.mark.parametrize("motion", ["rigid", "lab"])
def test_blocks_and_threads_leave_no_mark(motion: str) -> None:
    frames, strands = loose_rings(5, 40)
    expected = columns_of(table_of(frames, strands, 1, motion=motion))
    for block_steps, threads in [(1, 2), (7, 1), (64, 3)]:
        assert columns_of(table_of(frames, strands, threads, motion=motion, block_steps=block_steps)) == expected


def test_without_the_curve_the_polyline_s_columns_are_the_same_bit_for_bit() -> None:
    frames, strands = loose_rings(6, 40)
    frames[20, 3] = np.nan
    with_curve, without = (columns_of(table_of(frames, strands, 1, curve=kind)) for kind in ("interpolating", "none"))
    for name in with_curve:
        if not name.startswith("curve_"):
            assert with_curve[name] == without[name], name


def test_of_a_curve_that_was_not_looked_at_nothing_is_said() -> None:
    frames, strands = loose_rings(6)
    table = table_of(frames, strands, 1, curve="none")
    assert set(table.curve_verdict.tolist()) == {CurveVerdict.NONE}
    assert set(table.curve_rung.tolist()) == {Rung.OPEN}
    assert not len(table.curve_crossings)
    for column in StepTable.columns():
        if column.name.startswith("curve_") and column.enum is None and column.name != "curve_n_crossings":
            values = getattr(table, column.name)
            assert (np.isnan(values) if column.dtype is np.float64 else values == -1).all(), column.name
    alerts = list(AlertStream(strands, MonitorConfig(curve="none")).after(table))
    assert not [alert for alert in alerts if alert.object is Shape.CURVE]


@pytest.mark.parametrize("kind", KINDS)
def test_a_rotation_that_all_strands_share_is_taken_out(kind: str) -> None:
    frames, strands = loose_rings(7, 4)
    turned = frames.copy()
    for k, angle in enumerate([0.0, 0.7, 2.9, 4.0]):
        c, s = np.cos(angle), np.sin(angle)
        turned[k] = frames[k] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T + [5.0 * k, 0.0, 1.0]
    one, other = (table_of(x, strands, 1, curve=kind) for x in (frames, turned))
    np.testing.assert_array_equal(one.curve_verdict, other.curve_verdict)
    np.testing.assert_allclose(one.curve_bezier_ratio, other.curve_bezier_ratio, rtol=1e-6)
    np.testing.assert_allclose(one.curve_crossings.t, other.curve_crossings.t, atol=1e-6)


def test_images_are_seen_and_named_as_the_polyline_s_are(tmp_path: Path) -> None:
    # two bars at either side of the box, which meet through the boundary
    bars = np.array([[1, 5, 9], [5, 5, 9], [3, 3, 1], [3, 7, 1]], dtype=float)
    frames = np.stack([bars, bars + np.array([[0, 0, 3], [0, 0, 3], [0, 0, 0], [0, 0, 0]])])
    frames[1, :2, 2] -= 10.0  # stored back in the box
    cells = np.stack([10.0 * np.eye(3)] * 2)
    _, results = job(tmp_path, frames, Strands.from_lengths([2, 2]), cells)
    (polyline,), (curve,) = results.crossings, results.curve_crossings
    assert curve.image.tolist() == polyline.image.tolist() == [0, 0, 1]
    np.testing.assert_allclose(curve.point, polyline.point, atol=1e-9)
    assert curve.t == pytest.approx(polyline.t, abs=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 7, 10, 13])
def test_in_a_box_the_curve_passes_where_explicit_images_of_it_do(tmp_path: Path, seed: int) -> None:
    random, cell = np.random.default_rng(seed), np.array([[7.0, 0, 0], [1.5, 7.0, 0], [-1.0, 2.0, 7.0]])
    angle = np.arange(6) * np.pi / 3
    ring = 2.5 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    bars = [np.linspace([-3, 0, 0], [3, 0, 0], 4) @ np.linalg.qr(random.normal(size=(3, 3)))[0] for _ in range(2)]
    places = random.uniform(0, 7, size=(3, 3))
    start = np.concatenate([part + place for part, place in zip([ring, *bars], places, strict=True)])
    shift = np.repeat(random.uniform(-1.6, 1.6, size=(3, 3)), [6, 4, 4], axis=0)
    end = start + shift + random.normal(scale=0.4, size=start.shape)
    strands = Strands.from_lengths([6, 4, 4], closed=[True, False, False])
    stored = [x - np.floor(x @ np.linalg.inv(cell)) @ cell for x in (start, end)]  # atom by atom
    _, results = job(tmp_path, np.stack(stored), strands, np.stack([cell] * 2))
    images = np.array([(a, b, c) for a in (0, -1, 1) for b in (0, -1, 1) for c in (0, -1, 1)])  # home comes first
    many = Strands.from_lengths([6, 4, 4] * 27, closed=[True, False, False] * 27)
    ends = [spline_curve(np.concatenate([x + image @ cell for image in images]), many) for x in (start, end)]
    report = curve_step(*ends)
    # one of the 12 segments at home takes part; seen from the other one it is the same passage again
    expected = {(round(c.t, 7), c.sign) for c in report.crossings if min(c.segments) < 12}
    found = [(round(c.t, 7), c.sign) for c in results.curve_crossings]
    assert report.n_open == 0
    assert sorted(found) == sorted(expected)
    assert (results.steps["curve_verdict"][0] == CurveVerdict.CERTIFIED) == (not found)


# --- broken edges, and what cannot be measured ------------------------------------------------------------------------


def test_the_curve_ends_where_an_edge_is_broken(tmp_path: Path) -> None:
    chain = np.stack([np.arange(8.0), np.zeros(8), np.zeros(8)], axis=1)
    frames = np.repeat(chain[None], 14, axis=0)
    frames[4:, 4:, 0] += 5.0
    # later a bar passes through the gap, where the curve is not any more
    bar = np.array([[5.0, -1.0, 1.0], [5.0, 1.0, 1.0]])
    rows = np.repeat(bar[None], 14, axis=0)
    rows[12:, :, 2] = -1.0
    both = np.concatenate([frames, rows], axis=1)
    _, results = job(tmp_path, both, Strands.from_lengths([8, 2]), reference_frames=4)
    assert [edge.edge for edge in results.broken] == [(3, 4)]
    assert results.steps["curve_verdict"][11] == CurveVerdict.CERTIFIED
    assert results.steps["verdict"][11] == Verdict.CERTIFIED


def test_a_step_without_data_has_the_reason_of_the_polyline(tmp_path: Path) -> None:
    frames, strands = loose_rings(8, 5)
    frames[2, 0] = np.nan
    _, results = job(tmp_path, frames, strands)
    for row in (1, 2):
        assert results.steps["curve_verdict"][row] == CurveVerdict.UNRESOLVED
        assert results.steps["curve_reason"][row] == results.steps["reason"][row] == Reason.BAD_DATA
        assert np.isnan(results.steps["curve_clearance"][row])
    assert not [alert for alert in results.alerts if alert.object is Shape.CURVE and alert.step_start in (1, 2)]


@pytest.mark.parametrize("kind", KINDS)
def test_coincident_vertices_are_undecided_or_certified_never_an_error(tmp_path: Path, kind: str) -> None:
    chain = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    chain[3] = chain[2]
    _, results = job(
        tmp_path, np.stack([chain, chain + np.array([0.0, 0.1, 0.0])]), Strands.from_lengths([6]), curve=kind
    )
    if kind == "catmull-rom":  # its segment between the two runs out and back to the same point
        assert results.steps["curve_verdict"][0] == CurveVerdict.UNRESOLVED
        assert results.steps["curve_reason"][0] == Reason.FOLD
    assert results.steps["curve_verdict"][0] != CurveVerdict.CROSSING


def test_a_fold_is_said_with_its_place(tmp_path: Path) -> None:
    hairpin = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0.0], [0, 0, 0]])
    start = hairpin + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 1, 0]])
    summary, results = job(tmp_path, np.stack([start, start, hairpin]), Strands.from_lengths([5]))
    assert results.steps["curve_verdict"].tolist() == [CurveVerdict.CERTIFIED, CurveVerdict.UNRESOLVED]
    assert results.steps["curve_reason"][1] in (Reason.FOLD, Reason.LADDER)
    assert np.isfinite(results.steps["curve_place"][1]).all()
    assert results.steps["curve_place"][1, 0, 1] > 0.999  # near the end of the step
    assert summary.curve is not None
    assert summary.curve.unresolved == 1


def test_strands_too_short_or_too_long_for_their_curve(tmp_path: Path) -> None:
    pair = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 2], [1, 0, 2], [0.5, 1, 2]], dtype=float)
    strands = Strands.from_lengths([2, 3], closed=[False, True])
    for kind in KINDS:
        summary, _ = job(tmp_path, np.stack([pair, pair + 0.01]), strands, curve=kind)
        assert summary.curve is not None
        assert summary.curve.certified == 1, kind
    long = np.zeros((2, 202, 3))
    long[:, :, 0] = np.arange(202)
    with pytest.raises(
        StrandError, match=r"'strand 0' has 202 vertices; one Bezier curve on its vertices can have the"
    ):
        mdtopo.monitor(long, strands=Strands.from_lengths([202]), config=MonitorConfig(curve="bezier"))
    job(tmp_path, long[:, :201], Strands.from_lengths([201]), curve="interpolating")
    with pytest.raises(StrandError, match="a strand that is closed needs at least 3"):
        Strands.from_lengths([2], closed=True)


def test_single_segments_say_where_they_are() -> None:
    segments = Segments.of(Traces.of(Strands.from_lengths([6, 4], closed=[True, False])), "bezier")
    assert segments.degree == 6
    assert segments.following.tolist() == [1, 2, 3, 0, -1]
    assert segments.place(0, 0.0) == (0, 0.0)
    assert segments.place(1, 0.5) == (2, 0.25)
    assert segments.place(3, 1.0) == (5, 1.0)
    assert segments.place(4, 1.0) == (8, 1.0)
    assert segments.place(4, 0.5) == (7, 0.5)


def test_another_curve_is_another_run(tmp_path: Path) -> None:
    frames, strands = loose_rings(9, 4)
    job(tmp_path, frames, strands)
    path = tmp_path / "in.npz"
    with pytest.raises(mdtopo.errors.OutputError, match="exists already"):
        mdtopo.monitor(path, out=tmp_path / "run.h5", config=MonitorConfig(motion="lab", curve="bspline"))


# --- real runs --------------------------------------------------------------------------------------------------------

UNCROSSABLE = {
    "kg": ("kg/kg_linear.data", "kg/kg_linear_fine_wrapped.xtc"),
    "rings": ("kg/kg_rings.data", "kg/kg_rings_fine.dcd"),
    "gmx": ("gmx/ca.gro", "gmx/ca_wrapped.xtc"),
}


@pytest.mark.parametrize("name", UNCROSSABLE)
def test_where_nothing_can_pass_the_curve_does_not(shared_data: Path, name: str) -> None:
    inputs = [shared_data / part for part in UNCROSSABLE[name]]
    summary = mdtopo.monitor(*inputs, frames=slice(0, 121))
    assert summary.curve is not None
    assert (summary.curve.certified, summary.curve.unresolved, summary.curve.crossed) == (120, 0, 0)
    assert summary.curve.flat == 120


def test_where_chains_cross_the_curve_does_nearby(shared_data: Path, tmp_path: Path) -> None:
    inputs = [shared_data / part for part in ("soft/soft.data", "soft/soft_fine.dcd")]
    summary = mdtopo.monitor(*inputs, frames=slice(0, 61), out=tmp_path / "run.h5")
    assert summary.curve is not None
    assert summary.curve.unresolved == 0
    results = read_results(tmp_path / "run.h5")
    assert len(results.crossings) == sum(summary.crossings.values())
    # between different chains, the curve makes up for what the polyline does, within a few steps and vertices
    between = [c for c in results.crossings if c.strands[0] != c.strands[1] and 5 <= c.step < 55]
    assert len(between) > 10
    found = 0
    for crossing in between:
        near = [
            c
            for c in results.curve_crossings
            if abs(c.step - crossing.step) <= 5 and np.abs(c.edges[:, 0] - crossing.edges[:, 0]).max() <= 3
        ]
        found += any(c.sign == crossing.sign for c in near)
    assert found >= 0.75 * len(between)
