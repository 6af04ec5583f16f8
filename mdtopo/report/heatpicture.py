"""The heat map as a picture, for readers without JavaScript, drawn by matplotlib."""

import base64
from io import BytesIO
from typing import Any

import numpy as np

from mdtopo.report.heat import HeatMap
from mdtopo.report.rundata import RunData

VERMILLION, BLUE, NOTHING = "#D55E00", "#0072B2", "#d4d7dc"
"""A crossing, a line, and what was not measured; the first two from the Okabe-Ito set."""

SCALE = "YlGnBu_r"
"""Dark is close. It stays in order for the colour-blind and in grey print (ColorBrewer), and holds no red."""


def heat_picture(run: RunData, heat: HeatMap, scale: float, x_title: str) -> str:
    """Return a WebP as a ``data:`` address; times are divided by `scale`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=(9.0, 4.6), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes, strip = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
    x = heat.edges / (scale if run.has_times else 1.0)
    n = run.results.strands.n_vertices
    y = np.append(heat.starts, n) - 0.5
    axes.set_facecolor(NOTHING)
    top = float(np.nanmax(heat.clearance)) or 1.0
    drawn = axes.pcolormesh(x, y, np.ma.masked_invalid(heat.clearance), cmap=SCALE, vmin=0.0, vmax=top)
    crossed = np.ma.masked_where(~(heat.clearance == 0.0), heat.clearance)
    axes.pcolormesh(x, y, crossed, cmap=ListedColormap([VERMILLION]))
    axes.set(xlabel=x_title, ylabel="vertex", ylim=(n - 0.5, -0.5))
    figure.colorbar(drawn, ax=axes, label="least clearance (Å)", pad=0.02)
    least, _, _ = heat.strip()
    middles = 0.5 * (y[1:] + y[:-1])
    strip.plot(least, middles, color=BLUE, linewidth=1.0)
    zero = least == 0.0
    strip.plot(least[zero], middles[zero], "x", color=VERMILLION, clip_on=False, markersize=5)
    strip.set(xlabel="least of the run (Å)", xlim=(0.0, 1.05 * top))
    for boundary in run.results.strands.offsets[1:-1].tolist() if run.results.strands.n_strands <= 60 else ():
        for part in (axes, strip):
            part.axhline(boundary - 0.5, color="#1d2430", linewidth=0.6)
    figure.subplots_adjust(left=0.08, right=0.98, bottom=0.12, top=0.97, wspace=0.06)
    canvas.draw()
    buffer = BytesIO()
    Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").save(buffer, "webp", quality=80)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode()
