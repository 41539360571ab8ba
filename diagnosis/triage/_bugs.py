"""What the tests of the triage share: a finding, and the line of a position over its cause."""

from collections.abc import Sequence
from dataclasses import dataclass

from backends.state import Array
from diagnosis.triage._tracks import Line, Track, line

CLEAR = 0.9
"""Correlation from which on two signals are the same motion."""
SCALES = (0.4, 2.5)
"""How far a position may move where its command moves by one: gains and sensors do that."""
BETTER = 3.0
"""A bug is one when mending it lowers the misfit by this factor."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A bug in a log."""

    kind: str
    """One of `KINDS`."""
    joints: tuple[str, ...]
    evidence: str
    """What shows it, with figures."""
    remedy: str
    """What to do."""

    def __str__(self) -> str:
        return f"{self.kind} of {', '.join(self.joints)}: {self.evidence}; {self.remedy}"


def best_line(track: Track) -> tuple[Line, str]:
    """Position over the nominal world's, or over the command where that is the clearer line."""
    shown, asked = (line(cause, track.position) for cause in (track.shown, track.command))
    if abs(shown.correlation) >= min(CLEAR, abs(asked.correlation)):
        return shown, "the nominal world's"
    return asked, "its command"


def less(ones: Sequence[Array], others: Sequence[Array]) -> list[Array]:
    """Differences of two signals by episode."""
    return [one - other for one, other in zip(ones, others, strict=True)]
