"""Faults of zero and convention: offsets, jumps, and commands that are no absolute targets."""

import numpy as np

from diagnosis.triage._faults import BETTER, SCALES, Fault, best_line, less
from diagnosis.triage._signals import CLEAR, line
from diagnosis.triage._tracks import Track

ZERO_RAD = np.radians(15)
"""Largest offset that counts as a sensor's bias [rad]; for a slide it is the travel."""
STARTS_AT_ZERO = 0.05
"""An episode starts at zero if its first command is below this share of the largest bias."""
SAME_START = 0.1
"""An offset equals the start of an episode up to this share of the distance between starts."""
SLIP_RAD, SLIP_RAD_S = np.pi / 2, 30.0
"""Jumps beyond these between two samples are no motion: the sensor has slipped or wrapped."""


def convention(track: Track) -> Fault | None:
    """Commands that are changes since the last sample or since the start of each episode."""
    if abs(best_line(track)[0].correlation) > CLEAR:
        return _relative(track)
    summed = [np.cumsum(c) for c in track.command]
    found = line(summed, track.position)
    if found.correlation < CLEAR or not SCALES[0] < found.slope < SCALES[1]:
        return None
    return Fault(
        kind="convention",
        joints=(track.name,),
        evidence="the position follows the sum of the commands "
        f"(correlation {found.correlation:.2f}), not the commands",
        remedy="the commands are changes per sample: add them up from the first position",
    )


def _relative(track: Track) -> Fault | None:
    """Episodes that start at different positions, each with a command of zero."""
    starts = np.array([p[0] for p in track.position])
    offsets, apart = np.array(_offsets(track)), float(np.ptp(starts))
    if not _starts_at_zero(track) or apart < _border(track):
        return None
    if np.abs(offsets - starts).max() > SAME_START * apart:
        return None
    return Fault(
        kind="convention",
        joints=(track.name,),
        evidence=f"the commands of every episode start at 0, the positions start at {len(starts)} "
        "different places and keep this offset",
        remedy="the commands are relative to the start: add the first position of each episode",
    )


def slips(track: Track) -> Fault | None:
    """Jumps that no joint can make."""
    if track.slides:
        return None
    least = max(SLIP_RAD, SLIP_RAD_S * track.dt_s)
    jumps = np.concatenate([np.diff(p) for p in track.position])
    count = int((np.abs(jumps) > least).sum())
    if not count or np.abs(np.concatenate([np.diff(c) for c in track.command])).max() > least:
        return None
    largest = np.degrees(np.abs(jumps).max())
    return Fault(
        kind="zero",
        joints=(track.name,),
        evidence=f"the position jumps {count} times, by up to {largest:.0f} degrees in a sample",
        remedy="unwrap it at full turns, or leave out the data after the sensor has slipped",
    )


def zero(track: Track) -> Fault | None:
    """A constant offset from the nominal world, larger than the bias of a sensor."""
    offsets = _offsets(track)
    offset = float(np.median(offsets))
    border = _border(track)
    if not abs(offset) > border or border == 0.0:  # nor where the replay diverged
        return None
    mended = track.beside(track.limb, started=-offset)
    offset = float(np.median(np.concatenate(less(track.position, mended.shown))))
    if not abs(offset) > border:
        return None
    left = np.concatenate(less(track.position, mended.shown)) - offset
    missed = np.concatenate(less(track.position, track.shown))
    if np.sqrt(np.mean(left**2)) * BETTER > np.sqrt(np.mean(missed**2)):
        return None
    size = f"{offset:.3g} m" if track.slides else f"{np.degrees(offset):.1f} degrees"
    most = f"{border:.3g} m" if track.slides else f"{np.degrees(border):.0f} degrees"
    relative = "; the commands start at 0" if _starts_at_zero(track) else ""
    return Fault(
        kind="zero",
        joints=(track.name,),
        evidence=f"the positions are off by {size}; up to {most} would count as a sensor's bias"
        f"{relative}",
        remedy="home the joint or subtract the offset; if commands or positions are relative to "
        "the start of an episode, add the start",
    )


def _offsets(track: Track) -> list[float]:
    """Constant offset per episode from the nominal world, after correcting the scale."""
    scale = float(np.clip(best_line(track)[0].slope, *SCALES))
    pairs = zip(track.position, track.shown, strict=True)
    return [float(np.median(p - scale * s)) for p, s in pairs]


def _starts_at_zero(track: Track) -> bool:
    """Whether every episode's command starts at zero."""
    return all(abs(c[0]) < STARTS_AT_ZERO * _border(track) for c in track.command)


def _border(track: Track) -> float:
    """Largest offset of a position that physics can cause [rad or m]."""
    return track.travel if track.slides else ZERO_RAD
