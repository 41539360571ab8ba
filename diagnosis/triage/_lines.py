"""Faults of one side of a joint, by regression: signs, units, zeros, jumps and conventions."""

from dataclasses import replace

import numpy as np

from diagnosis.motion.columns import COLUMNS, KP, with_numbers
from diagnosis.motion.recordings import CHANNELS
from diagnosis.triage._signals import CLEAR, line, unit
from diagnosis.triage._tracks import BETTER, SCALES, Fault, Track, less

MOST_PUSH = 50.0
"""Largest push, as a multiple of the drive's largest torque."""
ZERO_RAD = np.radians(15)
"""Largest offset that counts as a sensor's bias [rad]; for a slide it is the travel."""
STARTS_AT_ZERO = 0.05
"""An episode starts at zero if its first command is below this share of the largest bias."""
SAME_START = 0.1
"""An offset equals the start of an episode up to this share of the distance between starts."""
SLIP_RAD, SLIP_RAD_S = np.pi / 2, 30.0
"""Jumps beyond these between two samples are no motion: the sensor has slipped or wrapped."""
ALIVE, MOVES_RAD = 3, 2e-2
"""A sensor is dead that reads fewer different values while its own commands should move its joint
by so much [rad; of a slide a share of their travel]. At a target that stands, friction may hold."""


def dead(track: Track) -> Fault | None:
    """A reading that is the same throughout while its drive should move the joint."""
    values = np.unique(np.concatenate(track.position))
    least = MOVES_RAD * track.travel if track.slides else MOVES_RAD
    moves = max(float(np.ptp(shown)) for shown in track.shown)
    if len(values) >= ALIVE or not min(moves, track.travel) > least:
        return None
    return track.fault(
        "sensor",
        f"its position reads {values[0]:.4g} {track.si} throughout, where its drive "
        f"should move it by {moves:.3g} {track.si}: a dead sensor, or a joint that is stuck "
        "or off",
        "mend it, or give the table without its columns and --hold it where it stood",
    )


def convention(track: Track) -> Fault | None:
    """Commands that are changes since the last sample or since the start of each episode."""
    if abs(track.line()[0].correlation) > CLEAR:
        return _relative(track)
    found = line([np.cumsum(c) for c in track.command], track.position)
    if found.correlation < CLEAR or not SCALES[0] < found.slope < SCALES[1]:
        return None
    return track.fault(
        "convention",
        "the position follows the sum of the commands "
        f"(correlation {found.correlation:.2f}), not the commands",
        "the commands are changes per sample: add them up from the first position",
    )


def _relative(track: Track) -> Fault | None:
    """Episodes that start at different positions, each with a command of zero."""
    starts = np.array([p[0] for p in track.position])
    apart = float(np.ptp(starts))
    if not _starts_at_zero(track) or apart < _border(track):
        return None
    if np.abs(_offsets(track) - starts).max() > SAME_START * apart:
        return None
    return track.fault(
        "convention",
        f"the commands of every episode start at 0, the positions start at {len(starts)} "
        "different places and keep this offset",
        "the commands are relative to the start: add the first position of each episode",
    )


def scale(track: Track) -> Fault | None:
    """Sign and unit, from the change of position per change of command."""
    found, cause = track.line()
    if not track.travel or abs(found.correlation) < CLEAR or SCALES[0] <= found.slope <= SCALES[1]:
        return None
    moves = f"the position moves {found.slope:.3g} times as far as {cause}"
    if SCALES[0] < -found.slope < SCALES[1]:
        return track.fault(
            "sign",
            f"{moves} (correlation {found.correlation:.2f})",
            "change the sign of the position or of the command, whichever is wrong",
        )
    other = unit(abs(found.slope), track.slides)
    unknown = "counts of an unknown encoder, or another gear ratio"
    said = "the {} is in {}".format(*other) if other else unknown
    turned = " and change the sign" if found.slope < 0 else ""
    return track.fault("unit", f"{moves}: {said}", f"convert both to {track.si}{turned}")


def slips(track: Track) -> Fault | None:
    """Jumps that no joint can make."""
    least = np.inf if track.slides else max(SLIP_RAD, SLIP_RAD_S * track.limb.period_s)
    jumps, asked = (
        np.abs(np.concatenate([np.diff(v) for v in side]))
        for side in (track.position, track.command)
    )
    count = int((jumps > least).sum())
    if not count or asked.max() > least:
        return None
    return track.fault(
        "zero",
        f"the position jumps {count} times, by up to {np.degrees(jumps.max()):.0f} degrees in a "
        "sample",
        "unwrap it at full turns, or leave out the data after the sensor has slipped",
    )


def zero(track: Track) -> Fault | None:
    """A constant offset from the nominal world, larger than the bias of a sensor.

    Not of an open loop: it drifts from its model, and no position is asked of it.
    """
    if track.limb.open[track.index]:
        return None
    offset, border = float(np.median(_offsets(track))), _border(track)
    if not abs(offset) > border or border == 0.0:  # nor where the replay diverged
        return None
    mended = np.concatenate(track.beside(track.limb, started=-offset).missed)
    offset = float(np.median(mended))
    if not abs(offset) > border or track.share(mended - offset) * BETTER > track.misfit:
        return None
    size = f"{offset:.3g} m" if track.slides else f"{np.degrees(offset):.1f} degrees"
    most = f"{border:.3g} m" if track.slides else f"{np.degrees(border):.0f} degrees"
    relative = "; the commands start at 0" if _starts_at_zero(track) else ""
    return track.fault(
        "zero",
        f"the positions are off by {size}; up to {most} would count as a sensor's bias{relative}",
        "home the joint or subtract the offset; if commands or positions are relative to "
        "the start of an episode, add the start",
    )


def motor(track: Track) -> Fault | None:
    """Sign of the motor's angle; torques that cannot be are left out, see `log_faults`."""
    row = CHANNELS.index("motor")
    found = line(track.motor, [r.measured[:, row, track.index] for r in track.limb.recordings])
    if found.correlation > -CLEAR:
        return None
    return track.fault(
        "sign",
        "the column 'motor' has the opposite sign of the nominal world "
        f"(correlation {found.correlation:.2f}), and the position has the same sign",
        "change the sign of 'motor'",
    )


def pushed_way(track: Track) -> Fault | None:
    """Sign of a known push, from the way in which it moves the joint."""
    if not track.most_push:
        return None
    others = np.arange(len(track.limb.joints)) != track.index
    pushes = [r.push * others for r in track.limb.recordings]
    alone = track.beside(track.limb.with_signals(push=pushes))
    found = line(less(track.shown, alone.shown), alone.missed)
    if found.correlation > -CLEAR:
        return None
    return track.fault(
        "sign",
        f"the joint moves against its pushes (correlation {found.correlation:.2f})",
        "change the sign of 'push': a positive push moves a free joint to larger positions",
    )


def torque(track: Track) -> Fault | None:
    """Sign and unit of torques that are all that is asked, from how they move the joint."""
    if not track.limb.open[track.index]:
        return None
    undriven = with_numbers(track.limb.spec, {track.name: {COLUMNS[KP]: 0.0}})
    alone = track.beside(replace(track.limb, spec=undriven))
    found = line(less(track.shown, alone.shown), alone.missed)
    if abs(found.correlation) < CLEAR or SCALES[0] <= found.slope <= SCALES[1]:
        return None
    turned = SCALES[0] < -found.slope < SCALES[1]
    si = "N" if track.slides else "Nm"
    return track.fault(
        "sign" if turned else "unit",
        f"the joint moves as if its torques were {found.slope:.3g} times as large "
        f"(correlation {found.correlation:.2f})",
        "change the sign of the torques that it is given"
        if turned
        else f"convert them to {si} at the joint",
    )


def push_size(track: Track) -> Fault | None:
    """Unit of a known push, from its size: the drive would be pushed away."""
    limit, most = track.limb.spec.drives[track.index].torque_limit_nm, track.most_push
    if most <= MOST_PUSH * limit:
        return None
    si, other = ("N", "mN") if track.slides else ("Nm", "Nmm")
    return track.fault(
        "unit",
        f"pushes reach {most:.3g} {si}, and its drive gives {limit:.3g} {si} at most: they are in "
        f"{other}",
        f"convert 'push' to {si}",
    )


def _offsets(track: Track) -> np.ndarray:
    """Constant offset per episode from the nominal world, after correcting the scale, (E,)."""
    slope = float(np.clip(track.line()[0].slope, *SCALES))
    pairs = zip(track.position, track.shown, strict=True)
    return np.array([np.median(p - slope * s) for p, s in pairs])


def _starts_at_zero(track: Track) -> bool:
    """Whether every episode's command starts at zero."""
    return all(abs(c[0]) < STARTS_AT_ZERO * _border(track) for c in track.command)


def _border(track: Track) -> float:
    """Largest offset of a position that physics can cause [rad or m]."""
    return track.travel if track.slides else ZERO_RAD
