"""Who carries a joint's weight, and whether gravity pulls where the model says, by its sag.

At rest a PD law holds a link by command - position = weight(position) / kp. Both numbers in another
unit break that in a way that names the unit; a drive that carries the weight by itself leaves
no difference at all. Where a joint hardly rests, that holds of what its speed and its friction, and
the accelerations of all joints, do not make of the difference.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import KP
from diagnosis.motion.limb import block_means
from diagnosis.motion.recordings import Recording
from diagnosis.replay.dynamics import holding
from diagnosis.triage._lines import ZERO_RAD
from diagnosis.triage._signals import rms
from diagnosis.triage._tracks import BETTER, Fault, Track

REST_S = 0.5
"""A joint rests at the end of so long a time without a new target."""
STILL = 0.02
"""Largest drift in that rest, over the joint's travel."""
LEAST_RESTS, SEEN_RAD = 5, 2e-3
"""So many rests, and so much sag, are needed [rad, m]."""
MEAN_S, MOST_POSES, SLOW = 0.05, 2000, 0.3
"""In motion means over so long count, so many of them; friction turns below this share of the usual
speed."""
WRONG = 0.5
"""Relative misfit of the sag from which it is another's."""
REACH = 1.1
"""Readings are within a joint's range up to this share of it."""
ZEROS, FAR_RAD, SURE = np.radians(np.arange(-180, 181, 3)), np.pi / 4, 0.1
"""Zeros that are tried; a nearer one may be a tilt of gravity, which is an effect; the relative
misfit that names one."""
CARRIED = 0.2
"""Share of the expected sag up to which the weight is carried by something else."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sags:
    """What all joints of a track's limb show of its weight, at R poses."""

    track: Track
    errors: Array
    """Command less position of the track's joint, shape (R,)."""
    positions: Array
    """Of all joints, shape (R, K)."""
    beside: Array
    """What errors follow from beside weight, an orthonormal basis of it (R, C)."""

    @classmethod
    def of(cls, track: Track) -> "Sags":
        """At rest; where it hardly rests, in motion without pushes and given torques."""
        recordings, j = track.limb.recordings, track.index
        rests = [rest for one in recordings for rest in _rests(one, j)]
        if len(rests) >= LEAST_RESTS:
            errors, positions = (np.array(some) for some in zip(*rests, strict=True))
            beside = np.zeros((len(errors), 0))
            return cls(track=track, errors=errors, positions=positions, beside=beside)
        every = [_moving(one, j) for one in recordings]
        errors, positions, beside = (np.concatenate(some) for some in zip(*every, strict=True))
        some = slice(None, None, 1 + len(errors) // MOST_POSES)
        basis = np.linalg.qr(beside[some])[0]
        return cls(track=track, errors=errors[some], positions=positions[some], beside=basis)

    @property
    def show_weight(self) -> bool:
        """Whether there are enough, and the nominal ones large enough, to tell."""
        return len(self.errors) >= LEAST_RESTS and rms(self.expected()) >= SEEN_RAD

    def left(self, zero: float = 0.0, biased: bool = False) -> float:
        """Share of the errors that weight does not explain; `biased`: nor a sensor's bias."""
        errors = self._own(self.errors)
        apart = errors - self.expected(zero=zero)
        if biased:
            one, most = self._own(np.ones_like(apart)), np.inf if self.track.slides else ZERO_RAD
            apart = apart - one * np.clip((one @ apart) / max(float(one @ one), 1e-12), -most, most)
        return rms(apart) / max(rms(errors), 1e-12)

    def _own(self, errors: Array) -> Array:
        """What of errors does not follow from what is beside weight."""
        return np.asarray(errors - self.beside @ (self.beside.T @ errors))

    def expected(self, per_si: float = 1.0, zero: float = 0.0) -> Array:
        """The nominal sag (R,) [rad or m], in a unit of so many per SI's, from another zero."""
        track = self.track
        q = self.positions / per_si
        q[:, track.index] -= zero
        held = holding(track.limb.spec, q) if len(q) else q
        return self._own(held[:, track.index] / track.limb.nominal[track.index, KP])

    def misfit(
        self, per_si: float = 1.0, zero: float = 0.0, sizes: tuple[float, float] = (1.0, 1.0)
    ) -> float:
        """Relative misfit of the sag; infinite where the joint does not reach so far.

        `sizes`: with a gain or mass that makes it so many times as large.
        """
        far = np.abs(self.positions[:, self.track.index]).max() / per_si
        if per_si != 1.0 and far > REACH * self.track.room:
            return np.inf
        expected, found = self.expected(per_si, zero), self._own(self.errors / per_si)
        size = float(found @ expected) / max(float(expected @ expected), 1e-24)
        expected = np.clip(size, *sizes) * expected
        return rms(found - expected) / max(rms(expected), 1e-12)


def weight(track: Track) -> Fault | None:
    """Another zero of both sides, or a weight that the PD law does not carry."""
    sags = Sags.of(track)
    wrong = sags.show_weight and sags.misfit() >= WRONG
    return (_zero(track, sags) or _carried(track, sags)) if wrong else None


def _zero(track: Track, sags: Sags) -> Fault | None:
    """Both sides far from the model's zero, or gravity that turns as far."""
    if track.slides:
        return None
    misfits = [sags.misfit(zero=zero) for zero in ZEROS]
    best = ZEROS[int(np.argmin(misfits))]
    better = sags.left(best) * BETTER < sags.left(biased=True)
    if min(misfits) > SURE or abs(best) < FAR_RAD or not better:
        return None
    far = f"{np.degrees(best):.0f} deg"
    return track.fault(
        "zero",
        f"positions and commands both stand {far} from the model's zero: so says the sag "
        "of the joint under its weight; or the robot is mounted so",
        f"subtract {far} from both, or turn gravity in the model",
    )


def _carried(track: Track, sags: Sags) -> Fault | None:
    """A weight that leaves no sag, where the nominal world moves as logged without weight."""
    sag, expected = rms(sags.errors), rms(sags.expected())
    if sags.beside.any() or sag > CARRIED * expected:
        return None
    if track.weightless().misfit * BETTER > track.misfit:
        return None
    return track.fault(
        "convention",
        f"at rest it is {1e3 * sag:.2g} mrad from its targets, where its weight "
        f"should hold it {1e3 * expected:.2g} mrad below",
        "the drive compensates gravity: say --gravity-compensation, or `gravity_compensation"
        ": true` under mechanism; or it has an integral: write its `ki`",
    )


def _moving(recording: Recording, j: int) -> tuple[Array, Array, Array]:
    """Errors of joint j (R,), the poses of all (R, K), and what moves them (R, C), by `MEAN_S`."""
    joints, step_s = recording.command.shape[1], float(np.median(np.diff(recording.time_s)))
    size = max(1, round(MEAN_S / step_s))
    edges = np.arange(0, len(recording.time_s) + 1, size)
    if step_s > MEAN_S or len(edges) < LEAST_RESTS or len(recording.given):
        return np.zeros(0), np.zeros((0, joints)), np.zeros((0, joints + 3))
    position, command = (
        block_means(x[: edges[-1]], edges) for x in (recording.measured[:, 0], recording.command)
    )
    v = np.gradient(position, size * step_s, axis=0)
    a = np.gradient(v, size * step_s, axis=0)
    own = v[:, j]
    sign = np.tanh(own / max(float(np.median(np.abs(own))) * SLOW, 1e-9))
    beside = np.column_stack([own, sign, own * np.abs(own), a])
    free = ~block_means(recording.push[: edges[-1]] != 0.0, edges).any(axis=1)
    known = free & np.isfinite(beside).all(axis=1)
    return (command - position)[known, j], position[known], beside[known]


def _rests(recording: Recording, j: int) -> Iterator[tuple[float, Array]]:
    """Sags of joint j, and the pose of all.

    Where its own target is the same as before, a joint is held as it was by friction, and tells
    nothing new.
    """
    asked = np.concatenate([recording.asked, recording.push], axis=1)
    fresh = np.flatnonzero(np.any(np.diff(asked, axis=0) != 0.0, axis=1)) + 1
    travel = max(float(np.nanmax(np.ptp(recording.measured[:, 0], axis=0))), 1e-9)
    before, edges = np.nan, np.append(fresh, len(asked))
    lasts_s = recording.time_s[edges[1:] - 1] - recording.time_s[edges[:-1]]
    for begin, end in zip(edges[:-1][lasts_s >= REST_S], edges[1:][lasts_s >= REST_S], strict=True):
        if (target := recording.command[begin, j]) == before:
            continue
        last = recording.measured[end - max(3, (end - begin) // 5) : end, 0]
        first, second = (half.mean(axis=0) for half in np.array_split(last, 2))
        still = np.abs(second - first).max() < STILL * travel
        if still and not recording.push[begin].any():
            position, before = last.mean(axis=0), target
            yield float(target - position[j]), position
