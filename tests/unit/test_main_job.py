"""The whole job over trajectories of real engines whose true answer is known."""

import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mdtopo import AlertKind, InputError, RunSummary, RunVerdict, Strands, Verdict, monitor, read_results
from mdtopo.records import MonitorConfig
from mdtopo.store import Results

KG = ("kg/kg_linear.data", "kg/kg_linear_fine.dcd")
KG_WRAPPED = ("kg/kg_linear.data", "kg/kg_linear_fine_wrapped.xtc")
RINGS = ("kg/kg_rings.data", "kg/kg_rings_fine.dcd")
HOPF = ("rings/hopf.data", "rings/pair_hopf_fine.dcd")
SOFT = ("soft/soft.data", "soft/soft_fine.dcd")
PULL = ("fracture/duplex.data", "fracture/dup_pull.dcd")
BPTI = ("gmx/md.tpr", "gmx/md.xtc")
CA_RAW, CA_WRAPPED, CA_NOJUMP = (("gmx/ca.gro", f"gmx/ca_{name}.xtc") for name in ("raw", "wrapped", "nojump"))

UNCROSSABLE = (KG, KG_WRAPPED, RINGS, PULL, BPTI, CA_RAW, CA_WRAPPED, CA_NOJUMP)
"""Runs in whose frames no strand passes through another, by exact tests of every step."""


@dataclass(frozen=True)
class Run:
    summary: RunSummary
    results: Results

    def column(self, name: str) -> np.ndarray:
        return self.results.steps[name]

    def alerts(self, *kinds: AlertKind) -> list[Any]:
        return [alert for alert in self.results.alerts if alert.kind in kinds]


Runner = Callable[..., Run]


@pytest.fixture(scope="module")
def run(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """Runs the job, once for each input and setting."""
    done: dict[Any, Run] = {}

    def job(names: tuple[str, str], *, stride: int = 1, motion: Any = "rigid") -> Run:
        key = (names, stride, motion)
        if key not in done:
            out = tmp_path_factory.mktemp("run") / "run.h5"
            inputs = [shared_data / name for name in names]
            config = MonitorConfig(motion=motion)
            summary = monitor(*inputs, out=out, frames=slice(None, None, stride), config=config)
            done[key] = Run(summary, read_results(out))
        return done[key]

    return job


def crossings(path: Path, *keys: str) -> list[dict[str, Any]]:
    """Return the true crossings of a run in the lab frame."""
    with gzip.open(path) as file:
        found = json.load(file)
    for key in keys:
        found = found[key]
    return found


def by_file(names: tuple[str, str]) -> str:
    return Path(names[1]).stem


@pytest.mark.parametrize(
    ("names", "count", "length", "closed"),
    [
        (KG, 20, 100, False),
        (KG_WRAPPED, 20, 100, False),
        (RINGS, 20, 100, True),
        (SOFT, 20, 100, False),
        (HOPF, 2, 64, True),
        (PULL, 2, 60, False),
        (BPTI, 1, 58, False),
        (CA_RAW, 1, 58, False),
        (CA_WRAPPED, 1, 58, False),
        (CA_NOJUMP, 1, 58, False),
    ],
    ids=lambda x: by_file(x) if isinstance(x, tuple) else None,
)
def test_strands(run: Runner, names: tuple[str, str], count: int, length: int, closed: bool) -> None:
    strands = run(names).results.strands
    assert np.diff(strands.offsets).tolist() == [length] * count
    assert strands.closed.tolist() == [closed] * count
    assert strands.gaps == ()


@pytest.mark.parametrize("names", UNCROSSABLE, ids=by_file)
def test_every_step_of_an_uncrossable_run_is_certified(run: Runner, names: tuple[str, str]) -> None:
    job = run(names)
    assert (job.column("verdict") == Verdict.CERTIFIED).all()
    counts = job.summary.counts
    assert counts.steps == len(job.column("verdict")) >= 438
    assert counts.unresolved == counts.crossed == 0
    assert job.results.complete


@pytest.mark.parametrize("names", [KG, KG_WRAPPED, RINGS, SOFT, BPTI, CA_RAW, CA_WRAPPED, CA_NOJUMP], ids=by_file)
def test_no_bond_is_called_stretched_or_broken_where_none_breaks(run: Runner, names: tuple[str, str]) -> None:
    job = run(names)
    assert job.alerts(AlertKind.STRETCH, AlertKind.FRACTURE) == []
    assert job.results.broken == ()


@pytest.mark.parametrize("stride", [1, 10, 50])
def test_no_step_in_which_soft_chains_cross_is_certified(run: Runner, shared_data: Path, stride: int) -> None:
    job = run(SOFT, stride=stride, motion="lab")
    true = crossings(shared_data / "soft/soft.truth.json.gz", f"stride{stride}", "crossings")
    steps = sorted({crossing["frame0"] // stride for crossing in true})
    assert len(steps) >= 10
    assert (job.column("verdict")[steps] != Verdict.CERTIFIED).all()


def test_no_step_in_which_the_linked_rings_cross_is_certified(run: Runner, shared_data: Path) -> None:
    job = run(HOPF, motion="lab")
    steps = sorted({crossing["frame0"] for crossing in crossings(shared_data / "rings/pair_hopf.truth.json.gz", "cr")})
    assert 489 in steps  # where the rings come apart
    assert (job.column("verdict")[steps] != Verdict.CERTIFIED).all()
    assert (job.column("verdict") == Verdict.CERTIFIED).mean() > 0.9


@pytest.mark.parametrize(
    ("names", "truth", "stride", "count"),
    [(KG, "kg/kg_linear.truth.json.gz", 250, 5), (RINGS, "kg/kg_rings.truth.json.gz", 50, 3)],
    ids=["kg_linear", "kg_rings"],
)
def test_no_step_is_certified_whose_linear_paths_cross(
    run: Runner, shared_data: Path, names: tuple[str, str], truth: str, stride: int, count: int
) -> None:
    true = crossings(shared_data / truth, f"fine_stride{stride}", "crossings")
    assert len(true) == count
    verdict = run(names, stride=stride, motion="lab").column("verdict")
    assert (verdict[[crossing["frame0"] // stride for crossing in true]] != Verdict.CERTIFIED).all()


@pytest.mark.parametrize("motion", ["rigid", "lab"])
@pytest.mark.parametrize(
    ("one", "other", "scale"),
    [(KG, KG_WRAPPED, 10.0), (CA_RAW, CA_WRAPPED, 1.0), (CA_RAW, CA_NOJUMP, 1.0), (CA_RAW, BPTI, 1.0)],
    ids=["kg_wrapped", "ca_wrapped", "ca_nojump", "bpti"],
)
def test_the_same_run_in_two_files_gives_the_same_numbers(
    run: Runner, one: tuple[str, str], other: tuple[str, str], scale: float, motion: str
) -> None:
    """How strands are wrapped changes nothing but the rounding of the coordinates.

    The XTC of the melt is in Å, ten times sigma, so the DCD's lengths are multiplied by 10. A vertex of one file is at
    most e = scale·η_one + η_other from that of the other. What that can change:

    - ν is a distance between two points of edges: 2e;
    - the greatest displacement is a difference of two positions: 2e;
    - ρ, the relative displacement of a pair, is made of four positions: 4e; so is d0 + d1, the sum of two distances;
    - the clearance (d0 + d1 - ρ)/2: 4e, the most that any of the rungs allows that settle the pairs here;
    - the pair ratio ρ/(d0 + d1): (4e + ratio·4e)/(d0 + d1), where d0 + d1 is at least 2ν.

    Where a rotation is taken out, it is fitted to coordinates that are e off. It averages over the vertices, so it
    moves none of them by more than another e: positions at a step's end may be 2e off, those at its start e, as before.
    """
    a, b = run(one, motion=motion), run(other, motion=motion)
    error = scale * a.results.config["coordinate_error"] + b.results.config["coordinate_error"]
    e = error if motion == "lab" else 1.5 * error
    assert (a.column("verdict") == b.column("verdict")).all()
    assert np.isfinite(b.column("clearance")).all()
    for name, factor in (("nu", 2.0), ("displacement_max", 2.0), ("clearance", 4.0)):
        np.testing.assert_allclose(scale * a.column(name), b.column(name), rtol=0.0, atol=factor * e, err_msg=name)
    ratio, nu = a.column("pair_ratio"), scale * a.column("nu").min()
    limit = 4.0 * e * (1.0 + ratio) / (2.0 * nu - 4.0 * e)
    assert (np.abs(ratio - b.column("pair_ratio")) <= limit).all()


def test_the_pulled_duplex_stretches_then_breaks_where_the_engine_broke_it(run: Runner, shared_data: Path) -> None:
    truth = json.loads((shared_data / "fracture/dup_pull.truth.json").read_text())
    edge = tuple(atom - 1 for atom in truth["bond_atoms_1based"])
    job = run(PULL)
    first = job.results.broken[0]
    assert edge == (57, 58) == tuple(first.edge)
    assert truth["frame_after"] == 339 <= first.frame <= 345
    stretch = job.alerts(AlertKind.STRETCH)[0]
    assert stretch.frame_start < 339
    fracture = job.alerts(AlertKind.FRACTURE)[0]
    assert fracture.residues == stretch.residues == ("1:58", "1:59")  # beads are called by their atom ids
    assert fracture.strands == ("molecule 1",)
    assert job.summary.verdict is RunVerdict.FAIL
    assert [tuple(broken.edge) for broken in job.results.broken] == [(57, 58), (61, 62)]


@pytest.mark.parametrize(
    ("names", "lengths"),
    [(("PSF", "DCD"), [214]), (("GRO", "XTC"), [214]), (("GRO_MEMPROT", "XTC_MEMPROT"), [282, 282])],
    ids=["adk", "adk_oplsaa", "yiip"],
)
def test_trajectories_of_mdanalysis(tmp_path: Path, names: tuple[str, str], lengths: list[int]) -> None:
    datafiles = pytest.importorskip("MDAnalysisTests.datafiles")
    out = tmp_path / "run.h5"
    summary = monitor(*(getattr(datafiles, name) for name in names), out=out)
    results = read_results(out)
    assert np.diff(results.strands.offsets).tolist() == lengths
    assert not results.strands.closed.any()
    assert summary.n_steps == len(results.steps["verdict"]) > 0
    assert results.complete
    assert results.broken == ()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"frames": slice(None, None, -1)}, "has the step -1; it must be 1 or more: time runs forward"),
        ({"frames": slice(None, None, 0)}, "has the step 0; it must be 1 or more"),
        ({"threads": 0}, "threads is 0; it must be at least 1"),
    ],
)
def test_what_the_command_line_refuses_is_refused_in_python_too(how: dict, words: str) -> None:
    positions = np.arange(3.0)[:, np.newaxis, np.newaxis] + np.arange(9.0).reshape(3, 3)
    with pytest.raises(InputError, match=words):
        monitor(positions, strands=Strands.from_lengths([3]), **how)
