"""Whether a file was cut off, where MDAnalysis does not say so."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

BLOCK = 1 << 20
"""Bytes that are read at once to count lines."""

FIRST_RECORD = 84
"""Bytes in the first record of a DCD file: the word CORD and twenty integers."""

CELL_BYTES = 48 + 8
"""A frame's record of the cell: six doubles between two markers."""


@dataclass(frozen=True, slots=True)
class DcdSize:
    """What the header and the size of a DCD file say of its number of frames.

    Attributes
    ----------
    declared : int
        Frames that the header declares; 0 where it declares none.
    spare_bytes : int
        Bytes after the last whole frame: more than none if the file ends within a frame.
    """

    declared: int
    spare_bytes: int


def dcd_size(path: Path) -> DcdSize | None:
    """Return what a DCD file says of its length; None if it is no plain DCD (fixed atoms, 8-byte markers).

    MDAnalysis counts whole frames by the size of the file, so one that was cut off merely looks shorter. What
    the header declares is a hint: LAMMPS, NAMD and OpenMM keep it up to date, CHARMM writes its plan. A file
    that ends within a frame was cut off for certain.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(4 + FIRST_RECORD + 4)
        order = _byte_order(head)
        if order is None:
            return None
        numbers = struct.unpack(order + "20i", head[8 : 8 + 80])
        declared, n_fixed, has_cell, is_charmm = numbers[0], numbers[8], numbers[10], numbers[19]
        if n_fixed or (is_charmm and numbers[11]):
            return None
        _skip_record(file, order)  # the titles
        n_atoms = struct.unpack(order + "i", _skip_record(file, order))[0]
        start = file.tell()
    frame = 3 * (4 * n_atoms + 8) + (CELL_BYTES if is_charmm and has_cell else 0)
    return DcdSize(max(declared, 0), (size - start) % frame)


def _byte_order(head: bytes) -> str | None:
    if len(head) < 8 + 80 or head[4:8] != b"CORD":
        return None
    return next((order for order in "<>" if struct.unpack(order + "i", head[:4])[0] == FIRST_RECORD), None)


def _skip_record(file: BinaryIO, order: str) -> bytes:
    (length,) = struct.unpack(order + "i", file.read(4))
    content = file.read(length)
    file.read(4)
    return content


def spare_xyz_lines(path: Path, n_atoms: int) -> int:
    """Return how many lines follow the last whole frame of a plain XYZ file, blank ones left aside."""
    lines = blank = 0
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            text = block.rstrip()
            lines += block.count(b"\n", 0, len(text)) + (blank if text else 0)
            blank = block.count(b"\n", len(text)) + (0 if text else blank)
    return (lines + 1) % (n_atoms + 2)
