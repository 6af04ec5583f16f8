"""One results file out of step tables that have been measured: alerts and summary are worked out from them again."""

from collections.abc import Iterable
from pathlib import Path

from mdtopo.alerts import AlertStream
from mdtopo.bonds import BondState
from mdtopo.pipeline.alertfile import AlertFile
from mdtopo.pipeline.tally import Tally
from mdtopo.records import Alert, RunSummary, StepTable
from mdtopo.store import Head


def assemble(
    path: Path,
    head: Head,
    tables: Iterable[StepTable],
    bonds: tuple[BondState, BondState],
    *,
    stopped: str = "",
    overwrite: bool = False,
    folder: Path | None = None,
    alert_file: AlertFile | None = None,
) -> RunSummary:
    """Write a results file, and return its summary.

    Parameters
    ----------
    path : Path
        The file; it appears when it is whole.
    head : Head
        What it begins with.
    tables : iterable of StepTable
        All steps, in order.
    bonds : tuple of BondState
        At the first frame, and at the last one.
    stopped : str
        Why there are no more steps, in words; empty where these are all.
    overwrite, folder
        As for `ResultsWriter.create`.
    alert_file : AlertFile, optional
        Where the alerts go beside the file.

    Raises
    ------
    OutputError
        If it cannot be written; nothing stays behind then.
    """
    stream, tally = AlertStream(head.strands, head.config), Tally(head.config, head.strands)
    writer = head.writer(path, overwrite=overwrite, folder=folder)

    def say(alerts: Iterable[Alert]) -> None:
        """Count alerts, and write them to the results and to the stream."""
        for alert in alerts:
            tally.alerts[alert.severity] += 1
            writer.append_alert(alert)
            if alert_file is not None:
                alert_file.write(alert)

    try:
        say(stream.opening())
        for table in tables:
            tally.add(table)
            writer.append(table)
            say(stream.after(table))
        say(stream.finish())
        summary = tally.summary(path, stopped)
        writer.add_bonds(*bonds)
        writer.finish(summary.to_mapping(), complete=not stopped)
    finally:
        writer.abort()  # after finish it does nothing
    return summary
