"""Faults of scale: signs, units, and columns that move against the others."""

import numpy as np

from diagnosis.triage._faults import SCALES, Fault, best_line, less
from diagnosis.triage._signals import CLEAR, line, unit
from diagnosis.triage._tracks import Track

MOST_PUSH = 50.0
"""Largest push, as a multiple of the drive's largest torque."""
UNKNOWN_UNIT = "counts of an unknown encoder, or another gear ratio"
ALIVE, MOVES_RAD = 3, 2e-2
"""A sensor is dead that reads fewer different values while its joint should move by so much [rad;
of a slide a share of its commands' travel]."""


def dead(track: Track) -> Fault | None:
    """A reading that is the same throughout while its drive should move the joint."""
    values = np.unique(np.concatenate(track.position))
    least = MOVES_RAD * track.travel if track.slides else MOVES_RAD
    if len(values) >= ALIVE or not track.moves > least:
        return None
    return Fault(
        kind="sensor",
        joints=(track.name,),
        evidence=f"its position reads {values[0]:.4g} {track.si} throughout, where its drive "
        f"should move it by {track.moves:.3g} {track.si}: a dead sensor, or a joint that is stuck "
        "or off",
        remedy="mend it, or give the table without its columns and --hold it where it stood",
    )


def scale(track: Track) -> Fault | None:
    """Sign and unit, from the change of position per change of command."""
    found, cause = best_line(track)
    if abs(found.correlation) < CLEAR:
        return None
    moves = f"the position moves {found.slope:.3g} times as far as {cause}"
    if SCALES[0] < -found.slope < SCALES[1]:
        return Fault(
            kind="sign",
            joints=(track.name,),
            evidence=f"{moves} (correlation {found.correlation:.2f})",
            remedy="change the sign of the position or of the command, whichever is wrong",
        )
    if SCALES[0] <= found.slope <= SCALES[1]:
        return None
    other = unit(abs(found.slope), track.slides)
    said = "the {} is in {}".format(*other) if other else UNKNOWN_UNIT
    return Fault(
        kind="unit",
        joints=(track.name,),
        evidence=f"{moves}: {said}",
        remedy=f"convert both to {track.si}" + (" and change the sign" if found.slope < 0 else ""),
    )


def sides(track: Track) -> Fault | None:
    """Signs of motor angle and torque, compared with the nominal world."""
    for channel in ("motor", "torque"):
        found = line(track.nominal(channel), track.measured(channel))
        if found.correlation < -CLEAR:
            return Fault(
                kind="sign",
                joints=(track.name,),
                evidence=f"the column '{channel}' has the opposite sign of the nominal world "
                f"(correlation {found.correlation:.2f}), and the position has the same sign",
                remedy=f"change the sign of '{channel}'",
            )
    return None


def pushed_way(track: Track) -> Fault | None:
    """Sign of a known push, from the way in which it moves the joint."""
    if not track.is_pushed:
        return None
    alone = track.unpushed().shown
    found = line(less(track.shown, alone), less(track.position, alone))
    if found.correlation > -CLEAR:
        return None
    return Fault(
        kind="sign",
        joints=(track.name,),
        evidence=f"the joint moves against its pushes (correlation {found.correlation:.2f})",
        remedy="change the sign of 'push': a positive push moves a free joint to larger positions",
    )


def torque(track: Track) -> Fault | None:
    """Sign and unit of torques that are all that is asked, from how they move the joint."""
    if not track.limb.open[track.index]:
        return None
    alone = track.undriven().shown
    found = line(less(track.shown, alone), less(track.position, alone))
    if abs(found.correlation) < CLEAR or SCALES[0] <= found.slope <= SCALES[1]:
        return None
    kind = "sign" if SCALES[0] < -found.slope < SCALES[1] else "unit"
    return Fault(
        kind=kind,
        joints=(track.name,),
        evidence=f"the joint moves as if its torques were {found.slope:.3g} times as large "
        f"(correlation {found.correlation:.2f})",
        remedy="change the sign of the torques that it is given"
        if kind == "sign"
        else f"convert them to {'N' if track.slides else 'Nm'} at the joint",
    )


def push_size(track: Track) -> Fault | None:
    """Unit of a known push, from its size: the drive would be pushed away."""
    drive = track.limb.spec.drives[track.index]
    most = max(float(np.abs(r.push[:, track.index]).max()) for r in track.limb.recordings)
    if most <= MOST_PUSH * drive.torque_limit_nm:
        return None
    si, other = ("N", "mN") if track.slides else ("Nm", "Nmm")
    return Fault(
        kind="unit",
        joints=(track.name,),
        evidence=f"pushes reach {most:.3g} {si}, and its drive gives {drive.torque_limit_nm:.3g} "
        f"{si} at most: they are in {other}",
        remedy=f"convert 'push' to {si}",
    )
