"""The report: one self-contained page for a run, made from its results file and, where it is there, the trajectory."""

from mdtopo.report.events import Event, ranked_events
from mdtopo.report.page import render_page
from mdtopo.report.rundata import RunData
from mdtopo.report.scene import Scene, event_scene, step_path

__all__ = ["Event", "RunData", "Scene", "event_scene", "ranked_events", "render_page", "step_path"]
