"""How far a stored coordinate may be from the one that the engine had, by file format."""

from typing import Any

HALF_SPACING = 2.0**-24
"""Half the relative spacing of float32, in which MDAnalysis holds every coordinate."""

NM_ROUNDINGS = 3
"""Roundings to float32 on the way from nm to Å: the stored value, the one decoded from it, and the product
with 10."""

TEXT_STEPS = {
    "GRO": 0.01,
    "PDB": 0.001,
    "ENT": 0.001,
    "XPDB": 0.001,
    "PDBQT": 0.001,
    "TRJ": 0.001,
    "MDCRD": 0.001,
    "CRDBOX": 0.001,
    "MOL2": 0.0001,
}
"""Å between neighbouring values of formats with a fixed number of decimals."""

XTC_STEP = 0.01
"""Å between neighbouring values of an XTC file at its usual precision of 1000 per nm."""

DUMP_HALF_STEP = 5e-6
"""Half a step of LAMMPS's default text format ``%g``, six digits, relative to a coordinate or to the box."""


def coordinate_error(trajectory: Any, largest: float) -> float:
    """Return η: how far a stored atom may be from where the engine had it, Å.

    A coordinate that is stored in steps of s is off by at most s/2, and by 2⁻²⁴ of itself for each rounding
    to float32; the atom is off by √3 times their sum. Formats that are not known count as float32.

    Parameters
    ----------
    trajectory : MDAnalysis reader
        Of a single file, or a chain of files, of which the coarsest counts.
    largest : float
        Largest coordinate of the selected atoms in the first frame, by magnitude, Å; for the rounding to
        float32 alone.
    """
    parts = getattr(trajectory, "readers", [trajectory])
    return float(max(3.0**0.5 * _half_step(part, largest) for part in parts))


def _half_step(trajectory: Any, largest: float) -> float:
    name = str(trajectory.format if isinstance(trajectory.format, str) else trajectory.format[0]).upper()
    in_nm = (getattr(trajectory, "units", None) or {}).get("length") == "nm"
    rounding = HALF_SPACING * largest * (NM_ROUNDINGS if in_nm else 1)
    if name == "XTC":
        return _xtc_step(trajectory) / 2.0 + rounding
    if name == "LAMMPSDUMP":
        box = trajectory.ts.dimensions
        return DUMP_HALF_STEP * max(largest, 0.0 if box is None else float(max(box[:3]))) + rounding
    return TEXT_STEPS.get(name, 0.0) / 2.0 + rounding


def _xtc_step(trajectory: Any) -> float:
    """Return the step of an XTC file, Å, from the precision that its first frame states."""
    with type(trajectory._xdr)(str(trajectory.filename)) as file:
        precision = float(file.read().prec)
    nm = 10.0 if trajectory.convert_units else 1.0
    return nm / precision if precision > 0.0 else XTC_STEP  # fewer than ten atoms are stored as float32
