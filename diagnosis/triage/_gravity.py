"""What gravity says of command and position together: their unit, and who carries the weight.

At rest a PD law holds a link by command - position = weight(position) / kp. Both numbers in another
unit break that in a way that names the unit; a drive that carries the weight by itself leaves
no difference at all.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import KP
from diagnosis.motion.recordings import Recording
from diagnosis.replay.dynamics import bias_torques
from diagnosis.triage._signals import COUNTS, rms
from diagnosis.triage._tracks import BETTER, SCALES, Fault, Track
from diagnosis.triage._units import in_unit

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
    rests = Rests.of(track)
    size = rms(rests.expected())
    few = len(rests.sags) < LEAST_RESTS or size < SEEN_RAD
    if few or rms(rests.sags - rests.expected()) < WRONG * size:
        return None
    return _unit(track, rests) or _zero(track, rests) or _carried(track, rests)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rests:
    """Where all joints of a track's limb rest: R poses."""

    track: Track
    sags: Array
    """Command less position of the track's joint, shape (R,)."""
    positions: Array
    """Of all joints, shape (R, K)."""

    @classmethod
    def of(cls, track: Track) -> "Rests":
        """Those of all episodes."""
        every = [pair for r in track.limb.recordings for pair in _rests(r, track.index)]
        return cls(
            track=track,
            sags=np.array([sag for sag, _ in every]),
            positions=np.array([q for _, q in every]).reshape(-1, len(track.limb.joints)),
        )

    def expected(self, per_si: float = 1.0, zero: float = 0.0) -> Array:
        """The nominal sag (R,) [rad or m], in a unit of so many per SI's, from another zero."""
        track = self.track
        q = self.positions / per_si
        q[:, track.index] -= zero
        bias = bias_torques(track.limb.spec, q, np.zeros_like(q)) if len(q) else q
        return bias[:, track.index] / track.limb.nominal[track.index, KP]

    def misfit(self, per_si: float = 1.0, zero: float = 0.0, other: bool = False) -> float:
        """Relative misfit of the sag; infinite where the joint does not reach so far.

        `other`: with another gain or mass.
        """
        far = np.abs(self.positions[:, self.track.index]).max() / per_si
        if per_si != 1.0 and far > REACH * self.track.room:
            return np.inf
        expected, found = self.expected(per_si, zero), self.sags / per_si
        if other:
            size = float(found @ expected) / max(float(expected @ expected), 1e-24)
            expected = np.clip(size, *SCALES) * expected
        return rms(found - expected) / max(rms(expected), 1e-12)


def _rests(recording: Recording, j: int) -> Iterator[tuple[float, Array]]:
    """Sags of joint j, and the pose of all.

    Where its own target is the same as before, a joint is held as it was by friction, and tells
    nothing new.
    """
    asked = np.concatenate([recording.asked, recording.push], axis=1)
    fresh = np.flatnonzero(np.any(np.diff(asked, axis=0) != 0.0, axis=1)) + 1
    travel = max(float(np.nanmax(np.ptp(recording.measured[:, 0], axis=0))), 1e-9)
    before, edges = np.nan, [*fresh, len(asked)]
    for begin, end in zip(edges[:-1], edges[1:], strict=True):
        target, lasts_s = recording.command[begin, j], np.ptp(recording.time_s[begin:end])
        if lasts_s < REST_S or target == before:
            continue
        last = recording.measured[end - max(3, (end - begin) // 5) : end, 0]
        first, second = (half.mean(axis=0) for half in np.array_split(last, 2))
        still = np.abs(second - first).max() < STILL * travel
        if still and not recording.push[begin].any():
            position, before = last.mean(axis=0), target
            yield float(target - position[j]), position


def _unit(track: Track, rests: Rests) -> Fault | None:
    counts = {} if track.slides else {n: s for n, s in COUNTS.items() if s > COARSEST}
    named = {n: rests.misfit(s) for n, s in (track.units | counts).items()}
    best = min(named, key=named.__getitem__)
    free = [rests.misfit(s) for s in FREE]
    if named[best] >= RIGHT:  # of a drive or a mass that is another
        named = {n: rests.misfit(s, other=True) for n, s in track.units.items()}
        best = min(named, key=named.__getitem__)
        named[best] = np.inf if min(free) * BETTER < named[best] else named[best]
    why = "so says the sag of the joint under its weight, and its range"
    if named[best] < RIGHT:
        return in_unit(track, best, f"both are in {best}: {why}")
    reach = max(track.reach, *(float(np.abs(p).max()) for p in track.position))
    if reach < OUTSIDE * track.room or min(free) > RIGHT:
        return None
    return track.fault(
        "unit",
        f"both are in a unit of which about {FREE[int(np.argmin(free))]:.2g} make one {track.si}: "
        f"{why}",
        "they may be of a calibration, or on the motor's side of a gear: convert them to "
        f"{track.si}",
    )


def _zero(track: Track, rests: Rests) -> Fault | None:
    """Both sides far from the model's zero, or gravity that turns as far."""
    if track.slides:
        return None
    misfits = [rests.misfit(zero=zero) for zero in ZEROS]
    best = int(np.argmin(misfits))
    if misfits[best] > SURE or abs(ZEROS[best]) < FAR_RAD:
        return None
    far = f"{np.degrees(ZEROS[best]):.0f} deg"
    return track.fault(
        "zero",
        f"positions and commands both stand {far} from the model's zero: so says the sag "
        "of the joint under its weight; or the robot is mounted so",
        f"subtract {far} from both, or turn gravity in the model",
    )


def _carried(track: Track, rests: Rests) -> Fault | None:
    """A weight that leaves no sag, where the nominal world moves as logged without weight."""
    sag, expected = rms(rests.sags), rms(rests.expected())
    if sag > CARRIED * expected or track.weightless().misfit * BETTER > track.misfit:
        return None
    return track.fault(
        "convention",
        f"at rest it is {1e3 * sag:.2g} mrad from its targets, where its weight "
        f"should hold it {1e3 * expected:.2g} mrad below",
        "the drive compensates gravity: say --gravity-compensation, or `gravity_compensation"
        ": true` under mechanism; or it has an integral: write its `ki`",
    )
