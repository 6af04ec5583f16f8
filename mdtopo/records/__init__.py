"""The values that flow from reader to report: frozen, validated once where they are made.

file → `Frame` → `FrameBlock` → `StepTable` (a `StepReport` is one row) → `Alert`. `Strands` says which vertices form
which strand and is constant over a run; `MonitorConfig` holds every knob.
"""

from mdtopo.records.alerts import Alert, AlertKind, Severity
from mdtopo.records.approximation import Approximation, Isotopy
from mdtopo.records.beziers import CompositeBezier
from mdtopo.records.config import Criterion, CurveChoice, MonitorConfig, Motion
from mdtopo.records.crossings import Crossing, Crossings, Grade, Shape
from mdtopo.records.curvecounts import CurveCounts
from mdtopo.records.curvesteps import CurveCrossing, CurvePlace, CurveReport
from mdtopo.records.frames import Frame, FrameBlock
from mdtopo.records.parametric import ParametricCurve
from mdtopo.records.profile import Profile
from mdtopo.records.reference import ReferenceLengths
from mdtopo.records.steps import (
    BrokenEdge,
    Column,
    CurveVerdict,
    PairClass,
    Reason,
    Rung,
    Scope,
    StepReport,
    StepTable,
    Stretches,
    Verdict,
)
from mdtopo.records.strands import Gap, Strands, VertexLabels
from mdtopo.records.summary import RunSummary, RunVerdict, StepCounts, StepState, run_verdict
from mdtopo.records.traces import Traces
from mdtopo.records.tube import Tube, TubeLimit, TubeTerm

__all__ = [
    "Alert",
    "AlertKind",
    "Approximation",
    "BrokenEdge",
    "Column",
    "CompositeBezier",
    "Criterion",
    "Crossing",
    "Crossings",
    "CurveChoice",
    "CurveCounts",
    "CurveCrossing",
    "CurvePlace",
    "CurveReport",
    "CurveVerdict",
    "Frame",
    "FrameBlock",
    "Gap",
    "Grade",
    "Isotopy",
    "MonitorConfig",
    "Motion",
    "PairClass",
    "ParametricCurve",
    "Profile",
    "Reason",
    "ReferenceLengths",
    "RunSummary",
    "RunVerdict",
    "Rung",
    "Scope",
    "Severity",
    "Shape",
    "StepCounts",
    "StepReport",
    "StepState",
    "StepTable",
    "Strands",
    "Stretches",
    "Traces",
    "Tube",
    "TubeLimit",
    "TubeTerm",
    "Verdict",
    "VertexLabels",
    "run_verdict",
]
