"""The exact cases of `fixtures/cases`, with rational strings as Fractions."""

import json
import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FOLDER = Path(__file__).parents[1] / "fixtures" / "cases"
RATIONAL = re.compile(r"-?\d+(/\d+)?")

ExactPoints = list[list[Fraction]]


@dataclass(frozen=True)
class PolylineCase:
    """Strands that move linearly from x0 to x1, and what is true of the motion (the file's `expect`)."""

    id: str
    offsets: tuple[int, ...]
    closed: tuple[bool, ...]
    x0: ExactPoints
    x1: ExactPoints
    expect: dict[str, Any]

    @property
    def floats(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x0 and x1 rounded to floats, shape (n, 3)."""
        return np.array(self.x0, dtype=np.float64), np.array(self.x1, dtype=np.float64)


@dataclass(frozen=True)
class CurveCase:
    """One Bezier segment whose control points move linearly from p0 to p1."""

    id: str
    closed: bool
    p0: ExactPoints
    p1: ExactPoints
    expect: dict[str, Any]

    @property
    def floats(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """p0 and p1 rounded to floats, shape (n, 2) or (n, 3)."""
        return np.array(self.p0, dtype=np.float64), np.array(self.p1, dtype=np.float64)


@dataclass(frozen=True)
class TubeCase:
    """A smooth curve by name, with control points and weights where it is a rational Bezier curve."""

    id: str
    name: str
    closed: bool
    control_points: ExactPoints
    weights: list[Fraction]
    expect: dict[str, Any]


def polyline_cases() -> dict[str, PolylineCase]:
    return {case["id"]: _polyline(case) for case in load("polylines")}


def curve_cases() -> dict[str, CurveCase]:
    return {
        c["id"]: CurveCase(c["id"], c["closed"], c["control_points_t0"], c["control_points_t1"], c["expect"])
        for c in load("curves")
    }


def tube_cases() -> dict[str, TubeCase]:
    return {
        c["id"]: TubeCase(
            c["id"], c["name"], c["closed"], c.get("control_points", []), c.get("weights", []), c["expect"]
        )
        for c in load("tubes")
    }


def load(kind: str) -> list[dict[str, Any]]:
    """Return the cases of one file as they are written, but for rational strings."""
    text = (FOLDER / f"{kind}.json").read_text(encoding="utf-8")
    return _exact(json.loads(text)["cases"])


def _polyline(case: dict[str, Any]) -> PolylineCase:
    strands = case["strands"]
    offsets = np.cumsum([0, *(len(strand["vertices_t0"]) for strand in strands)])
    x0, x1 = ([p for strand in strands for p in strand[f"vertices_t{k}"]] for k in (0, 1))
    closed = tuple(strand["closed"] for strand in strands)
    return PolylineCase(case["id"], tuple(offsets.tolist()), closed, x0, x1, case["expect"])


def _exact(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _exact(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_exact(item) for item in value]
    if isinstance(value, str) and RATIONAL.fullmatch(value):
        return Fraction(value)
    return value
