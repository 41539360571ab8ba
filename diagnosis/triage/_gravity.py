"""What gravity says of command and position together: their unit, and who carries the weight.

At rest a PD law holds a link by command - position = weight(position) / kp. Both numbers in another
unit break that in a way that names the unit; a drive that carries the weight by itself leaves
no difference at all.
"""

from dataclasses import replace

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import KP
from diagnosis.motion.recordings import Recording
from diagnosis.replay.dynamics import dynamics
from diagnosis.triage._faults import BETTER, SCALES, Fault, in_unit
from diagnosis.triage._signals import COUNTS, rms
from diagnosis.triage._tracks import Track

REST_S = 0.5
"""A joint rests at the end of so long a time without a new target."""
STILL = 0.02
"""Largest drift in that rest, over the joint's travel."""
LEAST_RESTS, SEEN_RAD = 5, 2e-3
"""So many rests, and so much sag, are needed [rad, m]."""
WRONG, RIGHT = 0.5, 0.25
"""Relative misfit of the sag from which a unit is wrong, and up to which another is right."""
COARSEST = 100.0
"""Counts per radian that encoders have at least."""
FREE = np.geomspace(1e-2, 1e4, 400)
"""Sizes of a unit that are tried where none with a name fits."""
ZEROS, FAR_RAD, SURE = np.radians(np.arange(-180, 181, 3)), np.pi / 4, 0.1
"""Zeros that are tried; a nearer one may be a tilt of gravity, which is an effect; the relative
misfit that names one."""
OUTSIDE, REACH = 1.5, 1.1
"""Readings are outside a joint's range, and within it, by these shares of it."""
CARRIED = 0.2
"""Share of the expected sag up to which the weight is carried by something else."""


def weight(track: Track) -> Fault | None:
    """Both sides in another unit, or a weight that the PD law does not carry."""
    sags, positions = rests(track)
    expected = _expected(track, positions, 1.0)
    size = rms(expected)
    if len(sags) < LEAST_RESTS or size < SEEN_RAD or rms(sags - expected) < WRONG * size:
        return None
    unit = _unit(track, sags, positions)
    return unit or _zero(track, sags, positions) or _carried(track, sags, expected)


def rests(track: Track) -> tuple[Array, Array]:
    """Command less position (R,) where all joints rest, and the positions there (R, K).

    Where its own target is the same as before, a joint is held as it was by friction, and tells
    nothing new.
    """
    found = [_rests(r, track.index) for r in track.limb.recordings]
    every = [pair for pairs in found for pair in pairs]
    joints = len(track.limb.joints)
    sags = np.array([sag for sag, _ in every])
    return sags, np.array([q for _, q in every]).reshape(-1, joints)


def _rests(recording: Recording, j: int) -> list[tuple[float, Array]]:
    asked = np.concatenate([recording.asked, recording.push], axis=1)
    fresh = np.flatnonzero(np.any(np.diff(asked, axis=0) != 0.0, axis=1)) + 1
    edges = [0, *fresh, len(asked)]
    travel = max(float(np.nanmax(np.ptp(recording.measured[:, 0], axis=0))), 1e-9)
    found, before = [], np.nan
    for begin, end in zip(edges[:-1], edges[1:], strict=True):
        if recording.time_s[end - 1] - recording.time_s[begin] < REST_S or begin == 0:
            continue
        last = recording.measured[end - max(3, (end - begin) // 5) : end, 0]
        target = recording.command[begin, j]
        if target == before:
            continue
        first, second = (half.mean(axis=0) for half in np.array_split(last, 2))
        still = np.abs(second - first).max() < STILL * travel
        if still and not recording.push[begin].any():
            position, before = last.mean(axis=0), target
            found.append((float(recording.command[begin, j] - position[j]), position))
    return found


def _expected(track: Track, positions: Array, per_si: float) -> Array:
    """The nominal sag [rad or m] at positions in a unit of which a radian or metre has `per_si`."""
    if not len(positions):
        return np.zeros(0)
    q = positions / per_si
    _, bias = dynamics(track.limb.spec, q, np.zeros_like(q))
    return bias[:, track.index] / track.limb.nominal[track.index, KP]


def _misfit(
    track: Track, sags: Array, positions: Array, per_si: float, other: bool = False
) -> float:
    """Relative misfit of the sag in a unit; infinite where the joint does not reach so far.

    `other`: with another gain or mass.
    """
    if np.abs(positions[:, track.index]).max() / per_si > REACH * track.room:
        return np.inf
    expected, found = _expected(track, positions, per_si), sags / per_si
    if other:
        size = float(found @ expected) / max(float(expected @ expected), 1e-24)
        expected = np.clip(size, *SCALES) * expected
    return rms(found - expected) / max(rms(expected), 1e-12)


def _unit(track: Track, sags: Array, positions: Array) -> Fault | None:
    counts = {} if track.slides else {n: s for n, s in COUNTS.items() if s > COARSEST}
    every = track.units | counts
    named = {n: _misfit(track, sags, positions, s) for n, s in every.items()}
    best = min(named, key=named.__getitem__)
    free = [_misfit(track, sags, positions, s) for s in FREE]
    if named[best] >= RIGHT:  # of a drive or a mass that is another
        used = track.units.items()
        named = {n: _misfit(track, sags, positions, s, other=True) for n, s in used}
        best = min(named, key=named.__getitem__)
        named[best] = np.inf if min(free) * BETTER < named[best] else named[best]
    why = "so says the sag of the joint under its weight, and its range"
    if named[best] < RIGHT:
        return in_unit(track, best, f"both are in {best}: {why}")
    reach = max(track.reach, *(float(np.abs(p).max()) for p in track.position))
    if reach < OUTSIDE * track.room or min(free) > RIGHT:
        return None
    size = float(FREE[int(np.argmin(free))])
    return Fault(
        kind="unit",
        joints=(track.name,),
        evidence=f"both are in a unit of which about {size:.2g} make one {track.si}: {why}",
        remedy="they may be of a calibration, or on the motor's side of a gear: convert them to "
        f"{track.si}",
    )


def _zero(track: Track, sags: Array, positions: Array) -> Fault | None:
    """Both sides far from the model's zero, or gravity that turns as far."""
    if track.slides:
        return None
    misfits = []
    for zero in ZEROS:
        moved = positions.copy()
        moved[:, track.index] -= zero
        expected = _expected(track, moved, 1.0)
        misfits.append(rms(sags - expected) / max(rms(expected), 1e-12))
    best = int(np.argmin(misfits))
    if misfits[best] > SURE or abs(ZEROS[best]) < FAR_RAD:
        return None
    far = f"{np.degrees(ZEROS[best]):.0f} deg"
    return Fault(
        kind="zero",
        joints=(track.name,),
        evidence=f"positions and commands both stand {far} from the model's zero: so says the sag "
        "of the joint under its weight; or the robot is mounted so",
        remedy=f"subtract {far} from both, or turn gravity in the model",
    )


def _carried(track: Track, sags: Array, expected: Array) -> Fault | None:
    """A weight that leaves no sag, where the nominal world moves as logged without weight."""
    if rms(sags) > CARRIED * rms(expected):
        return None
    limb = track.limb
    bare = replace(limb, spec=replace(limb.spec, gravity_m_s2=(0.0, 0.0, 0.0)))
    light = track.beside(bare)
    if light.misfit * BETTER > track.misfit:
        return None
    return Fault(
        kind="convention",
        joints=(track.name,),
        evidence=f"at rest it is {1e3 * rms(sags):.2g} mrad from its targets, where its weight "
        f"should hold it {1e3 * rms(expected):.2g} mrad below",
        remedy="the drive compensates gravity: say --gravity-compensation, or `gravity_compensation"
        ": true` under mechanism; or it has an integral: write its `ki`",
    )
