"""Every knob of a run, in one record that is written into the results file."""

from dataclasses import asdict, dataclass, field, fields
from numbers import Real
from typing import Any, Literal, TypeAlias, get_args

from mdtopo.errors import OptionError
from mdtopo.typing import JsonObject

Motion: TypeAlias = Literal["rigid", "lab"]
Criterion: TypeAlias = Literal["pair", "nu", "clearance"]
CurveChoice: TypeAlias = Literal["interpolating", "bspline", "catmull-rom", "bezier", "none"]


def _knob(default: Any, help_text: str, *, least: float | None = None) -> Any:
    return field(default=default, metadata={"help": help_text, "least": least})


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """Every knob of a run; each field's metadata says in words what it does.

    Raises
    ------
    OptionError
        If a value is out of its range, or two of them contradict each other.

    Examples
    --------
    >>> MonitorConfig(motion="lab").motion
    'lab'
    """

    motion: Motion = _knob(
        "rigid",
        "path that is certified: 'rigid' takes one common rigid motion out of each step, 'lab' takes none",
    )
    curve: CurveChoice = _knob(
        "interpolating",
        "smooth curve of the strands that is certified beside the polyline: 'interpolating' (C² cubic through the "
        "vertices), 'bspline', 'catmull-rom', 'bezier' (one curve of degree n on the vertices of a strand) or 'none'",
    )
    audit: bool = _knob(
        False,
        "compare linking number and writhe with the crossings in every step of closed strands, not only where there "
        "are crossings",
    )
    resolution_length: float | None = _knob(
        None,
        "a crossing is resolved when its two edges move less than this relative to each other, Å; by default the "
        "shorter of the two edges",
        least=0.0,
    )
    criterion: Criterion = _knob(
        "pair",
        "what makes a step near-limit: 'pair' (sharp ratio of a pair), 'nu' (the paper's 2m/nu) or 'clearance' (in Å)",
    )
    near_limit: float = _knob(
        0.8,
        "a step is near-limit from this ratio on (criterion pair, nu), or up to this clearance in Å",
        least=0.0,
    )
    stretch_limit: float = _knob(1.2, "an edge is stretched from this multiple of its reference length on", least=1.0)
    stretch_spreads: float = _knob(
        10.0, "and only when this many standard deviations longer than the run's first edges", least=0.0
    )
    fracture_limit: float = _knob(
        1.5, "an edge counts as broken from this multiple of its reference length on", least=1.0
    )
    fracture_spreads: float = _knob(
        15.0, "and only when this many standard deviations longer than the run's first edges", least=0.0
    )
    fracture_frames: int = _knob(3, "for this many analysed frames in a row", least=1)
    reference_frames: int = _knob(
        10, "reference lengths are medians over this many first frames of the trajectory", least=1
    )
    merge_steps: int = _knob(
        1, "alerts of one kind are one event when at most this many quiet steps lie between them", least=0
    )
    coordinate_error: float | None = _knob(
        None,
        "coordinate error η per atom in Å; by default what the reader knows of the file format",
        least=0.0,
    )
    profile_steps: int = _knob(
        32,
        "how close every vertex came is kept once for so many steps, from the one of them with the least clearance; 0 "
        "keeps none. Results of more than 8 million such values have longer windows",
        least=0,
    )
    block_steps: int = _knob(64, "steps that are read and measured together", least=1)

    def __post_init__(self) -> None:
        self.check_each(self.to_mapping())
        self._check_together()

    def _check_together(self) -> None:
        limit = self.near_limit
        if self.criterion != "clearance" and limit == 0.0:
            raise OptionError(
                "near_limit is 0: every ratio is at least 0, so every step would be near the limit; give more than 0."
            )
        if self.criterion == "pair" and limit > 1.0:
            raise OptionError(
                f"near_limit is {limit:g}: a pair ratio of 1 is the limit itself, so this would leave out steps at the "
                "limit; give at most 1, or the criterion clearance with a length in Å."
            )
        if self.fracture_limit < self.stretch_limit:
            raise OptionError(
                f"fracture_limit is {self.fracture_limit:g} and stretch_limit {self.stretch_limit:g}: an edge would "
                "be broken before it is stretched; give a fracture_limit that is not below the stretch_limit."
            )

    @classmethod
    def check_each(cls, values: JsonObject) -> None:
        """Refuse a value that is out of range whatever the other knobs are; some may be given and others not yet.

        Raises
        ------
        OptionError
            If a value is out of its range.
        """
        for name, allowed in (("motion", Motion), ("criterion", Criterion), ("curve", CurveChoice)):
            if name in values and values[name] not in get_args(allowed):
                choices = ", ".join(get_args(allowed))
                raise OptionError(f"{name} is {values[name]!r}; it must be one of: {choices}.")
        for knob in fields(cls):
            least, value = knob.metadata["least"], values.get(knob.name)
            if least is None or value is None:
                continue
            if not isinstance(value, Real):
                raise OptionError(f"{knob.name} is {value!r}; it must be a number.")
            if not value >= least:
                raise OptionError(f"{knob.name} is {value}; it must be at least {least:g}.")

    @classmethod
    def from_mapping(cls, values: JsonObject) -> "MonitorConfig":
        """Return the configuration of a mapping; keys that are left out keep their default.

        Raises
        ------
        OptionError
            If a key is not the name of a knob, or a value is out of range.
        """
        known = {knob.name for knob in fields(cls)}
        unknown = sorted(set(values) - known)
        if unknown:
            raise OptionError(f"Unknown configuration key {unknown[0]!r}; the keys are: {', '.join(sorted(known))}.")
        return cls(**values)

    def to_mapping(self) -> dict[str, Any]:
        """Return all knobs as plain values, ready for JSON."""
        return asdict(self)
