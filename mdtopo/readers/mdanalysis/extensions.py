"""Which file names are those of formats that MDAnalysis reads: known without importing it."""

from pathlib import Path

EXTENSIONS = frozenset(
    {
        *(
            "arc",
            "cif",
            "config",
            "coor",
            "crd",
            "crdbox",
            "data",
            "dcd",
            "dms",
            "ent",
            "fhiaims",
            "gms",
            "gro",
        ),
        *(
            "gsd",
            "h5md",
            "history",
            "in",
            "inpcrd",
            "itp",
            "lammps",
            "lammpsdump",
            "lammpstrj",
            "mdcrd",
            "mmcif",
        ),
        *("mmtf", "mol2", "namdbin", "nc", "ncdf", "parm7", "pdb", "pdbqt", "pqr", "prmtop", "psf", "restrt"),
        *("rst7", "tng", "top", "tpr", "trc", "trj", "trr", "trz", "txyz", "xml", "xpdb", "xtc", "xyz"),
    }
)
"""Extensions of the formats of MDAnalysis 2.11; other names need the reader's name and its format options."""

COMPRESSIONS = frozenset({".gz", ".bz2"})


def has_known_extension(path: Path) -> bool:
    """Return whether the extension of a file, compressed or not, is one that MDAnalysis reads."""
    plain = path.with_suffix("") if path.suffix.lower() in COMPRESSIONS else path
    return plain.suffix[1:].lower() in EXTENSIONS
