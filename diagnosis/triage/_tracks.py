"""One joint of a log and the same joint of the nominal world under its commands, for the triage."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import KD
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import CHANNELS, Recording
from diagnosis.triage._signals import centred

FARTHEST, LEAST = 5.0, 1.0
"""No joint moves by so many times its command's range, where that is at least a radian or metre."""


@dataclass(frozen=True, kw_only=True)
class Track:
    """A joint over all episodes of its limb; lists hold an array (T,) per episode."""

    limb: Limb
    """Its limb, about a motion that may be one, see `_within_reach`."""
    index: int
    """Column of the joint in its limb."""
    time_s: list[Array]
    command: list[Array]
    position: list[Array]
    shown: list[Array]
    """Readings of the position sensor in the nominal world."""

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.limb.joints[self.index]

    @property
    def slides(self) -> bool:
        """Whether it is a slide."""
        return self.limb.spec.hand.driven[self.index].joint.slides

    @property
    def dt_s(self) -> float:
        """Sample period [s]."""
        return self.limb.period_s

    @property
    def travel(self) -> float:
        """Largest range of the commands in one episode [rad or m]."""
        return max(float(np.ptp(c)) for c in self.command)

    @property
    def is_pushed(self) -> bool:
        """Whether a known torque acts on it."""
        return any(r.push[:, self.index].any() for r in self.limb.recordings)

    @property
    def misfit(self) -> float:
        """Distance of the positions from the nominal world's, over the size of the motion."""
        moved = np.concatenate(list(centred(self.command)))
        missed = np.concatenate(self.position) - np.concatenate(self.shown)
        found = float(np.sqrt(np.mean(missed**2) / max(np.mean(moved**2), 1e-18)))
        return found if np.isfinite(found) else np.inf

    def measured(self, channel: str) -> list[Array]:
        """Readings of a channel per episode; NaN where none were logged."""
        row = CHANNELS.index(channel)
        return [r.measured[:, row, self.index] for r in self.limb.recordings]

    def replayed(self, **other: float) -> "Track":
        """The same track beside another nominal world, see `shown_of`."""
        return replace(self, shown=self.shown_of("position", **other))

    def shown_of(
        self,
        channel: str,
        *,
        started: float = 0.0,
        paced: float = 1.0,
        pushed: float = 1.0,
        damped: float = 1.0,
    ) -> list[Array]:
        """A channel of the nominal world per episode.

        With its start shifted, or time, pushes or the derivative gains multiplied.
        """
        row, numbers = CHANNELS.index(channel), self.limb.nominal.copy()
        numbers[:, KD] *= damped
        shift = started * np.eye(len(numbers))[self.index]
        limb = self.limb if paced == 1.0 else self.limb.paced(paced)
        if pushed != 1.0:
            more = np.where(np.arange(len(numbers)) == self.index, pushed, 1.0)
            limb = limb.pushed([r.push * more for r in limb.recordings])
        return [shown[:, row, self.index] for shown in _shown(limb, numbers, shift)]


def tracks(limbs: Sequence[Limb]) -> list[Track]:
    """The joints of all limbs; each limb is replayed once."""
    return [track for limb in limbs for track in _of_limb(limb)]


def _of_limb(limb: Limb) -> Iterator[Track]:
    near = replace(limb, recordings=tuple(map(_within_reach, limb.recordings)))
    shown = _shown(near, near.nominal, 0.0)
    for j in range(len(limb.joints)):
        yield Track(
            limb=near,
            index=j,
            time_s=[r.time_s for r in limb.recordings],
            command=[r.command[:, j] for r in limb.recordings],
            position=[r.measured[:, 0, j] for r in limb.recordings],
            shown=[s[:, 0, j] for s in shown],
        )


def _within_reach(recording: Recording) -> Recording:
    """The recording with commands for positions that move so far that they are in another unit."""
    command, position = recording.command, recording.measured[:, 0]
    odd = np.ptp(position, axis=0) > FARTHEST * np.maximum(np.ptp(command, axis=0), LEAST)
    measured = recording.measured.copy()
    measured[:, 0] = np.where(odd, command, position)
    return replace(recording, measured=measured, start=np.where(odd, command[0], recording.start))


def _shown(limb: Limb, numbers: Array, shift: Array | float) -> list[Array]:
    """What the sensors of a limb would read, sample by sample, (T, 3, K) by episode."""
    lengths = enumerate(len(r.time_s) for r in limb.recordings)
    return [limb.readings(n, np.arange(t + 1), numbers, shift=shift) for n, t in lengths]
