"""The report: one self-contained page for a run, made from its results file and, where it is there, the trajectory."""

from mdtopo.report.events import Event, event_place, ranked_events
from mdtopo.report.multiqc import multiqc_files
from mdtopo.report.overview import OverviewRow, render_overview
from mdtopo.report.page import render_page
from mdtopo.report.rundata import CURVE_COLUMNS, NEEDED, RunData
from mdtopo.report.scene import Scene, event_scene, step_path

__all__ = [
    "CURVE_COLUMNS",
    "NEEDED",
    "Event",
    "OverviewRow",
    "RunData",
    "Scene",
    "event_place",
    "event_scene",
    "multiqc_files",
    "ranked_events",
    "render_overview",
    "render_page",
    "step_path",
]
