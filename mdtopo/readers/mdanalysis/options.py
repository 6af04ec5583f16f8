"""The options of the MDAnalysis reader: what they are called, and their values from text or Python."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from mdtopo.errors import OptionError

STRAND_OPTIONS = frozenset({"cut", "use_bonds", "close_ends"})
"""Options that say how strands are found; they hold for a Universe too, which is open already."""

TRUE_WORDS = frozenset({"yes", "true", "on", "1"})
FALSE_WORDS = frozenset({"no", "false", "off", "0"})


@dataclass(frozen=True, slots=True)
class Options:
    """How to open files with MDAnalysis, and how to find strands; None leaves the choice to MDAnalysis.

    Attributes
    ----------
    topology_format, format : str or None
        Name of the format, such as ``PDB``, where the extension does not say it.
    atom_style : str or None
        Columns of the atoms in a LAMMPS data file, such as ``id type x y z``.
    dt, time_offset : float or None
        Time between frames and time of the first frame, ps, in place of what the file says.
    lengthunit, timeunit : str or None
        Units of a LAMMPS DCD (``format=LAMMPS``), such as ``nm`` and ``ps``.
    convert_units : bool
        False takes the numbers of the file as Å and ps, whatever their unit.
    continuous : bool
        Whether to drop the frames that trajectory parts have in common.
    guess_bonds : bool
        Whether to guess bonds from distances in the first frame.
    cut : float or None
        Longest edge where bonds are unknown, Å.
    use_bonds, close_ends : bool
        Whether the file's bonds are used, and whether strands without bonds are rings when their ends meet.
    """

    topology_format: str | None = None
    format: str | None = None
    atom_style: str | None = None
    dt: float | None = None
    time_offset: float | None = None
    lengthunit: str | None = None
    timeunit: str | None = None
    convert_units: bool = True
    continuous: bool = False
    guess_bonds: bool = False
    cut: float | None = None
    use_bonds: bool = True
    close_ends: bool = False

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], *, is_file: bool = True) -> "Options":
        """Return the options of a mapping of names to text or values.

        Parameters
        ----------
        values : mapping of str to str or object
            As from the command line, where all are text, or from Python.
        is_file : bool
            False for a Universe, which is open already: only `STRAND_OPTIONS` can still be chosen.

        Raises
        ------
        OptionError
            If a name is unknown, a value is no value of its option, or the option has no effect here.
        """
        for name in values:
            if name not in OPTION_HELP:
                known = ", ".join(OPTION_HELP)
                raise OptionError(f"Unknown option {name!r} of the MDAnalysis reader; the options are: {known}.")
            if not is_file and name not in STRAND_OPTIONS:
                raise OptionError(
                    f"The option {name!r} says how to open a file, but the input is open already; "
                    "give it to MDAnalysis.Universe."
                )
        chosen: dict[str, Any] = {name: _CONVERT[name](name, value) for name, value in values.items()}
        options = cls(**chosen)
        return options._checked()

    def _checked(self) -> "Options":
        if (self.lengthunit or self.timeunit) and (self.format or "").upper() != "LAMMPS":
            raise OptionError(
                "The options lengthunit and timeunit concern LAMMPS DCD files only; "
                "pass --reader-option format=LAMMPS too."
            )
        return self

    def chosen(self, *names: str) -> dict[str, Any]:
        """Return those of the named options that are not None, as keyword arguments."""
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


def _as_text(name: str, value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise OptionError(f"The option {name!r} is {value!r}; a word was expected.")
    return value.strip()


def _as_flag(name: str, value: Any) -> bool:
    word = str(value).strip().lower()
    if isinstance(value, (bool, str)) and word in TRUE_WORDS | FALSE_WORDS:
        return word in TRUE_WORDS
    raise OptionError(f"The option {name!r} is {value!r}; yes or no was expected.")


def _as_number(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if isinstance(value, bool) or not abs(number) < float("inf"):
        raise OptionError(f"The option {name!r} is {value!r}; a number was expected.")
    return number


def _as_positive(name: str, value: Any) -> float:
    number = _as_number(name, value)
    if number <= 0.0:
        raise OptionError(f"The option {name!r} is {value!r}; it must be above 0.")
    return number


_CONVERT = {
    "topology_format": _as_text,
    "format": _as_text,
    "atom_style": _as_text,
    "dt": _as_positive,
    "time_offset": _as_number,
    "lengthunit": _as_text,
    "timeunit": _as_text,
    "convert_units": _as_flag,
    "continuous": _as_flag,
    "guess_bonds": _as_flag,
    "cut": _as_positive,
    "use_bonds": _as_flag,
    "close_ends": _as_flag,
}

OPTION_HELP: Mapping[str, str] = {
    "topology_format": "format of the topology file where its extension does not say it, such as PDB",
    "format": "format of the trajectory files, such as LAMMPS for a LAMMPS DCD with units",
    "atom_style": "columns of a LAMMPS data file, such as 'id type x y z'",
    "dt": "time between frames in ps, in place of the file's",
    "time_offset": "time in ps that is added to the time of every frame",
    "lengthunit": "length unit of a LAMMPS DCD (with format=LAMMPS), such as nm",
    "timeunit": "time unit of a LAMMPS DCD (with format=LAMMPS), such as ps",
    "convert_units": "no: take the file's numbers as Å and ps, whatever their unit (reduced units)",
    "continuous": "yes: drop the frames that trajectory parts have in common (XTC, TRR)",
    "guess_bonds": "yes: guess bonds from distances in the first frame",
    "cut": "longest edge in Å where bonds are unknown (5 for CA, 9 for C4', else 3 times the median)",
    "use_bonds": "no: ignore the file's bonds, take the atoms in stored order",
    "close_ends": "yes: a strand without bonds is a ring when its ends are within the cut",
}

assert set(OPTION_HELP) == set(_CONVERT) == {entry.name for entry in fields(Options)}
