"""Alerts as text: JSON Lines, CSV, or a table for people."""

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from mdtopo.records.alerts import Alert, AlertKind

HEADINGS = ("severity", "kind", "steps", "peak", "frames", "time/ps", "value", "limit", "where")

SHOWN_LABELS = 4
"""Labels of vertices in a table: a pair of edges has four."""


class CurveTypeFields(NamedTuple):
    """Whether the drawn curve of an alert's strands has their own type at the start and the end of its worst step."""

    curve_type_start: str
    curve_type_end: str
    curve_type_reason: tuple[str, ...]


CurveTypes: TypeAlias = Mapping[str, CurveTypeFields]
"""By the id of the alert; alerts that are about no strand or step have none."""


def formatted(alerts: Sequence[Alert], form: str, types: CurveTypes | None = None) -> Iterator[str]:
    """Yield lines, with their ends; with what is known of the types of curves where that is asked for."""
    return FORMATS[form](alerts, types)


def _fields(alert: Alert, types: CurveTypes | None) -> dict[str, Any]:
    """Return the JSON fields of an alert."""
    if types is None:
        return alert.to_mapping()
    known = types.get(alert.id)
    more = known._asdict() if known is not None else dict.fromkeys(CurveTypeFields._fields)
    return {**alert.to_mapping(), **more}


def _json_lines(alerts: Iterable[Alert], types: CurveTypes | None) -> Iterator[str]:
    for alert in alerts:
        yield json.dumps(_fields(alert, types), ensure_ascii=False, allow_nan=False) + "\n"


def _csv_lines(alerts: Iterable[Alert], types: CurveTypes | None) -> Iterator[str]:
    """Yield one row for each alert under the names of the JSON fields; lists are joined by '; ', null is empty."""
    yield _csv_row(["schema", *Alert.__slots__, *(CurveTypeFields._fields if types is not None else ())])
    for alert in alerts:
        yield _csv_row([_cell(value) for value in _fields(alert, types).values()])


def _csv_row(cells: Iterable[Any]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return "; ".join(value)
    return "" if value is None else value


def _table_lines(alerts: Sequence[Alert], types: CurveTypes | None) -> Iterator[str]:
    """Yield a table with aligned columns; nothing but a heading where there is no alert."""
    rows = [HEADINGS, *(_table_row(alert) for alert in alerts)]
    if types is not None:
        column = ["curve's type", *(_types_cell(types.get(alert.id)) for alert in alerts)]
        rows = [(*row[:-1], cell, row[-1]) for row, cell in zip(rows, column, strict=True)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() + "\n"


def _types_cell(types: CurveTypeFields | None) -> str:
    if types is None:
        return "-"
    return " / ".join(word.replace("_", " ") for word in types[:2])


def _table_row(alert: Alert) -> tuple[str, ...]:
    of_steps = alert.kind is not AlertKind.GAP
    return (
        alert.severity.name.lower(),
        alert.kind.value,
        _span(alert.step_start, alert.step_end) if of_steps else "-",
        str(alert.step_peak) if of_steps else "-",
        _span(alert.frame_start, alert.frame_end) if of_steps else "-",
        _times(alert.time_start, alert.time_end),
        _number(alert.value),
        _number(alert.limit),
        _where(alert),
    )


def _span(first: int, last: int) -> str:
    return str(first) if first == last else f"{first}-{last}"


def _times(start: float, end: float) -> str:
    return f"{start:g}-{end:g}" if math.isfinite(start) and math.isfinite(end) else "-"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _where(alert: Alert) -> str:
    labels = list(alert.residues[:SHOWN_LABELS])
    if len(alert.residues) > SHOWN_LABELS:
        labels.append("...")
    return printable(" ".join(labels)) or "-"


def printable(text: str) -> str:
    """Return text that a terminal shows as it is: labels come from files, and may hold control characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


FORMATS: dict[str, Callable[[Sequence[Alert], CurveTypes | None], Iterator[str]]] = {
    "table": _table_lines,
    "jsonl": _json_lines,
    "csv": _csv_lines,
}
