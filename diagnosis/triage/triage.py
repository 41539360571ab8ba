"""Triage: find faults in the data of a log before a cause is sought in the mechanism.

Swapped columns, a wrong sign, unit, zero, convention of targets or clock: each leaves a gap that
the search could wrongly explain by a physical effect. Each fault has its own test, which compares
the position with the command and with the nominal world. The limits are beyond what any effect of
the catalogue causes in a working mechanism:

    scale   0.4 to 2.5 can be physics (gains, sensors); beyond it is a unit; a sign never is physics
    zero    up to 15 degrees (slide: its travel) can be physics (encoder-bias); beyond it is a fault
    delay   up to 0.5 s can be physics (delay, rate limit); beyond, or a lead, is a fault
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
"""Correlation below which two signals count as different motions."""
TESTS: tuple[Callable[[Track], Finding | None], ...] = (
    _bug_zeros.convention,
    _bug_scales.scale,
    _bug_zeros.slips,
    _bug_zeros.zero,
    _bug_scales.sides,
    _bug_scales.pushed_way,
)
"""Tests of one joint, in order; each assumes that the earlier ones passed."""


class BugError(LogError):
    """A log has faults in its data, so that no cause is sought in the mechanism."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        said = "; ".join(str(finding) for finding in findings)
        super().__init__(f"the data of this log is faulty: {said}")
        self.findings = tuple(findings)


def refuse_bugs(limbs: Sequence[Evidence]) -> None:
    """Raise BugError if the data of a log is faulty."""
    findings = triage(limbs)
    if findings:
        raise BugError(findings)


def triage(limbs: Sequence[Evidence]) -> tuple[Finding, ...]:
    """The faults in the data of a log, by joint; empty if there are none."""
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
            evidence=f"each follows another joint's command: {pairs} (correlation over {CLEAR})",
            remedy="swap the columns of command or position so that each has its joint's name",
        ),
    )


def _alike(position: Track, command: Track) -> float:
    """Correlation of the position of one track with the command of another."""
    if len(position.position) != len(command.command):
        return 0.0
    both = (line(cause, position.position) for cause in (command.shown, command.command))
    return max(one.correlation for one in both)


def _clocks_of(every: Sequence[Track]) -> tuple[Finding, ...]:
    """The clock faults that the joints show, as one finding.

    A wrong sample period counts only if at least half of the moving joints show it.
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
