"""Proves that no strand passed through another between two frames of a molecular trajectory, or says where one did.

Lengths are in Å, times in ps, angles in degrees. The whole job is `monitor`; a stream of steps is `steps`; one step of
your own arrays is `polyline_step`. Names are loaded when they are first used, so that ``import mdtopo`` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mdtopo.analysis import IsotopyAnalysis
    from mdtopo.approximation import approximate
    from mdtopo.curvestep import curve_embedding, curve_step
    from mdtopo.errors import AuditError, InputError, MdtopoError, OutputError
    from mdtopo.geometry.hull import d_star
    from mdtopo.geometry.knots import knot_determinant
    from mdtopo.geometry.linking import linking_number, writhe
    from mdtopo.pipeline import monitor, steps
    from mdtopo.polyline import nu, polyline_step
    from mdtopo.records import (
        Alert,
        AlertKind,
        Approximation,
        CompositeBezier,
        Crossing,
        CurveReport,
        CurveVerdict,
        Grade,
        Isotopy,
        MonitorConfig,
        PairClass,
        ParametricCurve,
        Reason,
        Rung,
        RunSummary,
        RunVerdict,
        Scope,
        Severity,
        StepReport,
        Strands,
        Tube,
        TubeLimit,
        TubeTerm,
        Verdict,
    )
    from mdtopo.sametype import SameType, same_type
    from mdtopo.smooth import spline_curve
    from mdtopo.store import read_results
    from mdtopo.tubes import tube

__version__ = "0.1.0"

_HOMES = {
    "Alert": "records",
    "AlertKind": "records",
    "Approximation": "records",
    "AuditError": "errors",
    "CompositeBezier": "records",
    "Crossing": "records",
    "CurveReport": "records",
    "CurveVerdict": "records",
    "Grade": "records",
    "InputError": "errors",
    "Isotopy": "records",
    "IsotopyAnalysis": "analysis",
    "MdtopoError": "errors",
    "MonitorConfig": "records",
    "OutputError": "errors",
    "PairClass": "records",
    "ParametricCurve": "records",
    "Reason": "records",
    "RunSummary": "records",
    "RunVerdict": "records",
    "Rung": "records",
    "SameType": "sametype",
    "Scope": "records",
    "Severity": "records",
    "StepReport": "records",
    "Strands": "records",
    "Tube": "records",
    "TubeLimit": "records",
    "TubeTerm": "records",
    "Verdict": "records",
    "approximate": "approximation",
    "curve_embedding": "curvestep",
    "curve_step": "curvestep",
    "d_star": "geometry.hull",
    "knot_determinant": "geometry.knots",
    "linking_number": "geometry.linking",
    "monitor": "pipeline",
    "nu": "polyline",
    "polyline_step": "polyline",
    "read_results": "store",
    "same_type": "sametype",
    "spline_curve": "smooth",
    "steps": "pipeline",
    "tube": "tubes",
    "writhe": "geometry.linking",
}

__all__ = [
    "Alert",
    "AlertKind",
    "Approximation",
    "AuditError",
    "CompositeBezier",
    "Crossing",
    "CurveReport",
    "CurveVerdict",
    "Grade",
    "InputError",
    "Isotopy",
    "IsotopyAnalysis",
    "MdtopoError",
    "MonitorConfig",
    "OutputError",
    "PairClass",
    "ParametricCurve",
    "Reason",
    "RunSummary",
    "RunVerdict",
    "Rung",
    "SameType",
    "Scope",
    "Severity",
    "StepReport",
    "Strands",
    "Tube",
    "TubeLimit",
    "TubeTerm",
    "Verdict",
    "__version__",
    "approximate",
    "curve_embedding",
    "curve_step",
    "d_star",
    "knot_determinant",
    "linking_number",
    "monitor",
    "nu",
    "polyline_step",
    "read_results",
    "same_type",
    "spline_curve",
    "steps",
    "tube",
    "writhe",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'mdtopo' has no attribute {name!r}")
    value = getattr(import_module(f"mdtopo.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
