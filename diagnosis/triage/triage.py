"""Triage: find faults in the data of a log before a cause is sought in the mechanism.

A dead sensor, swapped columns, a wrong sign, unit, zero, convention of targets or clock: each
leaves a gap that the search could wrongly explain by a physical effect. `triage` raises before it
does. Each fault has its own test, which compares the position with the command and with the nominal
world. The limits are beyond what any effect of the catalogue causes in a working mechanism:

    scale   0.4 to 2.5 can be physics (gains, sensors); beyond it is a unit; a sign never is physics
    zero    up to 15 degrees (slide: its travel) can be physics (encoder-bias); beyond it is a fault
    delay   up to 0.5 s can be physics (delay, rate limit); beyond, or a lead, is a fault
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from backends.spec import Spec
from diagnosis.logs.log import Log, LogError, MjcfMechanism
from diagnosis.motion.excerpt import FITTED_S, excerpt, excerpted
from diagnosis.motion.limb import Limb
from diagnosis.replay.parts import limbs
from diagnosis.triage import _clocks, _lines, _units, _weight
from diagnosis.triage._remarks import made_up, pauses
from diagnosis.triage._signals import CLEAR, UNCLEAR, line
from diagnosis.triage._tracks import Fault, Track, tracks

KINDS = ("sensor", "order", "sign", "unit", "zero", "convention", "clock")
Test = Callable[[Track], Fault | None]
TESTS: tuple[Test, ...] = (
    _weight.weight,
    _lines.scale,
    _lines.slips,
    _lines.zero,
    _lines.motor,
    _lines.pushed_way,
    _lines.torque,
)
"""Tests of one joint that is in SI's units, in order; each assumes that earlier ones passed."""
UNITS_S = 60.0
"""Joint-seconds on which another unit of both sides is judged, which takes many replays."""


class FaultError(LogError):
    """The data of a log is faulty, so that no cause is sought in the mechanism."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        said = "; ".join(str(fault) for fault in faults)
        super().__init__(f"the data of this log is faulty: {said}")
        self.faults = tuple(faults)


def triage(log: Log, nominal: Spec) -> tuple[str, ...]:
    """What may be in another unit, did not follow for a while, or is stamped too regularly.

    Raises FaultError if the data is faulty, LogError where nothing can be compared.
    """
    rigid = isinstance(log.meta.mechanism, MjcfMechanism)
    some = [
        Limb(spec=p, recordings=excerpted(log, p, FITTED_S)[0], rigid=rigid) for p in limbs(nominal)
    ]
    every = list(tracks(some))
    parts = [replace(one, recordings=excerpt(one.recordings, UNITS_S)) for one in some]
    whole = all(a.recordings == b.recordings for a, b in zip(parts, some, strict=True))
    brief = every if whole else list(tracks(parts))
    if found := _faults(every, brief):
        raise FaultError(found)
    if not any(np.isfinite(shown).any() for track in every for shown in track.shown):
        raise LogError(
            "the nominal world cannot follow this log: its links leave their drives at once; are "
            "positions and commands in the units of their names, and masses and gains those of the "
            "robot?"
        )
    followed = [t for t in every if all(np.isfinite(shown).all() for shown in t.shown)]
    units = _units.perhaps(brief)
    remarks = (said for about in (pauses, made_up) for track in followed for said in about(track))
    return (*units, *remarks)


def _faults(every: Sequence[Track], brief: Sequence[Track]) -> tuple[Fault, ...]:
    if first := _order(every) or _of_each(every, _lines.push_size):
        return first
    said = _of_each(every, _lines.dead, _lines.convention)
    said += tuple(_units.both(_others(brief, said)))
    return said + _of_each(_others(every, said), *TESTS) or _clocks.faults(every)


def _of_each(every: Sequence[Track], *tests: Test) -> tuple[Fault, ...]:
    """What the first test of each joint says that says anything."""
    firsts = (next(filter(None, (test(track) for test in tests)), None) for track in every)
    return tuple(filter(None, firsts))


def _others(every: Sequence[Track], said: Sequence[Fault]) -> list[Track]:
    """Joints of which nothing is said."""
    known = {joint for fault in said for joint in fault.joints}
    return [track for track in every if track.name not in known]


def _order(every: Sequence[Track]) -> tuple[Fault, ...]:
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
        Fault(
            kind="order",
            joints=tuple(names[k] for k in wrong),
            evidence=f"each follows another joint's command: {pairs} (correlation over {CLEAR})",
            remedy="swap the columns of command or position so that each has its joint's name",
        ),
    )


def _alike(position: Track, command: Track) -> float:
    """Correlation of the position of one track with the command of another."""
    both = (line(cause, position.position) for cause in (command.shown, command.command))
    return max(one.correlation for one in both)
