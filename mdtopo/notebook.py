"""Results in a notebook: plots of clearance and ratio over time and by vertex, data frames, an HTML table of a run."""

from collections.abc import Iterable, Mapping
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import MissingDependencyError
from mdtopo.records import Alert, AlertKind, MonitorConfig, Profile, Severity, StepTable, Strands
from mdtopo.states import CRITERION_COLUMN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Columns = Mapping[str, NDArray[Any]]

BLUE, ORANGE = "#0072B2", "#D55E00"
"""Of the Okabe-Ito set, which the colour-blind can tell apart."""

WIDE = 5.0
"""A ratio beyond this would press the limit, 1, to the foot of a linear axis."""

MOST_CELLS = 500_000
"""Values that a heat map shows: many more take matplotlib seconds."""

BELOW = -0.06
"""Where alerts are marked: between the panels, in shares of the upper one's height, where they hide no line."""

MARKERS = {Severity.WARNING: ("v", "#E69F00"), Severity.CRITICAL: ("X", "#000000")}


def plot_steps(
    columns: Columns, first_step: int, config: MonitorConfig, alerts: Iterable[Alert], ax: Any = None
) -> "Axes":
    """Return matplotlib axes with the clearance of each step, its ratio in a panel below, and where alerts are worst.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Step columns.
    first_step : int
        The step of row 0.
    config : MonitorConfig
        Says which ratio is shown (2m/ν for the criterion nu, else the pair ratio), and the limits.
    alerts : iterable of Alert
        Warnings and critical ones are marked between the panels, at their worst step.
    ax : matplotlib Axes, optional
        Where to draw: they become the upper panel, and the lower one takes half their place. By default new ones.
    """
    from matplotlib import pyplot
    from mpl_toolkits.axes_grid1 import make_axes_locatable  # type: ignore[import-untyped]

    axes: Any = pyplot.subplots(figsize=(8.0, 4.8))[1] if ax is None else ax
    times = columns["time_t0"]
    in_time = bool(np.isfinite(times).all())
    x = times if in_time else first_step + np.arange(len(times))
    name = "nu_ratio" if config.criterion == "nu" else "pair_ratio"
    # two panels, because the two swing against each other and hide each other in one
    ratio_axes = make_axes_locatable(axes).append_axes("bottom", size="100%", pad=0.25, sharex=axes)
    axes.plot(x, columns["clearance"], color=BLUE, linewidth=1.0, label="clearance")
    ratio_axes.plot(x, columns[name], color=ORANGE, linewidth=1.0, label=name.replace("_", " "))
    limited = axes if CRITERION_COLUMN[config.criterion] == "clearance" else ratio_axes
    limited.axhline(config.near_limit, color="gray", linewidth=0.8, linestyle=":", label="near-limit threshold")
    _mark_alerts(axes, x, first_step, alerts)
    axes.set_ylabel("clearance (Å)")
    axes.tick_params(labelbottom=False)
    ratio_axes.set(xlabel="time (ps)" if in_time else "step", ylabel=f"{name.replace('_', ' ')} (1 is the limit)")
    axes.set_ylim(bottom=0.0)
    if np.nanmax(columns[name], initial=0.0) > WIDE:
        ratio_axes.set_yscale("log")
    else:
        ratio_axes.set_ylim(bottom=0.0)
    shown = [pair for part in (axes, ratio_axes) for pair in zip(*part.get_legend_handles_labels(), strict=True)]
    axes.legend(*zip(*shown, strict=True), loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, fontsize="small")
    found: Axes = axes
    return found


def _mark_alerts(axes: Any, x: NDArray[Any], first_step: int, alerts: Iterable[Alert]) -> None:
    listed = [alert for alert in alerts if alert.kind is not AlertKind.GAP]
    for severity, (marker, color) in MARKERS.items():
        rows = np.array([a.step_peak - first_step for a in listed if a.severity is severity], dtype=np.int64)
        rows = rows[(rows >= 0) & (rows < len(x))]
        if len(rows):
            places = {"transform": axes.get_xaxis_transform(), "clip_on": False, "zorder": 3}
            label = f"{severity.name.lower()} alerts"
            axes.plot(x[rows], np.full(len(rows), BELOW), marker, color=color, markersize=5, label=label, **places)


def plot_profile(profile: Profile, columns: Columns, first_step: int, ax: Any = None) -> "Axes":
    """Return matplotlib axes with a heat map of the clearance, vertices by time; 0 has a colour of its own.

    Parameters
    ----------
    profile : Profile
        With more than `MOST_CELLS` values it is shown in longer windows.
    columns, first_step
        As for `plot_steps`.
    ax : matplotlib Axes, optional
        Where to draw; by default new ones.
    """
    from matplotlib import pyplot
    from matplotlib.colors import ListedColormap

    axes: Any = pyplot.subplots(figsize=(8.0, 4.8))[1] if ax is None else ax
    shown = profile.within(MOST_CELLS)
    in_time = bool(len(shown)) and bool(np.isfinite(columns["time_t0"]).all())
    axes.set(xlabel="time (ps)" if in_time else "step", ylabel="vertex")
    if not len(shown):
        found: Axes = axes
        return found
    frames = columns["frame_t0"]
    windows = np.arange(shown.window[0], shown.window[-1] + 1)
    begins = np.searchsorted(frames, windows * shown.window_frames)
    end = int(np.searchsorted(frames, (windows[-1] + 1) * shown.window_frames))
    x = first_step + np.append(begins, end)
    if in_time:
        x = np.append(columns["time_t0"][begins], columns["time_t1"][end - 1])
    values = np.full((shown.clearance.shape[1], len(windows)), np.nan, dtype=np.float32)
    values[:, shown.window - windows[0]] = shown.clearance.T
    y = np.arange(len(values) + 1) - 0.5
    axes.set_facecolor("#d4d7dc")  # what was not measured
    drawn = axes.pcolormesh(x, y, np.ma.masked_invalid(values), cmap="YlGnBu_r", vmin=0.0)
    axes.pcolormesh(x, y, np.ma.masked_where(~(values == 0.0), values), cmap=ListedColormap([ORANGE]))
    axes.figure.colorbar(drawn, ax=axes, label="clearance (Å)")
    axes.invert_yaxis()
    made: Axes = axes
    return made


def profile_dataframe(profile: Profile, strands: Strands) -> Any:
    """Return a pandas DataFrame with a row for each window, by its step, and a column for each vertex, by its label.

    Raises
    ------
    MissingDependencyError
        If pandas is not installed.
    """
    pandas = _pandas()
    labels = [strands.labels.text(vertex) for vertex in range(strands.n_vertices)]
    return pandas.DataFrame(
        profile.clearance,
        index=pandas.Index(profile.step, name="step"),
        columns=pandas.Index(labels, name="vertex"),
    )


def _pandas() -> Any:
    try:
        import pandas
    except ImportError as error:
        raise MissingDependencyError(
            'A data frame needs pandas, which is not installed; pip install "mdtopo[notebook]".'
        ) from error
    return pandas


def steps_dataframe(columns: Columns, first_step: int) -> Any:
    """Return a pandas DataFrame with a row for each step (the index), enums as categories of names.

    They stand in the order of `StepTable`, frames and times first, whatever order the file lists them in. Columns of
    several numbers for each step are split: ``nu_pair`` becomes ``nu_pair_0_0`` … ``nu_pair_1_1``.

    Raises
    ------
    MissingDependencyError
        If pandas is not installed.
    """
    pandas = _pandas()
    enums = {column.name: column.enum for column in StepTable.columns()}
    flat: dict[str, Any] = {}
    order = {name: k for k, name in enumerate(enums)}
    for name, values in sorted(columns.items(), key=lambda item: order.get(item[0], len(order))):
        enum = enums.get(name)
        for index in np.ndindex(values.shape[1:]):
            part = values[(slice(None), *index)]
            title = "_".join([name, *map(str, index)])
            flat[title] = part if enum is None else pandas.Categorical([enum(int(code)).name for code in part])
    count = len(next(iter(columns.values()), ()))
    return pandas.DataFrame(flat, index=pandas.RangeIndex(first_step, first_step + count, name="step"))


def html_table(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """Return a small HTML table; every text is escaped, because names come from files."""
    body = "".join(f"<tr><th>{escape(str(name))}</th><td>{escape(str(value))}</td></tr>" for name, value in rows)
    return f"<table><caption>{escape(title)}</caption>{body}</table>"
