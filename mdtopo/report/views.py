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
"""Bytes of all views together; the library that draws takes 4.8 MB, and a page stays below 8 MB."""


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
    """

    picture: str
    data: Mapping[str, Any]
    t: float

    @property
    def n_bytes(self) -> int:
        """About what it adds to the page."""
        return len(self.picture) + len(json.dumps(self.data))


def views_of(events: Sequence[Event], scenes: Mapping[str, Scene]) -> dict[str, View]:
    """Return the views by the id of the alert: of the events in order, until `MOST_BYTES` are spent."""
    views, left = {}, MOST_BYTES
    for event in events:
        scene = scenes.get(event.alert.id)
        if scene is None:
            continue
        view = View(event_picture(scene), _scene_data(scene), scene.t)
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
    }
