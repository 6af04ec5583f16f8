from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mdtopo.cli import main

N_FRAMES, N_VERTICES = 12, 8


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str


@pytest.fixture(autouse=True)
def _without_tracebacks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MDTOPO_DEBUG", raising=False)


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    def run(*words: object) -> Outcome:
        capsys.readouterr()
        code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return run


def positions() -> np.ndarray:
    """One straight strand with bonds of 1 Å, which trembles by a hundredth of that."""
    line = np.arange(N_VERTICES)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    return line + np.random.default_rng(7).normal(0.0, 0.01, (N_FRAMES, N_VERTICES, 3))


@pytest.fixture
def npz(tmp_path: Path) -> Callable[..., Path]:
    """Writes an input file of one open strand; keywords replace or, as None, leave out its arrays."""

    def write(name: str = "tiny.npz", **changes: Any) -> Path:
        arrays: dict[str, Any] = {
            "positions": positions(),
            "offsets": np.array([0, N_VERTICES]),
            "closed": np.array([False]),
            "time": np.arange(float(N_FRAMES)),
        }
        arrays |= changes
        path = tmp_path / name
        np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
        return path

    return write


@pytest.fixture
def breaking() -> np.ndarray:
    """The same strand, whose edge 3-4 is twice as long from frame 6 on."""
    moved = positions()
    moved[6:, 4:, 0] += 1.0
    return moved
