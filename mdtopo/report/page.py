"""One run as one page: everything inlined, so that it opens anywhere and asks the network for nothing."""

import json
import math
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from mdtopo.records import CurveVerdict, Severity, StepState
from mdtopo.records.headline import headline, state_meanings
from mdtopo.report.answers import answers, unread_frames
from mdtopo.report.cards import pair_cards, strand_cards
from mdtopo.report.envelope import bin_starts, envelope, worst_states
from mdtopo.report.events import Event, ranked_events, severity_word
from mdtopo.report.heat import closest_places, heat_data, heat_map
from mdtopo.report.heatpicture import heat_picture
from mdtopo.report.interval import IntervalAdvice, interval_advice, percent
from mdtopo.report.rundata import RunData
from mdtopo.report.scene import Scene
from mdtopo.report.snippets import snippets
from mdtopo.report.views import MOST_BYTES, View, packed, views_of

MOST_LISTED = 200
"""Alerts in the list; the sentence below it says how many there are beside."""

MOST_CARDS, MOST_FOLDED = 12, 200
MOST_MARKERS, MOST_MESSAGES = 2000, 1000
"""Alert markers over time, one for each alert; and those of them, the worst, that keep the message of their alert."""

PLACES = 250
"""Markers of one kind side by side on a screen, where there are too many for one each."""

SHAPES = {
    StepState.BALL: ("●", "#009E73"),
    StepState.PAIRS: ("■", "#56B4E9"),
    StepState.NEAR_LIMIT: ("▲", "#E69F00"),
    StepState.UNRESOLVED: ("◆", "#CC79A7"),
    StepState.CROSSED: ("✕", "#D55E00"),
}
"""A shape and a colour (Okabe-Ito) for each state."""

VERDICT_SHAPES = {
    "PASS": ("✓", "#009E73"),
    "WARN": ("▲", "#E69F00"),
    "UNPROVEN": ("◆", "#CC79A7"),
    "FAIL": ("✕", "#D55E00"),
}
SEVERITY_SHAPES = {
    Severity.INFO: ("○", "#0072B2"),
    Severity.WARNING: ("▲", "#E69F00"),
    Severity.CRITICAL: ("✕", "#D55E00"),
}


def render_page(run: RunData, scenes: Mapping[str, Scene], *, no_views: str = "", n_views: int | None = None) -> str:
    """Return the page of a run.

    Parameters
    ----------
    run : RunData
    scenes : mapping of str to Scene
        The surroundings of some events, by the id of their alert.
    no_views : str
        One sentence that says why there are none, where there are none.
    n_views : int, optional
        For so many events the page has room, however large it becomes; by default it stays below 8 MB.
    """
    events = ranked_events(run)
    listed = events[: max(MOST_LISTED, n_views or 0)]
    views = views_of(listed, scenes, MOST_BYTES if n_views is None else math.inf)
    scale, unit = time_unit(run)
    advice, heat = interval_advice(run), heat_map(run)
    data = _data(run, events, views, advice)
    data["heat"] = heat_data(run, heat, scale)
    context = {
        "run": run,
        "summary": run.summary,
        "headline": headline(run.summary).split(": ", 1)[1],
        "verdict_shape": VERDICT_SHAPES[run.summary.verdict.value],
        "states": _state_rows(run),
        "answers": answers(run, events, advice),
        "strand_cards": strand_cards(run),
        "pair_cards": pair_cards(run),
        "most_cards": MOST_CARDS,
        "most_folded": MOST_FOLDED,
        "events": [_event_row(run, event, views) for event in listed],
        "n_more": len(events) - len(listed),
        "n_viewable": sum(event.has_view for event in events),
        "n_views": len(views),
        "advice": advice,
        "percent": percent,
        "no_views": no_views,
        "unit": unit,
        "scale": scale,
        "coverage": _coverage(run),
        "inputs": run.results.provenance.get("inputs", []),
        "provenance": run.results.provenance,
        "gaps": run.results.strands.gaps,
        "curve": run.summary.curve,
        "figure": figure,
        "heat": heat,
        "heat_picture": "" if heat is None else heat_picture(run, heat, scale, data["x_title"]),
        "closest": closest_places(run),
        "data": script_json(data),
    }
    return render_template("run.html.j2", context | {"script": _own("page.js"), "plotly": _plotly()})


def render_template(name: str, context: Mapping[str, Any]) -> str:
    """Return a template filled with what it needs; every text is escaped but our own style and script."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("mdtopo.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name).render(**context, style=_own("style.css"))


def _own(name: str) -> Any:
    from markupsafe import Markup

    return Markup((files("mdtopo.report") / "templates" / name).read_text("utf-8"))


def _plotly() -> Any:
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    return Markup(get_plotlyjs().replace("</script", "<\\/script"))


def script_json(values: Any) -> Any:
    """Return JSON that no text in it can end the script element of: marked as safe for the template."""
    from markupsafe import Markup

    text = json.dumps(values, ensure_ascii=True, allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def figure(value: float, unit: str = "", digits: int = 4) -> Any:
    """Return a number with its unit as an HTML ``data`` element, which keeps the value as the results file has it."""
    from markupsafe import Markup

    if value is None or np.isnan(value):
        return Markup("—")
    text = "∞" if np.isinf(value) else f"{value:.{digits}g}"
    return Markup('<data value="{}">{}</data>{}').format(repr(float(value)), text, f" {unit}" if unit else "")


def time_unit(run: RunData) -> tuple[float, str]:
    """Return by what a time in ps is divided, and the unit that fits the run."""
    if not run.has_times:
        return 1.0, "ps"
    span = float(run.columns["time_t1"][-1] - run.columns["time_t0"][0])
    if span >= 2e6:
        return 1e6, "µs"
    return (1e3, "ns") if span >= 2e3 else (1.0, "ps")


def _state_rows(run: RunData) -> list[dict[str, Any]]:
    numbers = np.bincount(run.states, minlength=len(StepState)).tolist()
    return [
        {
            "shape": SHAPES[state][0],
            "colour": SHAPES[state][1],
            "name": word,
            "meaning": meaning,
            "count": numbers[state],
            "share": 100.0 * numbers[state] / run.n_steps if run.n_steps else 0.0,
        }
        for state, (word, meaning) in state_meanings(run.config).items()
    ]


def _event_row(run: RunData, event: Event, views: Mapping[str, View]) -> dict[str, Any]:
    atoms = sorted({vertex for edge in event.edges for vertex in edge})
    indices = run.results.strands.labels.atom_index[atoms].tolist() if atoms else []
    paths = [entry["path"] for entry in run.results.provenance.get("inputs", [])]
    options = run.results.request.get("reader_options") or {}
    shape, colour = SEVERITY_SHAPES[event.alert.severity]
    return {
        "alert": event.alert,
        "name": event.name,
        "curve": _curve_words(run, event),
        "severity": severity_word(event.alert.severity),
        "shape": shape,
        "colour": colour,
        "grade": event.grade,
        "crossing": event.crossing,
        "frames": event.frames,
        "span": event.span,
        "is_longer": event.frames is not None and event.span != event.frames,
        "snippets": snippets(paths, event.frames, indices, options) if event.frames else {},
        "view": views.get(event.alert.id),
    }


def _curve_words(run: RunData, event: Event) -> str:
    """Return what was found of the smooth curve in the step of an event; empty where it was not looked at."""
    row = run.row(event.alert.step_peak)
    if not run.has_curve or event.frames is None:
        return ""
    verdict, clearance = CurveVerdict(int(run.columns["curve_verdict"][row])), run.columns["curve_clearance"][row]
    if verdict is CurveVerdict.CERTIFIED:
        apart = f" (segments that share no point stay {clearance:.4g} Å apart)" if np.isfinite(clearance) else ""
        return f"proved not to pass in this step{apart}"
    return {CurveVerdict.CROSSING: "passes in this step", CurveVerdict.UNRESOLVED: "undecided in this step"}.get(
        verdict, ""
    )


def _coverage(run: RunData) -> dict[str, Any]:
    columns, strands = run.columns, run.results.strands
    stored = int(np.sum(columns["scope"] == 1))
    return {
        "n_frames": run.n_steps + 1 if run.n_steps else 0,
        "first": int(columns["frame_t0"][0]) if run.n_steps else None,
        "last": int(columns["frame_t1"][-1]) if run.n_steps else None,
        "strides": np.unique(columns["frame_t1"] - columns["frame_t0"]).tolist()[:5],
        "unread": unread_frames(run),
        "spacing": run.spacing,
        "n_strands": strands.n_strands,
        "n_rings": int(np.sum(strands.closed)),
        "n_vertices": strands.n_vertices,
        "n_jumps": int(np.sum(columns["image_jumps"] > 0)),
        "stored_only": stored,
        "eta": run.config.coordinate_error,
    }


def _data(
    run: RunData, events: list[Event], views: Mapping[str, View], advice: IntervalAdvice | None
) -> dict[str, Any]:
    """Return what the script draws, ready for JSON; arrays are little-endian bytes in base64."""
    starts = bin_starts(run.n_steps)
    scale, unit = time_unit(run)
    ends = np.append(starts[1:], run.n_steps) - 1
    if run.has_times:
        x = 0.5 * (run.columns["time_t0"][starts] + run.columns["time_t1"][ends]) / scale
    else:
        x = run.results.first_step + 0.5 * (starts + ends)
    series = {}
    for name in ("clearance", "pair_ratio", "nu_ratio"):
        e = envelope(run.columns[name], starts)
        series[name] = {
            "least": packed(e.least, "<f8"),
            "least_step": packed(e.least_row + run.results.first_step, "<i4"),
            "greatest": packed(e.greatest, "<f8"),
            "greatest_step": packed(e.greatest_row + run.results.first_step, "<i4"),
        }
    return {
        "x": packed(x, "<f8"),
        "x_title": f"time ({unit})" if run.has_times else "step",
        "first_step": run.results.first_step,
        "states": packed(worst_states(run.states, starts), "<i1"),
        "state_names": [word for word, _ in state_meanings(run.config).values()],
        "state_colours": [colour for _, colour in SHAPES.values()],
        "series": series,
        "criterion": run.config.criterion,
        "near_limit": run.config.near_limit,
        "alerts": _markers(run, events, scale),
        "curve_name": f"smooth curve ({'has a verdict of its own' if run.has_curve else 'drawn, not certified'})",
        "scenes": {
            event.alert.id: {**views[event.alert.id].data, "marked_strands": _marked_strands(run, event)}
            for event in events
            if event.alert.id in views
        },
        "interval": _interval_data(advice),
    }


def _marked_strands(run: RunData, event: Event) -> list[str]:
    """Return the strand of each marked edge."""
    strands = run.results.strands
    return [strands.names[strands.strand_of_vertex[edge[0]]] for edge in event.edges]


def _markers(run: RunData, events: list[Event], scale: float) -> list[dict[str, Any]]:
    """Return one marker for each alert; of a crowd, one for each place that differs on a screen, with their number."""
    timed = [event for event in events if event.frames is not None]
    width = max(1, run.n_steps)
    crowd: dict[tuple[str, int], dict[str, Any]] = {}
    for event in timed:  # the worst comes first, so it is the one that is shown
        alert = event.alert
        place = alert.step_peak if len(timed) <= MOST_MARKERS else run.row(alert.step_peak) * PLACES // width
        key = (event.name, place)
        if key in crowd:
            crowd[key]["n"] += 1
            continue
        x = 0.5 * (event.times[0] + event.times[1]) / scale if run.has_times else float(alert.step_peak)
        crowd[key] = {
            "kind": alert.kind.value,
            "lane": "curve" if event.about_curve else alert.kind.value,
            "severity": severity_word(alert.severity),
            "x": x,
            "step": alert.step_peak,
            "n": 1,
            "text": alert.message if len(crowd) < MOST_MESSAGES else f"step {alert.step_peak}",
        }
    return list(crowd.values())


def _interval_data(advice: IntervalAdvice | None) -> dict[str, Any] | None:
    if advice is None:
        return None
    return {
        "x": advice.spacings.tolist(),
        "ball": (100.0 * advice.by_ball).tolist(),
        "pairs": (100.0 * advice.by_pairs).tolist(),
        "spacing": advice.spacing,
    }
