"""What the profile adds to a run, and to its file. Run with ``pytest -m benchmark -s``.

The time is that of a run with a profile of every step, against one with none, in one process on one thread, the least
of several turns in each case.
The file is that of a million steps: random values, which no compression makes smaller than real ones.
"""

import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from mdtopo.pipeline import open_input, step_tables
from mdtopo.records import MonitorConfig, Profile
from mdtopo.store.profile import ProfileColumns

pytestmark = [pytest.mark.benchmark, pytest.mark.filterwarnings("default")]

RUNS = {
    "protein, 58 vertices": ("gmx/ca.gro", "gmx/ca_wrapped.xtc"),
    "melt, 2000 vertices": ("kg/kg_linear.data", "kg/kg_linear_fine.dcd"),
    "soft chains, 2000 vertices": ("soft/soft.data", "soft/soft_fine.dcd"),
}
MOST_SHARE, MOST_BYTES = 0.1, 40e6


@pytest.mark.parametrize("name", RUNS)
def test_time(shared_data: Path, name: str) -> None:
    inputs, least = [shared_data / part for part in RUNS[name]], {0: np.inf, 1: np.inf}
    with open_input(*inputs) as reader:
        for turn in range(6):
            for steps in (0, 1) if turn % 2 else (1, 0):
                config = MonitorConfig(profile_steps=steps, curve="none")
                start = time.perf_counter()
                n = sum(len(table) for table in step_tables(reader, frames=slice(0, 129), config=config, threads=1))
                if turn:  # the first one may compile
                    least[steps] = min(least[steps], (time.perf_counter() - start) / n)
    more = (least[1] - least[0]) / least[0]
    default = MonitorConfig().profile_steps
    print(
        f"{name}: {more:.2f} of a step of {1e6 * least[0]:.0f} µs; once in {default} steps {100 * more / default:.1f} %"
    )
    assert more / default < MOST_SHARE


@pytest.mark.parametrize("n_vertices", [100, 10_000])
def test_size(tmp_path: Path, n_vertices: int) -> None:
    random, path = np.random.default_rng(0), tmp_path / "profile.h5"
    with h5py.File(path, "w") as file:
        columns = ProfileColumns(file.create_group("profile"), n_vertices)
        for window in range(1_000_000 // 32):
            value = random.uniform(0.5, 2.5, (1, n_vertices)).astype(np.float32)
            at = np.array([window])
            columns.append(Profile(32, at, 32 * at, value.min(axis=1).astype(float), value))
        columns.pack()
        columns.flush()
        length, rows = file["profile"].attrs["window_frames"], len(file["profile/window"])
    print(f"{n_vertices} vertices, 10^6 steps: {path.stat().st_size / 1e6:.1f} MB, {rows} windows of {length} steps")
    assert path.stat().st_size < MOST_BYTES
