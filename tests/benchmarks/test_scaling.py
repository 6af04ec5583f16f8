"""What one step costs per edge, as the system grows, and what it costs elsewhere. Run with ``pytest -m benchmark -s``.

Compact chains of 2,000 to 200,000 edges, every vertex displaced by 0.13 edge lengths, on one core: a random walk in a
cube, which passes through itself, a random walk on a lattice that visits each site once, and a folded sheet. Beside a
whole `polyline_step`: `ipctk` (build of its candidates, and collision-free step size); the test of one frame for
self-intersection, which the paper proposes as the comparison; and the paper's own shortcut, ν and the greatest
displacement alone.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import benchmark_systems as systems
import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from mdtopo import MonitorConfig, Strands, polyline_step
from mdtopo.geometry.bundles import bundle_starts, edge_boxes, joint_boxes, meetings_of, pairs_of_meetings
from mdtopo.geometry.distances import closest_points
from mdtopo.geometry.vectors import norm, row, subtract

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

SIZES = (2_000, 20_000, 200_000)
SHARE = 0.13
LAB = MonitorConfig(motion="lab")
AIM_NS, AIM_GROWTH, AIM_IPC, AIM_BYTES = 150, 2.0, 10.0, 1000

Points = NDArray[np.float64]


def walk(n_edges: int) -> Points:
    return systems.random_chain(n_edges)


def sheets(n_edges: int) -> Points:
    return systems.compact_chain(n_edges + 1) + np.random.default_rng(0).normal(scale=0.3, size=(n_edges + 1, 3))


def lattice(n_edges: int) -> Points:
    chain = systems.self_avoiding_chain(n_edges)
    return chain + np.random.default_rng(0).normal(scale=0.1, size=chain.shape)


CHAINS = pytest.mark.parametrize("chain", [walk, lattice, sheets], ids=["random walk", "lattice walk", "folded sheet"])


@pytest.fixture(autouse=True)
def one_core() -> Iterator[None]:
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    yield
    os.sched_setaffinity(0, cores)


def least_ns(job: Callable[[], object], n_edges: int) -> float:
    """Least processor time of a job in ns per edge; the first call, which may compile, does not count.

    On one core this is the time on the wall, less the time in which others had the core.
    """
    job()
    rounds = max(15, min(30, 60_000 // n_edges))
    least = float("inf")
    for _ in range(rounds):
        start = time.process_time()
        job()
        least = min(least, time.process_time() - start)
    return least / n_edges * 1e9


@njit(nogil=True)
def furthest_of(x0: Points, x1: Points) -> float:
    furthest = 0.0
    for i in range(len(x0)):
        furthest = max(furthest, norm(subtract(row(x1, i), row(x0, i))))
    return furthest


@njit(nogil=True)
def least_distance(x: Points, reach: float) -> float:
    """Return the least distance of two edges of a chain that share no vertex; `reach` where it is greater."""
    m, least = len(x) - 1, reach
    edges, trace, pads = np.empty((m, 2), np.int64), np.zeros(m, np.int64), np.full(m, 0.5 * reach)
    edges[:, 0], edges[:, 1] = np.arange(m), np.arange(1, m + 1)
    for i in range(m - 2):
        _, _, n = closest_points(row(x, i), row(x, i + 1), row(x, i + 2), row(x, i + 3))
        least = min(least, norm(n))
    starts = bundle_starts(trace)
    boxes = edge_boxes(x, x, edges, pads, starts)
    pairs = pairs_of_meetings(boxes, meetings_of(joint_boxes(boxes, starts)), starts, trace)
    for k in range(len(pairs)):
        i, j = pairs[k]
        _, _, n = closest_points(row(x, i), row(x, i + 1), row(x, j), row(x, j + 1))
        least = min(least, norm(n))
    return least


def distance_within(x: Points, reach: float) -> float:
    return float(least_distance(x, reach))


def meets_itself(x: Points) -> bool:
    """Whether a frame intersects itself: what one would test frame by frame without a theory of motion."""
    return distance_within(x, 1e-9) < 1e-9


def scalar_comparison(x0: Points, x1: Points) -> bool:
    """The paper's comparison and no more: is every displacement below half of ν? A greater ν need not be known."""
    return furthest_of(x0, x1) < 0.5 * distance_within(x0, 2.1 * SHARE * systems.BOND)


def ipc_job(ipctk: Any, x0: Points, x1: Points) -> Callable[[], float]:
    n = len(x0) - 1
    edges = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1).astype(np.int32)
    mesh = ipctk.CollisionMesh(x0, edges, np.zeros((0, 3), dtype=np.int32))

    def job() -> float:
        candidates = ipctk.Candidates()
        candidates.build(mesh, x0, x1, 0.0)
        return float(candidates.compute_collision_free_stepsize(mesh, x0, x1))

    return job


@CHAINS
def test_a_step_costs_the_same_per_edge_whatever_the_size(chain: Callable[[int], Points]) -> None:
    ipctk = pytest.importorskip("ipctk")
    step: dict[int, float] = {}
    print(f"\n{chain.__name__}, displacements of {SHARE} edge lengths, one core, ns per edge")
    for n in SIZES:
        x0 = chain(n)
        x1, strands = systems.displaced(x0, SHARE), Strands.from_lengths([n + 1])
        whole_step = partial(polyline_step, x0, x1, strands, config=LAB)
        report, step[n] = whole_step(), least_ns(whole_step, n)
        still, scalar = least_ns(partial(meets_itself, x0), n), least_ns(partial(scalar_comparison, x0, x1), n)
        ipc = least_ns(ipc_job(ipctk, x0, x1), n)
        print(
            f"  {n:7d} edges: step {step[n]:6.0f} (aim {AIM_NS} at 2000), {report.verdict.name}, "
            f"{report.n_crossings} crossings; ipctk {ipc:6.0f} = {ipc / step[n]:5.2f} x (aim {AIM_IPC:g}); "
            f"self-intersection of one frame {still:6.0f} = {still / step[n]:4.2f} x; "
            f"scalar comparison alone {scalar:5.0f} = {scalar / step[n]:4.2f} x, "
            f"{'a proof' if scalar_comparison(x0, x1) else 'no proof'}"
        )
    growth = step[SIZES[-1]] / step[SIZES[0]]
    print(f"  growth from {SIZES[0]} to {SIZES[-1]} edges: {growth:.2f} x (aim {AIM_GROWTH:g})")
    assert growth <= AIM_GROWTH


@pytest.mark.parametrize("chain", [walk, lattice], ids=["random walk", "lattice walk"])
def test_images_cost_the_same_per_edge_whatever_the_size(chain: Callable[[int], Points]) -> None:
    """The same chains in a cell that they fill, so that they meet their own images through each of its faces."""
    step: dict[int, float] = {}
    print(f"\n{chain.__name__} in a cell that it fills, one core, ns per edge")
    for n in SIZES:
        x0 = chain(n)
        x1, strands = systems.displaced(x0, SHARE), Strands.from_lengths([n + 1])
        cell = (float(np.ptp(x0, axis=0).max()) + systems.BOND) * np.eye(3)
        alone = least_ns(partial(polyline_step, x0, x1, strands, config=LAB), n)
        in_cell = partial(polyline_step, x0, x1, strands, cell_t0=cell, cell_t1=cell, config=LAB)
        report, step[n] = in_cell(), least_ns(in_cell, n)
        print(
            f"  {n:7d} edges: step {step[n]:6.0f} = {step[n] / alone:.2f} x that without a cell, "
            f"{report.verdict.name}, {report.n_crossings} crossings"
        )
    growth = step[SIZES[-1]] / step[SIZES[0]]
    print(f"  growth from {SIZES[0]} to {SIZES[-1]} edges: {growth:.2f} x (aim {AIM_GROWTH:g})")
    assert growth <= AIM_GROWTH


MEMORY = """
import sys, threading, time
import numpy as np
from mdtopo import MonitorConfig, Strands, polyline_step

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

def watch():
    while not done.is_set():
        peak.append(resident())
        time.sleep(0.001)

lab, strands = MonitorConfig(motion="lab"), Strands.from_lengths([201])
x0, x1 = np.load(sys.argv[1])
polyline_step(x0[:201], x1[:201], strands, config=lab)
strands = Strands.from_lengths([len(x0)])
before, peak, done = resident(), [], threading.Event()
watcher = threading.Thread(target=watch)
watcher.start()
polyline_step(x0, x1, strands, config=lab)
done.set()
watcher.join()
print(max(peak) - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
@CHAINS
def test_a_step_needs_less_than_a_kilobyte_per_edge(chain: Callable[[int], Points], tmp_path: Path) -> None:
    n, path = SIZES[-1], tmp_path / "positions.npy"
    x0 = chain(n)
    np.save(path, np.stack([x0, systems.displaced(x0, SHARE)]))
    run = subprocess.run([sys.executable, "-c", MEMORY, str(path)], capture_output=True, check=True, text=True)
    per_edge = int(run.stdout) / n
    print(f"\n{chain.__name__}, {n} edges: {per_edge:.0f} bytes per edge beside the positions (aim {AIM_BYTES})")
    assert 0 < per_edge < AIM_BYTES
