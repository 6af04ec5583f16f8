"""Stored results under another near-limit threshold: which alerts a run with that threshold would have raised."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from mdtopo.alerts import PAIR_COLUMN, AlertStream, alert_order
from mdtopo.records import Alert, AlertKind, Crossings, MonitorConfig, StepTable, Stretches
from mdtopo.states import CRITERION_COLUMN
from mdtopo.store import Results

BLOCK_ROWS = 4096
"""Rows that are looked at together; the alerts do not depend on it."""

PLACE_COLUMNS = ("frame_t0", "frame_t1", "time_t0", "time_t1")


def needed_columns(config: MonitorConfig) -> tuple[str, ...]:
    """Return the names of the step columns that `rethresholded` needs."""
    return *PLACE_COLUMNS, CRITERION_COLUMN[config.criterion], PAIR_COLUMN[config.criterion]


def rethresholded(results: Results, config: MonitorConfig) -> list[Alert]:
    """Return the alerts of a run with the near-limit ones drawn anew, in the order in which a run says them.

    Parameters
    ----------
    results : Results
        With the columns that `needed_columns` names.
    config : MonitorConfig
        The run's configuration, but for `criterion` and `near_limit`.

    Guarantee
    ---------
    Of a run that was looked at to its end, the alerts are those that a run with this configuration raises, and with the
    stored configuration those that are stored: the same code finds and merges them. A run that was interrupted has not
    said the event that was open then; here it is said.
    """
    stream = AlertStream(results.strands, config, kinds={AlertKind.NEAR_LIMIT})
    near = [alert for table in _tables(results, config) for alert in stream.after(table)]
    near += stream.finish()
    kept = [alert for alert in results.alerts if alert.kind is not AlertKind.NEAR_LIMIT]
    return sorted(kept + near, key=lambda alert: alert_order(alert, config.merge_steps))


def _tables(results: Results, config: MonitorConfig) -> Iterator[StepTable]:
    """Yield step tables with the columns that matter, block by block; all others are zero, and nobody looks at them."""
    names = needed_columns(config)
    for start in range(0, len(results.steps["frame_t0"]), BLOCK_ROWS):
        stored = {name: results.steps[name][start : start + BLOCK_ROWS] for name in names}
        n = len(stored["frame_t0"])
        columns: dict[str, Any] = {
            c.name: stored.get(c.name, np.zeros((n, *c.shape), dtype=c.dtype)) for c in StepTable.columns()
        }
        yield StepTable(
            first_step=results.first_step + start,
            stretches=Stretches.none(),
            broken=(),
            problems=("",) * n,
            crossings=Crossings.none(),
            curve_crossings=Crossings.none(),
            **columns,
        )
