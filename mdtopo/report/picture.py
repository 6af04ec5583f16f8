"""A static picture of an event, for print and where WebGL is missing: three instants, drawn by matplotlib."""

import base64
from io import BytesIO
from typing import Any

import numpy as np

from mdtopo.report.scene import Scene, segment_distance
from mdtopo.typing import Points

BLACK, ORANGE, SKY, VERMILLION, BLUE = "#000000", "#E69F00", "#56B4E9", "#D55E00", "#0072B2"
"""From the Okabe-Ito set."""

MARKS = (VERMILLION, BLUE)


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


def _draw(axes: object, scene: Scene, t: float, frame: Points) -> None:
    from matplotlib.axes import Axes

    assert isinstance(axes, Axes)
    strips: list[tuple[float, Points, str, float]] = []
    for piece in scene.pieces:
        x = ((1.0 - t) * piece.x0 + t * piece.x1) @ frame.T
        # the cube of the view: what is before or behind it would hide the pair
        near = np.asarray(np.max(np.abs(x), axis=1) <= scene.radius)
        shown = np.flatnonzero(near[1:] | near[:-1]).tolist()
        strips += [(float(x[k : k + 2, 2].mean()), x[k : k + 2], "#9a9a9a", 1.6) for k in shown]
    marked = [(1.0 - t) * x0 + t * x1 for x0, x1 in scene.marked]
    for x, colour in zip(marked, MARKS, strict=False):
        turned = x @ frame.T
        strips.append((float(turned[:, 2].mean()), turned, colour, 3.6))
    for _, x, colour, width in sorted(
        strips, key=lambda strip: strip[0]
    ):  # the nearest last; a halo tells over from under
        axes.plot(x[:, 0], x[:, 1], color="white", lw=width + 2.5, solid_capstyle="butt")
        axes.plot(x[:, 0], x[:, 1], color=colour, lw=width, solid_capstyle="round", marker="o", ms=width + 0.8)
    axes.set(xlim=(-scene.radius, scene.radius), ylim=(-scene.radius, scene.radius), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.set_title(f"t = {t:.4g}    {distance_words(marked)}", fontsize=10)


def distance_words(marked: list[Points]) -> str:
    """Return the distance of the marked pair in words, or the length of the one edge."""
    if len(marked) == 2:
        return f"distance {round(segment_distance(*marked), 9):.3g} Å"  # an exact meeting, in floating point
    return f"length {np.linalg.norm(marked[0][1] - marked[0][0]):.3g} Å"
