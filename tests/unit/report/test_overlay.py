"""The smooth curve in a view is the curve of the strands at every time of the slider."""

import numpy as np
import pytest

from mdtopo import CompositeBezier, MonitorConfig, Strands, spline_curve
from mdtopo.records import Frame
from mdtopo.report import event_scene, step_path
from mdtopo.report.overlay import places, trace_curves
from mdtopo.report.picture import PURPLE, event_picture
from mdtopo.smooth import CurveKind

KINDS: tuple[CurveKind, ...] = ("interpolating", "bspline", "catmull-rom", "bezier", "bezier-through")


def walk(n: int, seed: int) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(0.0, 1.0, (n, 3)), axis=0)


def test_a_straight_strand_by_hand() -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    found = places(spline_curve(x, Strands.from_lengths([3])), 2, np.array([0, 1, 2]), np.array([1, 2]))
    np.testing.assert_allclose(found, [[0, 0, 0], [1, 0, 0], [1.5, 0, 0], [2, 0, 0]], atol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("closed", [False, True])
def test_places_move_straight_with_the_vertices(kind: CurveKind, closed: bool) -> None:
    x0, x1 = walk(9, 1), walk(9, 2)
    n_edges = 9 if closed else 8
    run = np.array([7, 8, 0, 1]) if closed else np.array([2, 3, 4, 5])  # a ring's run may wrap around
    parts = np.array([3, 1, 4])
    before, after = (places(curve, n_edges, run, parts) for curve in trace_curves(x0, x1, closed=closed, kind=kind))
    for t in (0.0, 0.3, 1.0):
        now = spline_curve((1 - t) * x0 + t * x1, Strands.from_lengths([9], closed=closed), kind)
        expected = _slow_places(now, n_edges, run.tolist(), parts.tolist())
        np.testing.assert_allclose((1 - t) * before + t * after, expected, atol=1e-11)


def _slow_places(curve: CompositeBezier, n_edges: int, run: list[int], parts: list[int]) -> np.ndarray:
    found = []
    for tail, count in zip(run[:-1], parts, strict=True):
        for k in range(count):
            found.append(_at(curve, n_edges, tail, k / count))
    return np.array([*found, _at(curve, n_edges, run[-2], 1.0)])


def _at(curve: CompositeBezier, n_edges: int, tail: int, share: float) -> np.ndarray:
    if curve.n_segments == n_edges:
        return curve.points([share])[tail, 0]
    return curve.points([(tail + share) / n_edges])[0, 0]


def crossed_frames() -> tuple[tuple[Frame, Frame], Strands]:
    first = np.array([[-2.0, 0.3, 0.2], [-1.0, 0, 0], [1.0, 0, 0], [2.0, 0.3, 0.2]])
    second = first[:, [1, 0, 2]] + np.array([0.0, 0.0, 0.5])
    idle = first + np.array([0.0, 5.0, 5.0])
    x = [np.concatenate([first, second + np.array([0.0, 0.0, shift]), idle]) for shift in (0.0, -1.0)]
    frames = Frame(0, 0.0, x[0], None), Frame(1, 1.0, x[1], None)
    return frames, Strands.from_lengths([4, 4, 4])


def test_the_scene_holds_the_curve_of_the_marked_strands_along_their_edges() -> None:
    frames, strands = crossed_frames()
    path = step_path(frames, strands, (), MonitorConfig(motion="lab"), False)
    assert path is not None
    scene = event_scene(*path, strands, ((1, 2), (5, 6)), 0.5)
    assert [curve.strand for curve in scene.curves] == list(strands.names[:2])
    assert scene.no_curve == ""
    for curve, piece in zip(scene.curves, scene.pieces, strict=False):
        # an interpolating curve begins and ends where its edges do, and passes through each vertex
        for places_, vertices in ((curve.x0, piece.x0), (curve.x1, piece.x1)):
            gaps = np.linalg.norm(places_[None] - vertices[:, None], axis=2).min(axis=1)
            assert gaps.max() < 1e-12
    assert event_picture(scene).startswith("data:image/webp;base64,")
    assert PURPLE == "#CC79A7"


def test_a_strand_without_a_curve_is_said_and_the_others_are_drawn() -> None:
    frames, strands = crossed_frames()
    for frame in frames:
        frame.positions[0] = frame.positions[1]
    path = step_path(frames, strands, (), MonitorConfig(motion="lab"), False)
    assert path is not None
    scene = event_scene(*path, strands, ((1, 2), (5, 6)), 0.5)
    assert [curve.strand for curve in scene.curves] == [strands.names[1]]
    assert "follow each other and coincide" in scene.no_curve
