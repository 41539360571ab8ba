"""Shared by the tests of the triage: a fault, and the regression line of a position."""

from collections.abc import Sequence
from dataclasses import dataclass

from backends.state import Array
from diagnosis.triage._signals import CLEAR, OPTIONS, Regression, line
from diagnosis.triage._tracks import Track

SCALES = (0.4, 2.5)
"""Range of position change over command change that gains and sensors can cause."""
BETTER = 3.0
"""A fault is reported if correcting it lowers the misfit by this factor."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault in the data of a log."""

    kind: str
    """One of `triage.KINDS`."""
    joints: tuple[str, ...]
    evidence: str
    """What shows it, with numbers."""
    remedy: str
    """What to do."""

    def __str__(self) -> str:
        return f"{self.kind} of {', '.join(self.joints)}: {self.evidence}; {self.remedy}"


def in_unit(track: Track, unit: str, evidence: str) -> Fault:
    """Commands and positions that are in another unit."""
    option = f", or read the table with --unit {OPTIONS[unit]}" if unit in OPTIONS else ""
    remedy = f"convert command and position to {track.si}{option}"
    return Fault(kind="unit", joints=(track.name,), evidence=evidence, remedy=remedy)


def best_line(track: Track) -> tuple[Regression, str]:
    """Regression line over the nominal world's position, or over the command if that is clearer."""
    shown, asked = (line(cause, track.position) for cause in (track.shown, track.command))
    if abs(shown.correlation) >= min(CLEAR, abs(asked.correlation)):
        return shown, "the nominal world's"
    return asked, "its command"


def less(ones: Sequence[Array], others: Sequence[Array]) -> list[Array]:
    """Differences of two signals by episode."""
    return [one - other for one, other in zip(ones, others, strict=True)]
