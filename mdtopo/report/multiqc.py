"""What MultiQC takes of a run: general statistics, a table of verdicts, and the envelope of the clearance."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from mdtopo.report.envelope import bin_starts, envelope
from mdtopo.report.rundata import RunData

MOST_POINTS = 500
"""MultiQC thins a series of more points, and would lose the one step that matters."""

PARENT = {
    "parent_id": "mdtopo",
    "parent_name": "mdtopo",
    "parent_description": "Whether any strand passed through another",
}


def multiqc_files(run: RunData, sample: str) -> Mapping[str, str]:
    """Return the text of each ``*_mqc.json`` by the middle of its name.

    Parameters
    ----------
    run : RunData
    sample : str
        Name of the run; files of several runs join by the ids of their sections.
    """
    return {name: json.dumps(value, allow_nan=False, indent=1) for name, value in _sections(run, sample).items()}


def _sections(run: RunData, sample: str) -> dict[str, Any]:
    summary, counts = run.summary, run.summary.counts
    general = {"clearance": _finite(summary.clearance), "crossed": counts.crossed, "unresolved": counts.unresolved}
    rows = {
        "verdict": summary.verdict.value,
        "steps": counts.steps,
        "ball": counts.ball,
        "pairs": counts.pairs,
        "near_limit": counts.near_limit,
        "unresolved": counts.unresolved,
        "crossed": counts.crossed,
        "broken_edges": summary.n_fractures,
    }
    if summary.curve is not None:
        rows |= {f"curve_{name}": getattr(summary.curve, name) for name in ("certified", "unresolved", "crossed")}
    starts = bin_starts(run.n_steps, MOST_POINTS)
    band = envelope(run.columns["clearance"], starts)
    x = (run.columns["time_t0"][starts] if run.has_times else run.results.first_step + starts).tolist()
    lines = {
        # pairs, because MultiQC sorts the keys of an object as text: 10 before 2
        f"{sample} {word}": [[at, float(value)] for at, value in zip(x, values, strict=True) if np.isfinite(value)]
        for word, values in (("least", band.least), ("greatest", band.greatest))
    }
    return {
        "general": {
            "id": "mdtopo_general",
            "plot_type": "generalstats",
            "pconfig": [
                {"clearance": {"title": "clearance", "description": "least proved clearance, Å", "format": "{:,.4f}"}},
                {"crossed": {"title": "crossed", "description": "steps with a crossing", "format": "{:,.0f}"}},
                {"unresolved": {"title": "unresolved", "description": "steps not decided", "format": "{:,.0f}"}},
            ],
            "data": {sample: {key: value for key, value in general.items() if value is not None}},
        },
        "verdict": {
            **PARENT,
            "id": "mdtopo_verdict",
            "section_name": "Verdict",
            "description": "The five counts add up to the number of steps.",
            "plot_type": "table",
            "pconfig": {"id": "mdtopo_verdict_table", "title": "mdtopo: verdict"},
            "data": {sample: rows},
        },
        "clearance": {
            **PARENT,
            "id": "mdtopo_clearance",
            "section_name": "Clearance",
            "description": "Least and greatest proved clearance of each part of the run; no step is left out.",
            "plot_type": "linegraph",
            "pconfig": {
                "id": "mdtopo_clearance_plot",
                "title": "mdtopo: clearance",
                "xlab": "time (ps)" if run.has_times else "step",
                "ylab": "clearance (Å)",
            },
            "data": lines,
        },
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
