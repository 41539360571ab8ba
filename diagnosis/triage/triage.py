"""Bug or physics: what is wrong with a log before any cause is looked for in the mechanism.

Swapped columns, a turned sign, another unit, a wrong zero, another convention of targets, a wrong
clock: each leaves a gap that a physical effect could be bent to explain. Each is tested on its own,
position against command and against the nominal world. Borders keep apart what both can cause; they
lie beyond what the effects of the catalogue do at any magnitude that a working mechanism has:

    scale      0.4 to 2.5 is physics (gains, sensors), beyond is a unit; signs are never physics
    zero       up to 15 degrees (of a slide: the travel) is physics (encoder-bias), beyond is a bug
    lateness   up to 0.5 s is physics (delays, rate limits), beyond, or ahead of its command, a bug
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from diagnosis.attribution.evidence import Evidence
from diagnosis.logs.log import LogError
from diagnosis.triage import _clocks as _bug_clocks
from diagnosis.triage import _scales as _bug_scales
from diagnosis.triage import _zeros as _bug_zeros
from diagnosis.triage._bugs import CLEAR, Finding
from diagnosis.triage._tracks import Track, line, tracks

KINDS = ("order", "sign", "unit", "zero", "convention", "clock")
UNCLEAR = 0.5
"""Correlation under which two signals are not the same motion."""
TESTS: tuple[Callable[[Track], Finding | None], ...] = (
    _bug_zeros.convention,
    _bug_scales.scale,
    _bug_zeros.slips,
    _bug_zeros.zero,
    _bug_scales.sides,
    _bug_scales.pushed_way,
)
"""Of one joint; each takes for granted what those before it test."""


class BugError(LogError):
    """A log has bugs, so that no cause is looked for in the mechanism."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        said = "; ".join(str(finding) for finding in findings)
        super().__init__(f"a bug, not physics: {said}")
        self.findings = tuple(findings)


def refuse_bugs(limbs: Sequence[Evidence]) -> None:
    """Raise BugError where a log has bugs."""
    findings = triage(limbs)
    if findings:
        raise BugError(findings)


def triage(limbs: Sequence[Evidence]) -> tuple[Finding, ...]:
    """The bugs in a log, by joint; none: what is wrong is physics, or nothing."""
    every = tracks(limbs)
    swapped = _order(every)
    if swapped:
        return swapped
    found = [finding for track in every if (finding := _first(track))]
    return tuple(found) or _clocks_of(every)


def _first(track: Track) -> Finding | None:
    return next((finding for test in TESTS if (finding := test(track))), None)


def _order(every: Sequence[Track]) -> tuple[Finding, ...]:
    """Joints whose positions follow each other's commands."""
    moving = [t for t in every if t.travel > 0.0]
    if len(moving) < 2:
        return ()
    match = np.array([[_alike(a, b) for b in moving] for a in moving])
    _, best = linear_sum_assignment(-match)
    wrong = [k for k, other in enumerate(best) if other != k]
    if any(match[k, k] > UNCLEAR or match[k, best[k]] < CLEAR for k in wrong) or not wrong:
        return ()
    names = [t.name for t in moving]
    pairs = ", ".join(f"{names[k]} that of {names[best[k]]}" for k in wrong)
    return (
        Finding(
            kind="order",
            joints=tuple(names[k] for k in wrong),
            evidence=f"each follows another's command: {pairs} (correlation over {CLEAR})",
            remedy="swap the columns of command or position, so that each bears its joint's name",
        ),
    )


def _alike(position: Track, command: Track) -> float:
    """How surely the position of one track follows the command of another; same episodes."""
    if len(position.position) != len(command.command):
        return 0.0
    both = (line(cause, position.position) for cause in (command.shown, command.command))
    return max(one.correlation for one in both)


def _clocks_of(every: Sequence[Track]) -> tuple[Finding, ...]:
    """What the joints say of the log's clocks, as one finding.

    A wrong sample period is one that half of the joints that move show at least.
    """
    pairs = [(t, clock) for t in every if (clock := _bug_clocks.wrong(t))]
    moving = sum(track.travel > 0.0 for track in every)
    shared = [pair for pair in pairs if pair[1].shared]
    if 2 * len(shared) < moving:
        pairs = [pair for pair in pairs if not pair[1].shared]
    if not pairs:
        return ()
    names, first = tuple(track.name for track, _ in pairs), pairs[0][1]
    return (Finding(kind="clock", joints=names, evidence=first.evidence, remedy=first.remedy),)
