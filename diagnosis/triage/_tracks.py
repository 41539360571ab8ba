"""One joint of a log and the same joint of the nominal world under its commands, for the triage."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import KD, LIMIT
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import Recording
from diagnosis.triage._signals import CLEAR, Regression, line, rms

FARTHEST, LEAST = 5.0, 1.0
"""No joint moves by so many times its command's range, where that is at least a radian or metre."""
SCALES = (0.4, 2.5)
"""Range of position change over command change that gains and sensors can cause."""
BETTER = 3.0
"""A fault is reported if correcting it lowers the misfit by this factor."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault in the data of a log."""

    kind: str
    """One of `triage.KINDS`."""
    joints: tuple[str, ...]
    evidence: str
    """What shows it, with numbers."""
    remedy: str
    """What to do."""

    def __str__(self) -> str:
        return f"{self.kind} of {', '.join(self.joints)}: {self.evidence}; {self.remedy}"


@dataclass(frozen=True, kw_only=True)
class Track:
    """A joint over all episodes of its limb; lists hold an array (T,) per episode."""

    limb: Limb
    """Its limb, about a motion that may be one, see `_within_reach`."""
    replayed: Callable[..., list[Array]]
    """See `_replayed`; all joints of its limb share what it found."""
    index: int
    """Column of the joint in its limb."""
    name: str
    slides: bool
    room: float
    """The farthest end of its range from zero [rad or m]."""
    time_s: list[Array]
    command: list[Array]
    position: list[Array]
    shown: list[Array]
    """Readings of the position sensor in the nominal world."""
    motor: list[Array]
    """The same of the motor."""

    @property
    def si(self) -> str:
        """Its unit."""
        return "m" if self.slides else "rad"

    @property
    def reach(self) -> float:
        """The farthest command from zero [rad or m]."""
        return max(float(np.abs(c).max()) for c in self.command)

    @property
    def travel(self) -> float:
        """Largest range of the commands in one episode [rad or m]."""
        return max(float(np.ptp(c)) for c in self.command)

    @property
    def most_push(self) -> float:
        """The largest known torque or force on it [Nm or N]."""
        return max(float(np.abs(r.push[:, self.index]).max()) for r in self.limb.recordings)

    @property
    def missed(self) -> list[Array]:
        """The positions less the nominal world's."""
        return less(self.position, self.shown)

    @property
    def misfit(self) -> float:
        """Distance of the positions from the nominal world's, over the size of the motion."""
        return self.share(np.concatenate(self.missed))

    def share(self, missed: Array) -> float:
        """A distance of positions (N,), over the size of the motion."""
        moved = np.concatenate([c - c.mean() for c in self.command])
        found = rms(missed) / max(rms(moved), 1e-9)
        return found if np.isfinite(found) else np.inf

    def line(self) -> tuple[Regression, str]:
        """Regression of the position on the nominal world's, or on the command if it is clearer."""
        shown, asked = (line(cause, self.position) for cause in (self.shown, self.command))
        if abs(shown.correlation) >= min(CLEAR, abs(asked.correlation)):
            return shown, "the nominal world's"
        return asked, "its command"

    def fault(self, kind: str, evidence: str, remedy: str) -> Fault:
        """A fault of this joint's data."""
        return Fault(kind=kind, joints=(self.name,), evidence=evidence, remedy=remedy)

    def varied(
        self, per_si: float = 1.0, others: float | None = None, **multiplied: float
    ) -> "Track":
        """The same track beside another nominal world, see `_replayed`.

        Where both sides are in a unit of so many per radian or metre, and those of other joints.
        """
        units = np.array([per_si if others is None else others] * len(self.limb.joints))
        units[[b.joint.slides != self.slides for b in self.limb.spec.hand.driven]] = 1.0
        units[self.index] = per_si
        return replace(
            self,
            command=[c / per_si for c in self.command],
            position=[p / per_si for p in self.position],
            shown=[s[:, self.index] for s in self.replayed(tuple(units), **multiplied)],
        )

    def beside(self, limb: Limb, started: float = 0.0) -> "Track":
        """The same track beside another limb, with its own start shifted."""
        shift = started * np.eye(len(limb.joints))[self.index]
        every = shown_by(limb, limb.nominal, shift)
        return replace(self, shown=[shown[:, 0, self.index] for shown in every])

    def weightless(self) -> "Track":
        """The same track beside a nominal world without gravity."""
        spec = replace(self.limb.spec, gravity_m_s2=(0.0, 0.0, 0.0))
        return self.beside(replace(self.limb, spec=spec))


def less(ones: Sequence[Array], others: Sequence[Array]) -> list[Array]:
    """Differences of two signals by episode."""
    return [one - other for one, other in zip(ones, others, strict=True)]


def tracks(limbs: Sequence[Limb]) -> Iterator[Track]:
    """The joints of all limbs; each limb is replayed once."""
    for limb in limbs:
        near = replace(limb, recordings=tuple(_within_reach(r, limb.open) for r in limb.recordings))
        replayed = cache(partial(_replayed, near))
        nominal = shown_by(near, near.nominal)
        for j, joint in enumerate(body.joint for body in limb.spec.hand.driven):
            yield Track(
                limb=near,
                replayed=replayed,
                index=j,
                name=joint.name,
                slides=joint.slides,
                room=max(map(abs, joint.range_rad)),
                time_s=[r.time_s for r in limb.recordings],
                command=[r.command[:, j] for r in limb.recordings],
                position=[r.measured[:, 0, j] for r in limb.recordings],
                shown=[s[:, 0, j] for s in nominal],
                motor=[s[:, 1, j] for s in nominal],
            )


def _within_reach(recording: Recording, is_open: Array) -> Recording:
    """The recording with commands for positions that move so far that they are in another unit."""
    command, position = recording.command, recording.measured[:, 0]
    odd = np.ptp(position, axis=0) > FARTHEST * np.maximum(np.ptp(command, axis=0), LEAST)
    odd &= ~is_open
    if not odd.any():
        return recording
    measured = recording.measured.copy()
    measured[:, 0] = np.where(odd, command, position)
    return replace(recording, measured=measured, start=np.where(odd, command[0], recording.start))


def _replayed(
    limb: Limb,
    units: tuple[float, ...],
    paced: float = 1.0,
    damped: float = 1.0,
    limited: float = 1.0,
) -> list[Array]:
    """Positions (T, K) by episode, with time, derivative gains or limits multiplied.

    `units`: in how many per radian or metre each joint is logged.
    """
    numbers = limb.nominal.copy()
    numbers[:, KD] *= damped
    numbers[:, LIMIT] *= limited
    if {paced, *units} != {1.0}:
        every = (_converted(r, paced, np.array(units)) for r in limb.recordings)
        limb = replace(limb, recordings=tuple(every))
    return [shown[:, 0].copy() for shown in shown_by(limb, numbers)]  # what is kept


def _converted(recording: Recording, paced: float, per_si: Array) -> Recording:
    """The recording at another pace, in SI units, from one of so many per SI's, by joint (K,)."""
    measured = recording.measured.copy()
    measured[:, :2] /= per_si
    return replace(
        recording,
        time_s=paced * recording.time_s,
        sent_s=None if recording.sent_s is None else paced * recording.sent_s,
        command=recording.command / per_si,
        measured=measured,
        start=recording.start / per_si,
        speed=None if recording.speed is None else recording.speed / per_si / paced,
    )


def shown_by(limb: Limb, numbers: Array, shift: Array | float = 0.0) -> list[Array]:
    """What the sensors of a limb would read, sample by sample, (T, 3, K) by episode."""
    shown = limb.simulate(numbers, shift=shift, edges=limb.every_sample)
    return np.split(shown, np.cumsum([len(r.time_s) for r in limb.recordings])[:-1])
