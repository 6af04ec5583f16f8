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

FRAMES_ONLY = frozenset({"dcd", "nc", "ncdf", "tng", "trr", "trz", "xtc"})
"""Extensions of formats that hold frames and never name their atoms."""

NAMING_ATOMS = frozenset(
    {
        *("cif", "data", "dms", "ent", "gro", "itp", "mmcif", "mmtf", "mol2", "parm7", "pdb", "pdbqt", "pqr"),
        *("prmtop", "psf", "top", "tpr", "xpdb"),
    }
)
"""Extensions of formats that name atoms, whether they hold coordinates or not."""

COMPRESSIONS = frozenset({".gz", ".bz2"})


def has_known_extension(path: Path) -> bool:
    """Return whether the extension of a file, compressed or not, is one that MDAnalysis reads."""
    return extension(path) in EXTENSIONS


def extension(path: Path) -> str:
    """Return the extension of a file in small letters, without the dot, and without that of a compression."""
    plain = path.with_suffix("") if path.suffix.lower() in COMPRESSIONS else path
    return plain.suffix[1:].lower()
