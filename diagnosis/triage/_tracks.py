"""One joint of a log and the same joint of the nominal world under its commands, for the triage."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import COLUMNS, KD, KP, LIMIT, with_numbers
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import CHANNELS, Recording
from diagnosis.triage._signals import LENGTHS, UNITS, centred

FARTHEST, LEAST = 5.0, 1.0
"""No joint moves by so many times its command's range, where that is at least a radian or metre."""


@dataclass(frozen=True, eq=False)
class Replays:
    """What the sensors of a limb would read in the nominal world and beside it."""

    limb: Limb
    found: dict[tuple, list[Array]] = field(default_factory=dict)
    """Of worlds that all joints ask for."""

    def at(self, paced: float = 1.0, damped: float = 1.0, limited: float = 1.0) -> list[Array]:
        """Readings (T, 3, K) by episode, with time, derivative gains or limits multiplied."""
        if (paced, damped, limited) not in self.found:
            numbers, limb = self.limb.nominal.copy(), self.limb
            numbers[:, KD] *= damped
            numbers[:, LIMIT] *= limited
            if paced != 1.0:
                every = (replace(r, time_s=r.time_s * paced) for r in limb.recordings)
                limb = replace(limb, recordings=tuple(every))
            self.found[paced, damped, limited] = shown_by(limb, numbers)
        return self.found[paced, damped, limited]

    def in_unit(self, slides: bool, per_si: float) -> list[Array]:
        """Readings [rad, m] where hinges, or slides, are logged in a unit of so many per SI's."""
        if (slides, per_si, "unit") not in self.found:
            alike = [body.joint.slides == slides for body in self.limb.spec.hand.driven]
            size = np.where(alike, per_si, 1.0)
            every = tuple(_converted(r, size) for r in self.limb.recordings)
            limb = replace(self.limb, recordings=every)
            self.found[slides, per_si, "unit"] = shown_by(limb, limb.nominal)
        return self.found[slides, per_si, "unit"]


@dataclass(frozen=True, kw_only=True)
class Track:
    """A joint over all episodes of its limb; lists hold an array (T,) per episode."""

    limb: Limb
    """Its limb, about a motion that may be one, see `_within_reach`."""
    replays: Replays
    """Those of its limb, which all joints share."""
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
    def si(self) -> str:
        """Its unit."""
        return "m" if self.slides else "rad"

    @property
    def units(self) -> dict[str, float]:
        """Other units that people use, per radian or metre."""
        return LENGTHS if self.slides else UNITS

    @property
    def room(self) -> float:
        """The farthest end of its range from zero [rad or m]."""
        return max(map(abs, self.limb.spec.hand.driven[self.index].joint.range_rad))

    @property
    def reach(self) -> float:
        """The farthest command from zero [rad or m]."""
        return max(float(np.abs(c).max()) for c in self.command)

    @property
    def dt_s(self) -> float:
        """Sample period [s]."""
        return self.limb.period_s

    @property
    def travel(self) -> float:
        """Largest range of the commands in one episode [rad or m]."""
        return max(float(np.ptp(c)) for c in self.command)

    @property
    def moves(self) -> float:
        """Largest range of the nominal world's readings in one episode [rad or m]."""
        return max(float(np.ptp(s)) for s in self.shown)

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

    def nominal(self, channel: str, **multiplied: float) -> list[Array]:
        """A channel of the nominal world per episode, see `Replays.at`."""
        row = CHANNELS.index(channel)
        return [shown[:, row, self.index] for shown in self.replays.at(**multiplied)]

    def beside(self, limb: Limb, started: float = 0.0) -> "Track":
        """The same track beside another limb, with its own start shifted."""
        shift = started * np.eye(len(limb.joints))[self.index]
        every = shown_by(limb, limb.nominal, shift)
        return replace(self, shown=[shown[:, 0, self.index] for shown in every])

    def varied(self, **multiplied: float) -> "Track":
        """The same track beside another nominal world, see `Replays.at`."""
        return replace(self, shown=self.nominal("position", **multiplied))

    def in_unit(self, per_si: float) -> "Track":
        """The same track where both sides are in a unit of so many per radian or metre."""
        shown = self.replays.in_unit(self.slides, per_si)
        return replace(
            self,
            command=[c / per_si for c in self.command],
            position=[p / per_si for p in self.position],
            shown=[one[:, 0, self.index] for one in shown],
        )

    def unpushed(self) -> "Track":
        """The same track beside a nominal world that is not pushed."""
        others = np.arange(len(self.limb.joints)) != self.index
        return self.beside(self.limb.pushed([r.push * others for r in self.limb.recordings]))

    def undriven(self) -> "Track":
        """The same track beside a nominal world whose drive of it gives no torque."""
        numbers = {self.name: {COLUMNS[KP]: 0.0}}
        return self.beside(replace(self.limb, spec=with_numbers(self.limb.spec, numbers)))


def tracks(limbs: Sequence[Limb]) -> list[Track]:
    """The joints of all limbs; each limb is replayed once."""
    return [track for limb in limbs for track in _of_limb(limb)]


def _of_limb(limb: Limb) -> Iterator[Track]:
    near = replace(limb, recordings=tuple(_within_reach(r, limb.open) for r in limb.recordings))
    replays = Replays(near)
    for j in range(len(limb.joints)):
        yield Track(
            limb=near,
            replays=replays,
            index=j,
            time_s=[r.time_s for r in limb.recordings],
            command=[r.command[:, j] for r in limb.recordings],
            position=[r.measured[:, 0, j] for r in limb.recordings],
            shown=[s[:, 0, j] for s in replays.at()],
        )


def _within_reach(recording: Recording, is_open: Array) -> Recording:
    """The recording with commands for positions that move so far that they are in another unit."""
    command, position = recording.command, recording.measured[:, 0]
    odd = np.ptp(position, axis=0) > FARTHEST * np.maximum(np.ptp(command, axis=0), LEAST)
    odd &= ~is_open
    measured = recording.measured.copy()
    measured[:, 0] = np.where(odd, command, position)
    return replace(recording, measured=measured, start=np.where(odd, command[0], recording.start))


def _converted(recording: Recording, per_si: Array) -> Recording:
    """The recording in SI units, from one of so many per SI's, by joint (K,)."""
    measured = recording.measured.copy()
    measured[:, :2] /= per_si
    return replace(
        recording,
        command=recording.command / per_si,
        measured=measured,
        start=recording.start / per_si,
        speed=None if recording.speed is None else recording.speed / per_si,
    )


def shown_by(limb: Limb, numbers: Array, shift: Array | float = 0.0) -> list[Array]:
    """What the sensors of a limb would read, sample by sample, (T, 3, K) by episode."""
    lengths = enumerate(len(r.time_s) for r in limb.recordings)
    return [limb.readings(n, np.arange(t + 1), numbers, shift=shift) for n, t in lengths]
