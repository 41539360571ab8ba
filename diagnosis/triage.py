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
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from backends.state import Array
from diagnosis import _clocks
from diagnosis._tracks import Line, Track, line, tracks
from diagnosis.evidence import Evidence

KINDS = ("order", "sign", "unit", "zero", "convention", "clock")
CLEAR = 0.9
"""Correlation from which on two signals are the same motion."""
UNCLEAR = 0.5
"""Correlation under which they are not."""
SCALES = (0.4, 2.5)
ZERO_RAD = np.radians(15)
STARTS_AT_ZERO = 0.05
"""Share of the border of a zero within which an episode starts at zero."""
SAME_START = 0.1
"""Share of the distance between starts within which an offset is the start."""
BETTER = 3.0
"""A bug is one when mending it lowers the misfit by this factor."""
UNITS = {
    "degrees": 180 / np.pi,
    "turns": 1 / (2 * np.pi),
    "milliradians": 1e3,
    **{f"counts of {2**n} per turn": 2**n / (2 * np.pi) for n in range(8, 21)},
}
"""What an angle may be given in, per radian."""
LENGTHS = {"millimetres": 1e3, "centimetres": 1e2, "micrometres": 1e6, "inches": 1 / 0.0254}
"""What a length may be given in, per metre."""
NEAR = 0.12
"""How near a scale must be to a unit's, relative."""
SLIP_RAD, SLIP_RAD_S = np.pi / 2, 30.0
"""No joint moves so far and so fast between two samples: its sensor has slipped or wrapped."""


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


def triage(limbs: Sequence[Evidence]) -> tuple[Finding, ...]:
    """The bugs in a log, by joint; none: what is wrong is physics, or nothing."""
    every = tracks(limbs)
    swapped = _order(every)
    if swapped:
        return swapped
    found = [finding for track in every if (finding := _first(track))]
    return tuple(found) or _clocks_of(every)


def _first(track: Track) -> Finding | None:
    """The first test that finds something; each later one takes for granted what it tests."""
    tests: tuple[Callable[[Track], Finding | None], ...] = (
        _steps_for_targets,
        _scale,
        _slips,
        _zero,
        _sides,
        _pushed_way,
    )
    return next((finding for test in tests if (finding := test(track))), None)


def _order(every: Sequence[Track]) -> tuple[Finding, ...]:
    """Joints whose positions follow each other's commands."""
    moving = [t for t in every if t.travel > 0.0]
    match = np.array([[_alike(a, b) for b in moving] for a in moving]).reshape(len(moving), -1)
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


def _best_line(track: Track) -> tuple[Line, str]:
    """Position over the nominal world's, or over the command where that is the clearer line."""
    shown, asked = (line(cause, track.position) for cause in (track.shown, track.command))
    if abs(shown.correlation) >= min(CLEAR, abs(asked.correlation)):
        return shown, "the nominal world's"
    return asked, "its command"


def _scale(track: Track) -> Finding | None:
    """Sign and unit: how far the position moves where its command moves by one."""
    found, cause = _best_line(track)
    if abs(found.correlation) < CLEAR:
        return None
    moves = f"the position moves {found.slope:.3g} times as far as {cause}"
    if SCALES[0] < -found.slope < SCALES[1]:
        return Finding(
            kind="sign",
            joints=(track.name,),
            evidence=f"{moves} (correlation {found.correlation:.2f})",
            remedy="turn the sign of position or command, whichever is not the mechanism's",
        )
    if SCALES[0] <= found.slope <= SCALES[1]:
        return _both_in_another_unit(track)
    unit = _unit(abs(found.slope), track.slides)
    si = "m" if track.slides else "rad"
    return Finding(
        kind="unit",
        joints=(track.name,),
        evidence=f"{moves}: {unit or 'counts of an unknown encoder, or another gear ratio'}",
        remedy=f"convert both to {si}" + (", and turn the sign" if found.slope < 0 else ""),
    )


def _unit(scale: float, slides: bool) -> str | None:
    """The unit that a scale gives away, and which side has it."""
    for unit, size in (LENGTHS if slides else UNITS).items():
        for side, expected in (("position", size), ("command", 1 / size)):
            if abs(np.log(scale / expected)) < NEAR:
                return f"the {side} is in {unit}"
    return None


def _both_in_another_unit(track: Track) -> Finding | None:
    """Command and position alike: far beyond the joint's range, and within it in another unit."""
    low, high = track.limb.nominal.hand.driven[track.index].joint.range_rad
    reach, room = max(np.abs(c).max() for c in track.command), max(abs(low), abs(high))
    unit, size = ("millimetres", 1e3) if track.slides else ("degrees", UNITS["degrees"])
    if reach < 3 * room or reach / size > 1.5 * room:
        return None
    si = "m" if track.slides else "rad"
    return Finding(
        kind="unit",
        joints=(track.name,),
        evidence=f"commands reach {reach:.3g} {si}, the joint {room:.3g}: both are in {unit}",
        remedy=f"convert command and position to {si}",
    )


def _zero(track: Track) -> Finding | None:
    """A constant between position and nominal world, beyond what a biased sensor shows."""
    offsets = _offsets(track)
    offset = float(np.median(offsets))
    border = _border(track)
    if abs(offset) <= border or border == 0.0:
        return None
    mended = track.replayed(started=-offset)
    offset = float(np.median(np.concatenate(_less(track.position, mended.shown))))
    left = np.concatenate(_less(track.position, mended.shown)) - offset
    missed = np.concatenate(_less(track.position, track.shown))
    if np.sqrt(np.mean(left**2)) * BETTER > np.sqrt(np.mean(missed**2)):
        return None
    size = f"{offset:.3g} m" if track.slides else f"{np.degrees(offset):.1f} degrees"
    most = f"{border:.3g} m" if track.slides else f"{np.degrees(border):.0f} degrees"
    relative = "; commands start at 0" if _starts_at_zero(track) else ""
    return Finding(
        kind="zero",
        joints=(track.name,),
        evidence=f"positions stand {size} off, up to {most} is taken for a sensor's bias{relative}",
        remedy="home the joint or subtract it; if commands or positions are relative to the start "
        "of an episode, add the start",
    )


def _less(ones: Sequence[Array], others: Sequence[Array]) -> list[Array]:
    return [one - other for one, other in zip(ones, others, strict=True)]


def _starts_at_zero(track: Track) -> bool:
    """Whether every episode's command starts at zero."""
    return all(abs(c[0]) < STARTS_AT_ZERO * _border(track) for c in track.command)


def _border(track: Track) -> float:
    """Largest offset of a position that is physics [rad or m]."""
    return track.travel if track.slides else ZERO_RAD


def _offsets(track: Track) -> list[float]:
    """Constant per episode between position and nominal world, beside what a wrong scale makes."""
    scale = float(np.clip(_best_line(track)[0].slope, *SCALES))
    pairs = zip(track.position, track.shown, strict=True)
    return [float(np.median(p - scale * s)) for p, s in pairs]


def _steps_for_targets(track: Track) -> Finding | None:
    """Commands that are changes since the last sample, or since the start of each episode."""
    if abs(_best_line(track)[0].correlation) > CLEAR:
        return _relative(track)
    summed = [np.cumsum(c) for c in track.command]
    found = line(summed, track.position)
    if found.correlation < CLEAR or not SCALES[0] < found.slope < SCALES[1]:
        return None
    return Finding(
        kind="convention",
        joints=(track.name,),
        evidence="the position follows the sum of the commands "
        f"(correlation {found.correlation:.2f}), not the commands",
        remedy="commands are changes per sample: sum them up from the first position",
    )


def _relative(track: Track) -> Finding | None:
    """Episodes that start at several places, each with a command of zero."""
    starts = np.array([p[0] for p in track.position])
    offsets, apart = np.array(_offsets(track)), float(np.ptp(starts))
    if not _starts_at_zero(track) or apart < _border(track):
        return None
    if np.abs(offsets - starts).max() > SAME_START * apart:
        return None
    return Finding(
        kind="convention",
        joints=(track.name,),
        evidence=f"every episode's commands start at 0, its positions at {len(starts)} places, and "
        "stay as far off as they start",
        remedy="targets are relative to the start: add the first position of each episode",
    )


def _slips(track: Track) -> Finding | None:
    """Jumps that no joint makes."""
    if track.slides:
        return None
    least = max(SLIP_RAD, SLIP_RAD_S * track.dt_s)
    jumps = np.concatenate([np.diff(p) for p in track.position])
    count = int((np.abs(jumps) > least).sum())
    if not count or np.abs(np.concatenate([np.diff(c) for c in track.command])).max() > least:
        return None
    largest = np.degrees(np.abs(jumps).max())
    return Finding(
        kind="zero",
        joints=(track.name,),
        evidence=f"the position jumps {count} times, by up to {largest:.0f} degrees in a sample",
        remedy="unwrap it at full turns, or leave out what comes after the sensor has slipped",
    )


def _sides(track: Track) -> Finding | None:
    """Motor angle and torque against the nominal world's: their signs."""
    for channel in ("motor", "torque"):
        found = line(track.shown_of(channel), track.measured(channel))
        if found.correlation < -CLEAR:
            return Finding(
                kind="sign",
                joints=(track.name,),
                evidence=f"the column '{channel}' moves against the nominal world's "
                f"(correlation {found.correlation:.2f}), the position with it",
                remedy=f"turn the sign of '{channel}'",
            )
    return None


def _pushed_way(track: Track) -> Finding | None:
    """Whether a known push moves the joint the way that it should."""
    if not any(r.commands.load[:, track.index].any() for r in track.limb.recordings):
        return None
    alone = track.shown_of("position", pushed=0.0)
    found = line(_less(track.shown, alone), _less(track.position, alone))
    if found.correlation > -CLEAR:
        return None
    return Finding(
        kind="sign",
        joints=(track.name,),
        evidence=f"pushes move the joint against their sign (correlation {found.correlation:.2f})",
        remedy="turn the sign of 'push': a positive push moves a free joint up",
    )


def _clocks_of(every: Sequence[Track]) -> tuple[Finding, ...]:
    """What the joints say of the log's clocks, as one finding.

    A wrong sample period is one that half of the joints that move show at least.
    """
    pairs = [(t, clock) for t in every if (clock := _clocks.wrong(t, BETTER))]
    moving = sum(track.travel > 0.0 for track in every)
    shared = [pair for pair in pairs if pair[1].shared]
    if 2 * len(shared) < moving:
        pairs = [pair for pair in pairs if not pair[1].shared]
    if not pairs:
        return ()
    names, first = tuple(track.name for track, _ in pairs), pairs[0][1]
    return (Finding(kind="clock", joints=names, evidence=first.evidence, remedy=first.remedy),)
