"""What is said aloud about a run: one record for each line of the alert stream."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any

from mdtopo.records.crossings import Shape

SCHEMA = "mdtopo.alert/1"


class Severity(IntEnum):
    """How much an alert matters, in rising order."""

    INFO = 0
    WARNING = 1
    CRITICAL = 2


class AlertKind(StrEnum):
    """What an alert is about."""

    NEAR_LIMIT = "near-limit"
    CROSSING = "crossing"
    UNRESOLVED = "unresolved"
    STRETCH = "stretch"
    FRACTURE = "fracture"
    IMAGE_JUMP = "image-jump"
    GAP = "gap"
    BAD_DATA = "bad-data"


@dataclass(frozen=True, slots=True)
class Alert:
    """One event: neighbouring steps with the same finding, merged.

    Attributes
    ----------
    id : str
        Stable: the same run gives the same id, also after a resume.
    kind, severity
        What it is about, and how much it matters.
    step_start, step_peak, step_end : int
        First, worst and last step of the event, 0-based.
    frame_start, frame_end : int
        First frame of the first step and last frame of the last one.
    time_start, time_end : float
        Their times in ps; NaN where the trajectory holds none.
    strands : tuple of str
        Names of the strands concerned.
    residues : tuple of str
        Labels of the vertices concerned.
    value, limit : float or None
        The worst value and the limit that it met; None where the kind has none.
    message : str
        The event in one sentence.
    object : Shape
        What it is about: the polyline (and all that concerns both), or the smooth curve alone.
    """

    id: str
    kind: AlertKind
    severity: Severity
    step_start: int
    step_peak: int
    step_end: int
    frame_start: int
    frame_end: int
    time_start: float
    time_end: float
    strands: tuple[str, ...]
    residues: tuple[str, ...]
    value: float | None
    limit: float | None
    message: str
    object: Shape = Shape.POLYLINE

    def to_mapping(self) -> dict[str, Any]:
        """Return the JSON object of this alert, schema ``mdtopo.alert/1``; NaN and infinity become null."""
        values = {name: getattr(self, name) for name in self.__slots__}
        plain = {name: None if isinstance(v, float) and not abs(v) < float("inf") else v for name, v in values.items()}
        return {
            "schema": SCHEMA,
            **plain,
            "kind": self.kind.value,
            "severity": self.severity.name.lower(),
            "object": self.object.name.lower(),
        }
