"""The referee's look at the smooth curve of a run: what is right agrees, and what was touched is found."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

import mdtopo
from mdtopo import MonitorConfig, Strands, spline_curve
from mdtopo.records import CurveVerdict
from mdtopo.referee.curves import spline_of
from mdtopo.verification import Sampling, verify

EVERY = Sampling(nearest=1000)
Positions = NDArray[np.float64]


def rings(seed: int, n_frames: int = 9) -> tuple[Positions, Strands]:
    """Return two rings and an open strand that jiggle through each other."""
    random = np.random.default_rng(seed)
    angle = np.arange(9) * 2 * np.pi / 9
    ring = 3.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    x = np.concatenate([ring, ring[:, [0, 2, 1]] + [3.0, 0, 0], np.linspace([-4, 1, 0.4], [4, 1, 0.6], 7)])
    frames = x + np.cumsum(random.normal(scale=0.3, size=(n_frames, *x.shape)), axis=0)
    return frames, Strands.from_lengths([9, 9, 7], closed=[True, True, False])


def run(folder: Path, frames: Positions, strands: Strands, cell: Any = None, **knobs: Any) -> Path:
    extra = {} if cell is None else {"cell": np.stack([cell] * len(frames))}
    np.savez(folder / "in.npz", positions=frames, offsets=strands.offsets, closed=strands.closed, **extra)
    mdtopo.monitor(folder / "in.npz", out=folder / "run.h5", config=MonitorConfig(**knobs))
    return folder / "run.h5"


@pytest.mark.parametrize("kind", ["interpolating", "bspline", "catmull-rom", "bezier"])
@pytest.mark.parametrize(("n", "closed"), [(2, False), (3, False), (3, True), (8, False), (8, True)])
def test_scipy_s_splines_are_those_of_the_job(kind: Any, n: int, closed: bool) -> None:
    x = np.random.default_rng(n).normal(size=(n, 3))
    curve, spline = spline_curve(x, Strands.from_lengths([n], closed=closed), kind), spline_of(x, closed, kind)
    u, edges = np.linspace(0.0, 1.0, 7), n if closed else n - 1
    if kind == "bezier":
        np.testing.assert_allclose(spline(edges * u), curve.points(u)[0], atol=1e-12)
    else:
        np.testing.assert_allclose(spline(np.arange(edges)[:, None] + u), curve.points(u), atol=1e-12)


@pytest.mark.parametrize("kind", ["interpolating", "bspline", "catmull-rom", "bezier"])
@pytest.mark.parametrize(
    ("motion", "cell"), [("rigid", None), ("lab", np.diag([9.0, 10.0, 11.0]))], ids=["free", "cell"]
)
def test_what_the_job_writes_agrees(tmp_path: Path, kind: str, motion: str, cell: Any) -> None:
    frames, strands = rings(2, 9 if cell is None else 4)
    if cell is not None:
        frames = frames % np.diag(cell)
    path = run(tmp_path, frames, strands, cell, curve=kind, motion=motion)
    found = mdtopo.read_results(path)
    if kind in ("interpolating", "catmull-rom"):
        assert len(found.curve_crossings)
    assert verify(path, sampling=EVERY).agrees, verify(path, sampling=EVERY)


@pytest.mark.parametrize("column", ["t", "parameters", "sign", "image"])
def test_a_crossing_that_was_touched_is_found(tmp_path: Path, column: str) -> None:
    frames, strands = rings(2, 4)
    path = run(tmp_path, frames % 10.0, strands, 10.0 * np.eye(3), motion="lab")
    with h5py.File(path, "a") as file:
        row = int(np.flatnonzero(file["crossings/object"][()].view(np.int8) == 1)[0])
        values = file[f"crossings/{column}"]
        values[row] = -values[row] if column == "sign" else values[row] + (1 if column == "image" else 1e-3)
    (said,) = [text for check in verify(path, sampling=EVERY).checks for text in check.differences]
    assert ("sign" if column == "sign" else "Å apart by the referee") in said


def test_clearances_and_verdicts_that_were_touched_are_found(tmp_path: Path) -> None:
    frames, strands = rings(2)
    path = run(tmp_path, frames, strands)
    with h5py.File(path, "a") as file:
        verdict, clearance = file["steps/curve_verdict"], file["steps/curve_clearance"]
        certified, crossed = (
            int(np.flatnonzero(verdict[()].view(np.int8) == v)[0])
            for v in (CurveVerdict.CERTIFIED, CurveVerdict.CROSSING)
        )
        clearance[certified] = clearance[certified] + 0.5
        verdict[crossed] = CurveVerdict.CERTIFIED
    said = {check.step: check.differences for check in verify(path, sampling=EVERY).checks if check.differences}
    assert set(said) == {certified, crossed}
    assert "but such segments come within" in said[certified][0]
    assert "the curve is CERTIFIED, and the file lists" in said[crossed][0]


def test_steps_in_which_the_curve_alone_passes_are_among_the_sample(tmp_path: Path) -> None:
    frames, strands = rings(2, 20)
    path = run(tmp_path, frames, strands)
    found = mdtopo.read_results(path)
    alone = set(found.curve_crossings.step.tolist()) - set(found.crossings.step.tolist())
    assert alone
    kinds = {check.step: check.kind for check in verify(path, sampling=Sampling(nearest=50, share=0.0)).checks}
    assert {step for step, kind in kinds.items() if kind == "curve"} == alone


def test_a_real_run_agrees(shared_data: Path, tmp_path: Path) -> None:
    inputs = [shared_data / part for part in ("soft/soft.data", "soft/soft_fine.dcd")]
    mdtopo.monitor(*inputs, out=tmp_path / "run.h5", frames=slice(0, 9))
    found = verify(tmp_path / "run.h5", sampling=Sampling(steps=(3,)))
    assert found.agrees, found
