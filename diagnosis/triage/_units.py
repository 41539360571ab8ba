"""Command and position both in another unit: by weight, by the range of joints, or by their motion.

A robot has one convention, so hinges are judged together, and slides: by the geometric mean of what
each leaves, in which no joint that is off for a reason of its own outweighs the others. Where they
do not agree each is judged by itself.

Where nothing but stiffness and inertia acts, a motion looks the same in every unit. Weight, limits
of torque and links that turn far tell units apart, and so does the joint's range.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from backends.state import Array
from diagnosis.triage._signals import CLEAR, COUNTS, LENGTHS, OPTIONS, UNITS, line
from diagnosis.triage._tracks import BETTER, SCALES, Fault, Track
from diagnosis.triage._weight import WRONG, Sags

FREE, MOVED, ASIDE = (
    np.geomspace(*ends) for ends in ((1e-2, 1e4, 400), (1e-2, 1e4, 25), (0.5, 2, 9))
)
"""Sizes of a unit that are tried by weight and by motion, and multiples of that of the weight."""
NEAR = 0.03
"""A size is that of an encoder's counts within this share."""
BEYOND, WITHIN = 3.0, 1.5
"""Commands beyond the first multiple of a joint's range are in another unit if that brings them
within the second."""
FINE, SAME = 0.05, 0.2
"""Share of the motion that is left where no unit can be wrong, and up to which another is right."""
CLOSER = 1.3
"""Of two sizes without a name, the one that leaves less by this factor."""
LEAST = 1e-3
"""Less than this share says nothing more."""

MOVES = "then the nominal world moves as logged"
LIMIT, WEIGHT = "its limit of torque is another", "its drive carries the weight"
HELD, BIASED = "friction holds it beside its targets", "its sensor is biased"


def both(every: Sequence[Track]) -> Iterator[Fault]:
    """Commands and positions that are in another unit, not one of them alone."""
    for kind in (False, True):
        some = tuple(track for track in every if track.slides == kind and not _one_sided(track))
        yield from _both(some)


def _both(some: Sequence[Track]) -> Iterator[Fault]:
    """Of all together, or else of each by itself."""
    moves = any(track.travel for track in some)
    said = _unit(joints := Joints(tracks=tuple(some))) if moves else None
    if said:
        yield said.fault(joints.agree(said.per_si) or some)
    elif len(some) > 1:
        yield from (fault for track in some for fault in _both([track]))


def perhaps(every: Sequence[Track]) -> Iterator[str]:
    """What to say where another unit would explain a motion, and so would another limit alone."""
    for track in every:
        joints = Joints(tracks=(track,))
        said = joints.moves_as_logged()
        if said is not None and joints.rivals(said.per_si) == [LIMIT]:
            unit = said.of(track.si)
            yield f"commands and positions of {track.name} may be in {unit}; or {LIMIT}"


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A unit, of which so many make one of SI's, and what shows it."""

    per_si: float
    why: str
    name: str = ""
    """Of those that people use; else a gear's or a calibration's."""

    def fault(self, tracks: Sequence[Track]) -> Fault:
        """Commands and positions of joints that are in it."""
        si, known = tracks[0].si, OPTIONS.get(self.name)
        return Fault(
            kind="unit",
            joints=tuple(track.name for track in tracks),
            evidence=f"both are in {self.of(si)}",
            remedy=f"convert command and position to {si}"
            + (f", or read the table with --unit {known}" if known else ""),
        )

    def of(self, si: str) -> str:
        """Its name, or its size, and what shows it."""
        size = self.per_si
        gear = f"motor-side, {size:.2g} to 1" if size > 1.0 else f"geared, 1 to {1.0 / size:.2g}"
        counts = (name for name, per_rad in COUNTS.items() if abs(size / per_rad - 1.0) < NEAR)
        side = gear if si == "m" else next(counts, gear)
        free = f"a unit of which about {size:.2g} make one {si}: {side}, or of a calibration"
        return f"{self.name or free}: {self.why}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Joints:
    """Joints that are in one unit, all hinges or all slides."""

    tracks: tuple[Track, ...]

    @cached_property
    def sags(self) -> list[Sags]:
        """Of those that move and show their weight."""
        every = (Sags.of(track) for track in self.tracks if track.travel)
        return [sags for sags in every if sags.show_weight]

    def left(self, per_si: float = 1.0) -> float:
        """Share of the motion and of the sag that are left in a unit."""
        return self._left(
            lambda track: track.varied(per_si), lambda sags: sags.misfit(per_si, sizes=SCALES)
        )

    def _left(
        self,
        other: Callable[[Track], Track],
        sagged: Callable[[Sags], float] = lambda sags: sags.misfit(sizes=SCALES),
        rubs: bool = False,
    ) -> float:
        """With joints beside another world, and with what is left of a sag; `rubs`: see `_left`."""
        motions = (_left(other(track), rubs) for track in self.tracks if track.travel)
        return _together([*motions, *map(sagged, self.sags)])

    @property
    def fall(self) -> bool:
        """Whether the nominal world cannot follow a whole limb."""
        whole = len(self.tracks) >= max(len(track.limb.joints) for track in self.tracks)
        return whole and not np.isfinite(self.left())

    def agree(self, per_si: float) -> list[Track]:
        """Those that move far less as logged where they alone are in SI's unit."""

        def agrees(track: Track) -> bool:
            alone = _left(track.varied(1.0, others=per_si))
            return alone * BETTER > _left(track.varied(per_si))

        return [track for track in self.tracks if not track.travel or agrees(track)]

    @cached_property
    def units(self) -> dict[str, float]:
        """Units in which the commands are within the joints' ranges: named, or of their weight.

        Which counts of an encoder they are, no motion says.
        """
        reach = max(track.reach / track.room for track in self.tracks)
        known = dict(LENGTHS if self.tracks[0].slides else UNITS)

        def sag(per_si: float = 1.0) -> float:
            return _together(sags.misfit(per_si) for sags in self.sags)

        if self.sags and sag() >= WRONG:
            _, rough = _free(sag, FREE)
            if not SCALES[0] < rough < SCALES[1]:  # so far off a gain or a sensor may be
                known[""] = _free(self.left, rough * ASIDE)[1]
        return {name: size for name, size in known.items() if reach / size <= WITHIN}

    def beyond(self) -> str:
        """What shows that commands are far outside of a joint's range; else nothing."""
        widest = max(self.tracks, key=lambda track: track.reach / track.room)
        reach, room, si = widest.reach, widest.room, widest.si
        far = reach >= BEYOND * room
        return f"commands reach {reach:.3g} {si}, the joint only {room:.3g} {si}" if far else ""

    def best(self) -> tuple[str, float]:
        """The unit that leaves least, or an earlier one that leaves hardly more; what it leaves."""
        found = {name: self.left(size) for name, size in self.units.items()}
        best = next(iter(found))
        for name, left in found.items():
            best = name if left * BETTER < found[best] else best
        return best, found[best]

    def moves_as_logged(self) -> Unit | None:
        """The unit in which the nominal world moves as logged."""
        if (left := self.left()) < FINE or not self.units:  # the second takes long
            return None
        best, then = self.best()
        if then > SAME or then * BETTER > left:
            return None
        why = f"{MOVES} (it leaves {then:.2g} of the motion, and as they are {left:.2g})"
        return Unit(per_si=self.units[best], why=why, name=best)

    def rivals(self, per_si: float) -> list[str]:
        """What else leaves as little: a limit of torque, a carried weight, friction or a bias."""
        found = {
            LIMIT: self._left(lambda track: track.varied(limited=per_si)),
            WEIGHT: self._left(Track.weightless, lambda sags: sags.misfit(sizes=(0.0, np.inf))),
            HELD: self._left(lambda track: track, rubs=True),
            BIASED: self._left(_unbiased, lambda sags: sags.left(biased=True), rubs=True),
        }
        most = BETTER * self.left(per_si)
        return [text for text, left in found.items() if left < most]


def _unit(joints: Joints) -> Unit | None:
    """The unit that joints are in, where that is not SI's."""
    said, beyond = joints.moves_as_logged(), joints.beyond()
    if beyond and joints.units:
        name, _ = joints.best()
        said = Unit(per_si=joints.units[name], why=beyond, name=name)
    elif said is None and joints.fall:
        said = Unit(per_si=1.0, why=MOVES)
    elif said is None or joints.rivals(said.per_si):
        return None
    left, size = _free(joints.left, MOVED)
    if left * (BETTER if said.name else CLOSER) < joints.left(said.per_si):
        said = Unit(per_si=size, why=MOVES)
    return said if said.per_si != 1.0 and (beyond or left < SAME) else None


def _free(misfit: Callable[[float], float], sizes: Array) -> tuple[float, float]:
    """The least misfit of any unit, and how many of that unit make one of SI's."""
    logs, step = np.log(sizes), float(np.log(sizes[1] / sizes[0]))
    tried = [misfit(float(size)) for size in sizes]
    best = int(np.argmin(tried))
    ends = logs[best] - step, logs[best] + step
    near = minimize_scalar(lambda log: misfit(float(np.exp(log))), bounds=ends, method="bounded")
    return min((tried[best], float(sizes[best])), (float(near.fun), float(np.exp(near.x))))


def _one_sided(track: Track) -> bool:
    """Whether positions follow their commands at another scale, so that one side alone is off."""
    found = line(track.command, track.position)
    return abs(found.correlation) > CLEAR and not SCALES[0] <= found.slope <= SCALES[1]


def _unbiased(track: Track) -> Track:
    """The track beside a nominal world that begins as much aside as its sensor seems to be."""
    offset = float(np.median(np.concatenate(track.missed)))
    return track.beside(track.limb, started=-offset) if np.isfinite(offset) else track


def _together(found: Iterable[float]) -> float:
    """The geometric mean of shares; 0 of none."""
    every = np.maximum(list(found), LEAST)
    return float(np.exp(np.log(every).mean())) if every.size else 0.0


def _left(track: Track, rubs: bool = False) -> float:
    """Share of the motion that is left with the nominal world's, of any size and a little late.

    `rubs`: and beside it to either side, as dry friction and a load hold a joint.
    """
    shown, read = np.concatenate(track.shown), np.concatenate(track.position)
    if not np.isfinite(shown).all():
        return np.inf
    pairs = zip(track.time_s, track.shown, strict=True)
    speed = np.concatenate([np.gradient(s, t) for t, s in pairs])
    beside = [np.sign(speed), np.ones_like(speed)] if rubs else []
    columns = np.stack([shown, speed, *beside], axis=1)
    return track.share(read - columns @ np.linalg.lstsq(columns, read)[0])
