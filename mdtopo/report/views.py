"""The views of the worst events: a picture and coordinates for each, as many as the page has room for."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.report.events import Event
from mdtopo.report.picture import event_picture
from mdtopo.report.scene import Scene

MOST_BYTES = 1_200_000
"""Bytes of all views together, where nobody asks for more; a page stays below 8 MB, and what draws it takes 4.8 MB."""


@dataclass(frozen=True, slots=True)
class View:
    """How an event is shown.

    Attributes
    ----------
    picture : str
        A ``data:`` address.
    data : mapping
        What the script draws, ready for JSON.
    t : float
        When it opens.
    no_curve : str
        Why a strand has no smooth curve in it; empty where all have one.
    own_type : str
        Whether the curve of the event's strands has their own type, in words; empty where nobody looked.
    """

    picture: str
    data: Mapping[str, Any]
    t: float
    no_curve: str
    own_type: str

    @property
    def n_bytes(self) -> int:
        """About what it adds to the page."""
        return len(self.picture) + len(json.dumps(self.data))


def views_of(events: Sequence[Event], scenes: Mapping[str, Scene], most_bytes: float) -> dict[str, View]:
    """Return the views by the id of the alert: of the events in order, until the bytes are spent."""
    views, left = {}, most_bytes
    for event in events:
        scene = scenes.get(event.alert.id)
        if scene is None:
            continue
        view = View(event_picture(scene), _scene_data(scene), scene.t, scene.no_curve, scene.own_type)
        left -= view.n_bytes
        if left < 0:
            break
        views[event.alert.id] = view
    return views


def packed(values: NDArray[Any], dtype: str) -> str:
    """Return the little-endian bytes of an array in base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=dtype).tobytes()).decode()


def _scene_data(scene: Scene) -> dict[str, Any]:
    return {
        "pieces": [
            {
                "strand": piece.strand,
                "labels": list(piece.labels),
                "x0": packed(piece.x0, "<f4"),
                "x1": packed(piece.x1, "<f4"),
            }
            for piece in scene.pieces
        ],
        "marked": [[x0.tolist(), x1.tolist()] for x0, x1 in scene.marked],
        "t": scene.t,
        "eye": scene.eye.tolist(),
        "radius": scene.radius,
        "arcs": any(len(x0) > 2 for x0, _ in scene.marked),
        "curve": _curve_data(scene),
    }


def _curve_data(scene: Scene) -> dict[str, Any]:
    """Return the smooth curve in whole numbers of a 32767th of the view's reach: finer than any screen."""
    reach = max((float(np.abs([path.x0, path.x1]).max()) for path in scene.curves), default=1.0)
    unit = max(reach, 1e-300) / 32767.0
    lines = [
        {
            "strand": path.strand,
            "x0": packed(np.rint(path.x0 / unit), "<i2"),
            "x1": packed(np.rint(path.x1 / unit), "<i2"),
        }
        for path in scene.curves
    ]
    return {"unit": unit, "lines": lines}
