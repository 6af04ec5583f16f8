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

XTC_MAGICS = {1995: (4, ">i"), 2023: (8, ">q")}
"""The first number of a frame of XTC, and how the size of its packed coordinates is stored; 2023: large systems."""

XTC_BOX_END, XTC_SIZE, MOST_UNPACKED = 52, 88, 9
"""Bytes up to the number of atoms, and up to the size of the packed coordinates, which so many atoms do not have."""

TRR_MAGIC = 1993
LONGEST_XDR_HEAD = 256


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


def spare_xdr_bytes(path: Path, last_frame: int) -> int:
    """Return how many bytes follow the last frame of an XTC or TRR file; 0 where it is cut off itself, or is neither.

    Parameters
    ----------
    path : Path
        The file.
    last_frame : int
        Where the last frame begins that MDAnalysis counts. It counts one that is cut off, and then fails to read it,
        but not one of which less than its header is there.
    """
    with path.open("rb") as file:
        file.seek(last_frame)
        head = file.read(LONGEST_XDR_HEAD)
    try:
        length = _xdr_frame_length(head)
    except struct.error:  # the head itself is not all there
        return 0
    return max(path.stat().st_size - last_frame - length, 0) if length else 0


def _xdr_frame_length(head: bytes) -> int:
    """Return the length of a frame by how it begins, 0 if it is none; the formats are those of GROMACS' xdrfile."""
    (magic,) = struct.unpack_from(">i", head)
    if magic in XTC_MAGICS:
        (n_atoms,) = struct.unpack_from(">i", head, XTC_BOX_END)
        if n_atoms <= MOST_UNPACKED:
            return int(XTC_BOX_END + 4 + 12 * n_atoms)
        size, code = XTC_MAGICS[magic]
        (packed,) = struct.unpack_from(code, head, XTC_SIZE)
        return int(XTC_SIZE + size + (packed + 3) // 4 * 4)
    if magic != TRR_MAGIC:
        return 0
    (text,) = struct.unpack_from(">i", head, 8)
    numbers = 12 + (text + 3) // 4 * 4
    *sizes, n_atoms, _, _ = struct.unpack_from(">13i", head, numbers)
    is_double = sizes[2] == 9 * 8 or any(size == 3 * 8 * n_atoms for size in sizes[7:])
    return int(numbers + 13 * 4 + (16 if is_double else 8) + sum(sizes))


def spare_xyz_lines(path: Path, n_atoms: int) -> int:
    """Return how many lines follow the last whole frame of a plain XYZ file, blank ones left aside."""
    lines = blank = 0
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            text = block.rstrip()
            lines += block.count(b"\n", 0, len(text)) + (blank if text else 0)
            blank = block.count(b"\n", len(text)) + (0 if text else blank)
    return (lines + 1) % (n_atoms + 2)
