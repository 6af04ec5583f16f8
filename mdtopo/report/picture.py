"""A static picture of an event, for print and where WebGL is missing: three instants, drawn by matplotlib."""

import base64
from collections.abc import Iterator
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mdtopo.report.scene import Scene, path_distance, path_length
from mdtopo.typing import Points

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PURPLE, VERMILLION, BLUE = "#CC79A7", "#D55E00", "#0072B2"
"""From the Okabe-Ito set."""

MARKS = (VERMILLION, BLUE)

PANEL_POINTS = 205.0
"""Width of one of the three instants, in points (1/72 inch); dots are drawn in lengths and need it."""

ARC_AHEAD = 0.02
"""How far marked arcs are drawn towards the eye, in half widths of the view."""

OCTAGON = np.stack([trig(np.arange(9) * np.pi / 4) for trig in (np.cos, np.sin)], axis=1)


class Strip(NamedTuple):
    """A straight line, shape (2, 3), the last column towards the eye; how it is drawn."""

    ends: Points
    colour: str
    width: float
    dots: bool = True


def event_picture(scene: Scene) -> str:
    """Return a WebP as a ``data:`` address: the event at the start, when the view opens, and at the end of the step."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=(9.0, 3.3), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    right, up = _screen(scene.eye)
    for axes, t in zip(figure.subplots(1, 3), (0.0, scene.t, 1.0), strict=True):
        _draw(axes, scene, t, np.stack([right, up, scene.eye]))
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.02, top=0.9, wspace=0.03)
    canvas.draw()
    buffer = BytesIO()
    Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").save(buffer, "webp", quality=70)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode()


def _screen(eye: Points) -> tuple[Points, Points]:
    helper = np.eye(3)[np.argmin(np.abs(eye))]
    right = np.cross(helper, eye)
    right /= np.linalg.norm(right)
    return right, np.cross(eye, right)


def _draw(axes: "Axes", scene: Scene, t: float, frame: Points) -> None:
    strips = list(_strips(scene, t, frame))
    marked = [(1.0 - t) * x0 + t * x1 for x0, x1 in scene.marked]
    for x, colour in zip(marked, MARKS, strict=False):
        strips += [Strip(ends @ frame.T, colour, 3.6, len(x) == 2) for ends in _chords(x)]
    # the nearest last; marked arcs before the curve that they are part of
    ahead = ARC_AHEAD * scene.radius
    strips.sort(key=lambda strip: float(strip.ends[:, 2].mean()) + ahead * (strip.colour in MARKS and not strip.dots))
    _paint(axes, strips, PANEL_POINTS / (2.0 * scene.radius))
    axes.set(xlim=(-scene.radius, scene.radius), ylim=(-scene.radius, scene.radius), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.set_title(f"t = {t:.4g}    {distance_words(marked)}", fontsize=10)


def _chords(x: Points) -> Iterator[Points]:
    """Yield the chords of a path, those of an arc longer than they are, so that no halo shows between them."""
    overlap = 0.0 if len(x) == 2 else 0.6
    for a, b in pairwise(x):
        yield np.stack([a - overlap * (b - a), b + overlap * (b - a)])


def _strips(scene: Scene, t: float, frame: Points) -> Iterator[Strip]:
    """Yield the edges and the curve in the cube of the view: what is before or behind it would hide the pair."""
    rows = [(piece.x0, piece.x1, "#9a9a9a", 1.6, True) for piece in scene.pieces]
    rows += [(path.x0, path.x1, PURPLE, 1.1, False) for path in scene.curves]
    for x0, x1, colour, width, dots in rows:
        x = ((1.0 - t) * x0 + t * x1) @ frame.T
        near = np.asarray(np.max(np.abs(x), axis=1) <= scene.radius)
        for k in np.flatnonzero(near[1:] | near[:-1]).tolist():
            yield Strip(x[k : k + 2], colour, width, dots)


def _paint(axes: "Axes", strips: list[Strip], points_per_length: float) -> None:
    """Draw strips in their order, each with a halo, which tells over from under, and edges with dots at their ends.

    One collection, because a thousand lines of their own take a second. It has one shape of cap for all: the flat one,
    with which a halo does not bite into the strip before it; so dots are outlines of small octagons.
    """
    from matplotlib.collections import LineCollection

    paths: list[Points] = []
    colours: list[str] = []
    widths: list[float] = []
    for strip in strips:
        line = strip.ends[:, :2]
        paths += [line, line]
        colours += ["white", strip.colour]
        widths += [strip.width + (2.5 if strip.dots else 1.2), strip.width]
        if strip.dots:
            size = strip.width + 1.8
            paths += [end + 0.25 * size / points_per_length * OCTAGON for end in line]
            colours += [strip.colour] * 2
            widths += [0.5 * size] * 2
    axes.add_collection(LineCollection(paths, colors=colours, linewidths=widths, capstyle="butt"), autolim=False)


def distance_words(marked: list[Points]) -> str:
    """Return the distance of the marked pair in words, or the length of the one edge."""
    if len(marked) == 2:
        return f"distance {round(path_distance(*marked), 9):.3g} Å"  # an exact meeting, in floating point
    return f"length {path_length(marked[0]):.3g} Å"
