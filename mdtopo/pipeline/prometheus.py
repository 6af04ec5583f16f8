"""How far a watched run has come, as a text file for Prometheus' node exporter."""

import math
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from mdtopo.errors import OutputError
from mdtopo.records import RunSummary, RunVerdict

_Sample = tuple[dict[str, str], float]


def write_metrics(path: Path, summary: RunSummary, *, run: str, is_running: bool) -> None:
    """Replace the file by the numbers of a run. Whoever reads it sees the old file or the new one, never half of one.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    waiting = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        waiting.write_text(metrics_text(summary, run=run, is_running=is_running), encoding="utf-8")
        waiting.replace(path)
    except OSError as error:
        waiting.unlink(missing_ok=True)
        raise OutputError(f"The metrics file {path} cannot be written: {error.strerror}.") from error


def metrics_text(summary: RunSummary, *, run: str, is_running: bool) -> str:
    """Return the numbers of a run in the text format of Prometheus.

    Parameters
    ----------
    summary : RunSummary
        What the run has come to so far.
    run : str
        Value of the label ``run``.
    is_running : bool
        Whether more may come.
    """
    counts = {name: float(number) for name, number in asdict(summary.counts).items()}
    alerts = {severity.name.lower(): float(number) for severity, number in summary.alerts.items()}
    verdicts = {verdict.value: float(verdict is summary.verdict) for verdict in RunVerdict}
    metrics: list[tuple[str, str, str, list[_Sample]]] = [
        ("steps_total", "counter", "Steps measured.", [({}, float(summary.n_steps))]),
        ("outcome_steps_total", "counter", "Steps by outcome; they add up to all steps.", _by("outcome", counts)),
        ("alerts_total", "counter", "Alerts raised, by severity.", _by("severity", alerts)),
        ("broken_edges_total", "counter", "Edges that broke.", [({}, float(summary.n_fractures))]),
        ("least_clearance_angstroms", "gauge", "Least proven clearance so far.", [({}, summary.clearance)]),
        ("greatest_pair_ratio", "gauge", "Greatest motion of a pair over its limit.", [({}, summary.ratio)]),
        ("verdict", "gauge", "1 for the verdict of the steps so far, 0 for the others.", _by("verdict", verdicts)),
        ("running", "gauge", "1 while the run is watched, 0 when it has ended.", [({}, float(is_running))]),
    ]
    if summary.curve is not None:
        curve = {name: float(getattr(summary.curve, name)) for name in ("certified", "unresolved", "crossed")}
        help_text = "Steps by outcome for the smooth curve; they add up to all steps."
        metrics.insert(2, ("curve_outcome_steps_total", "counter", help_text, _by("outcome", curve)))
    return "".join(line for metric in metrics for line in _lines(*metric, run=run))


def _by(label: str, values: dict[str, float]) -> list[_Sample]:
    return [({label: name}, value) for name, value in values.items()]


def _lines(name: str, kind: str, help_text: str, samples: list[_Sample], *, run: str) -> Iterator[str]:
    yield f"# HELP mdtopo_{name} {help_text}\n# TYPE mdtopo_{name} {kind}\n"
    for labels, value in samples:
        inside = ",".join(f'{label}="{_escaped(text)}"' for label, text in {"run": run, **labels}.items())
        yield f"mdtopo_{name}{{{inside}}} {'NaN' if math.isnan(value) else format(value, '.17g')}\n"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
