"""Strands and their curves for other programs: frames as VTKHDF, PDB or XYZ, moments between them too."""

from mdtopo.export.curves import CurveSnapshot, curve_snapshot
from mdtopo.export.motion import in_between, vertex_bounds, whole_positions
from mdtopo.export.snapshots import Snapshot
from mdtopo.export.text import write_curve_pdb, write_curve_xyz, write_pdb, write_xyz
from mdtopo.export.vtkhdf import write_curve_vtkhdf, write_vtkhdf

__all__ = [
    "CurveSnapshot",
    "Snapshot",
    "curve_snapshot",
    "in_between",
    "vertex_bounds",
    "whole_positions",
    "write_curve_pdb",
    "write_curve_vtkhdf",
    "write_curve_xyz",
    "write_pdb",
    "write_vtkhdf",
    "write_xyz",
]
