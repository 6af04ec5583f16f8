"""Strands for other programs: frames of polylines as VTKHDF, PDB or XYZ, in between frames too."""

from mdtopo.export.motion import in_between, whole_positions
from mdtopo.export.snapshots import Snapshot
from mdtopo.export.text import write_pdb, write_xyz
from mdtopo.export.vtkhdf import write_vtkhdf

__all__ = ["Snapshot", "in_between", "whole_positions", "write_pdb", "write_vtkhdf", "write_xyz"]
