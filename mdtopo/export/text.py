"""Strands as text: a PDB file with a model for each moment, or XYZ."""

import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

import numpy as np

from mdtopo.errors import OutputError
from mdtopo.export.curves import CurveSnapshot
from mdtopo.export.snapshots import Snapshot
from mdtopo.records import Strands
from mdtopo.typing import Indices

MOST_ATOMS = 99_999
"""A serial number has five columns."""

MOST_MODELS = 9_999
"""A model number has four columns."""

COORDINATES = (-999.999, 9999.999)
"""A coordinate has eight columns, three of them behind the point."""

CHAINS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789"


def write_pdb(path: Path, strands: Strands, edges: Indices, snapshots: Iterable[Snapshot], remarks: list[str]) -> int:
    """Write a PDB file (format 3.3) with one MODEL for each snapshot, CONECT records for edges; return their number.

    Raises
    ------
    OutputError
        If atoms or coordinates do not fit the columns, or the file cannot be written.
    """
    if strands.n_vertices > MOST_ATOMS:
        raise OutputError(
            f"PDB holds {MOST_ATOMS} atoms, and there are {strands.n_vertices} vertices; use xyz or vtkhdf."
        )
    count = 0
    with path.open("w", encoding="ascii", errors="replace") as file:
        file.writelines(_remark(text) for text in remarks)
        atoms = [_atom_start(strands, v) for v in range(strands.n_vertices)]
        for count, snapshot in enumerate(snapshots, start=1):
            _write_model(file, count, snapshot, atoms)
        file.writelines(f"CONECT{a + 1:5d}{b + 1:5d}\n" for a, b in edges.tolist())
        file.write("END\n")
    return count


def _write_model(file: IO[str], number: int, snapshot: Snapshot, atoms: list[str]) -> None:
    x = snapshot.positions
    if number > MOST_MODELS:
        raise OutputError(f"PDB holds {MOST_MODELS} models, and there are more; choose fewer frames, or vtkhdf.")
    if not ((x > COORDINATES[0]) & (x < COORDINATES[1])).all():
        raise OutputError(
            f"A coordinate of {snapshot.title} does not fit the columns of PDB ({COORDINATES[0]} to {COORDINATES[1]} "
            "Å); use xyz or vtkhdf."
        )
    file.write(f"MODEL     {number:4d}\n")
    for start, (a, b, c) in zip(atoms, x.tolist(), strict=True):
        file.write(f"{start}{a:8.3f}{b:8.3f}{c:8.3f}{1.0:6.2f}{0.0:6.2f}{'':10}{'C':>2}\n")
    file.write("ENDMDL\n")


def _atom_start(strands: Strands, v: int) -> str:
    labels, strand = strands.labels, int(strands.strand_of_vertex[v])
    name = (str(labels.atom[v]) or "C")[:4]
    name = name if len(name) == 4 else f" {name:<3}"
    resname, icode = (str(labels.resname[v]) or "UNK")[:3], (str(labels.icode[v]) or " ")[:1]
    # residue numbers have four columns; beyond them they begin again, as is usual
    resid = int(labels.resid[v])
    resid = resid if -999 <= resid <= 9999 else resid % 10_000
    return f"ATOM  {v + 1:5d} {name} {resname:>3} {CHAINS[strand % len(CHAINS)]}{resid:4d}{icode}   "


def _remark(text: str) -> str:
    plain = "".join(c if c.isprintable() else "?" for c in text.replace("Å", "A"))
    return "".join(f"REMARK 250 {line}\n" for line in textwrap.wrap(plain, 68))


def write_xyz(path: Path, strands: Strands, snapshots: Iterable[Snapshot]) -> int:
    """Write an XYZ file with all digits, one block for each snapshot; return their number."""
    count = 0
    with path.open("w", encoding="utf-8") as file:
        for snapshot in snapshots:
            file.writelines(_xyz_lines(strands, snapshot))
            count += 1
    return count


def _xyz_lines(strands: Strands, snapshot: Snapshot) -> Iterator[str]:
    yield f"{strands.n_vertices}\n"
    time = f", {snapshot.time!r} ps" if np.isfinite(snapshot.time) else ""
    proof = "a stored frame, or certified motion" if snapshot.is_proved else "NOT PROVED"
    yield f"{snapshot.title}{time}, {proof}\n"
    for x, y, z in snapshot.positions.tolist():
        yield f"C {x!r} {y!r} {z!r}\n"


def write_curve_xyz(path: Path, snapshots: Iterable[CurveSnapshot]) -> int:
    """Write an XYZ file of curves with all digits, one block for each snapshot; return their number.

    The second line of a block says whether the polyline is isotopic to its curve, and how many points each trace has.
    """
    count = 0
    with path.open("w", encoding="utf-8") as file:
        for snapshot in snapshots:
            kinds = zip(np.diff(snapshot.offsets).tolist(), snapshot.closed.tolist(), strict=True)
            traces = ", ".join(f"{n} {'closed' if ring else 'open'}" for n, ring in kinds)
            time = f", {snapshot.time!r} ps" if np.isfinite(snapshot.time) else ""
            proof = "isotopic to the curve" if snapshot.is_isotopic else "NOT KNOWN to be isotopic to the curve"
            file.write(f"{len(snapshot.positions)}\n")
            file.write(
                f"curve of {snapshot.title}{time}, {proof}, within {snapshot.chord_error:.6g} Å of it; "
                f"points of each trace: {traces}\n"
            )
            file.writelines(f"C {x!r} {y!r} {z!r}\n" for x, y, z in snapshot.positions.tolist())
            count += 1
    return count


def write_curve_pdb(path: Path, snapshot: CurveSnapshot, remarks: list[str]) -> int:
    """Write a PDB file of the curve of one frame; return 1.

    The models of a PDB file share their atoms, and the polyline of a curve has other points in each frame.

    Raises
    ------
    OutputError
        As for `write_pdb`.
    """
    points = Strands.from_lengths(np.diff(snapshot.offsets).tolist(), closed=snapshot.closed.tolist())
    proof = "is" if snapshot.is_isotopic else "is NOT KNOWN to be"
    remarks = [*remarks, f"The polyline {proof} isotopic to the curve: {snapshot.reason}."]
    closest = np.zeros(len(snapshot.positions), dtype=np.bool_)
    model = Snapshot(
        snapshot.title, snapshot.time, snapshot.positions, snapshot.polyline_clearance, closest, verdict=-1
    )
    return write_pdb(path, points, points.edges, [model], remarks)
