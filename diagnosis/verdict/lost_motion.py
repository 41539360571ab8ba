"""Play by lost motion: where a held joint rests when it is pushed either way, and after that.

For logs whose samples are so far apart that no replay follows them (`evidence.SLOW_S`). Without
play a push P sets a joint of gain kp, teeth k and Coulomb friction f to either side by no more than

    (P - f) / kp + P / k     while it lasts, P / k where f > P
    min(f, P - f) / kp       after it, 0 where f > P

so friction takes from the one what it adds to the other. A play of 2h adds 2h to what lies between
the sides while the push lasts, and at most that after it. With L, the lost motion, between them:

    (L_pushed + L_released) / 2 - P (1 / kp + 1 / k)  <=  2h  <=  L_pushed - 2 P / k

It is the lower end where the drive yields, the upper one where friction holds the motor still:
without the motor's angle a log does not say which. A loop that is closed on the joint pulls a part
of the play back; there the lower end holds. A dead zone of the drive shows as play does. What is
softer than nominal leaves no lost motion after a push.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.catalogue import of_part
from backends.effect import Effect
from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.motion.columns import KP, STIFFNESS
from diagnosis.motion.presses import Press, places, presses
from diagnosis.motion.recordings import Recording
from diagnosis.verdict.result import Z90, LimbResult, cause

PLAY, DEAD_ZONE = "drive.play_rad", "drive.dead_zone_rad"
SURE_Z = 3.5
"""Play is named so many standard deviations from none."""
HARD = 0.9
"""A push counts while it is this share of its largest."""
LEAST_REST = 4
"""Readings from the end of a push to what comes next; the later half of them counts."""
MOTOR_ANGLE = "log the motor's angle as well"


@dataclass(frozen=True, kw_only=True)
class Rest:
    """Where a joint rests that is pushed one way and let go."""

    press: Press
    push_nm: float
    """Its size."""
    rests_rad: tuple[float, float]
    """Where the joint is, about its command: under the push, and after it."""


@dataclass(frozen=True, kw_only=True)
class LostMotion:
    """Between where a joint rests on either side, mean over the positions held."""

    pushed_rad: float
    released_rad: float
    errors_rad: tuple[float, float]
    """Standard errors of both."""
    rests: tuple[Rest, ...]

    @property
    def push_nm(self) -> float:
        """Mean size of the pushes."""
        return float(np.mean([rest.push_nm for rest in self.rests]))


def with_play(
    result: LimbResult,
    evidence: Evidence,
    catalogue: Mapping[str, type[Effect]],
    uncertainty: float,
) -> LimbResult:
    """The result of a slow log, of play alone where rests show play that friction is not.

    `uncertainty`: of gains and teeth, relative. Other logs' results stay as they are.
    """
    names = of_part(catalogue, "drive")
    if not evidence.only_rests or PLAY not in names:
        return result
    each = (play(evidence, j, uncertainty) for j in range(len(evidence.joints)))
    found = [one for one in each if one is not None]
    if not found:
        return result
    effect = names[PLAY]
    causes = tuple(
        cause(
            effect,
            one.sizes_rad,
            catalogue,
            joints=(one.joint,),
            share=one.share,
            at=evidence.place(evidence.joints.index(one.joint)),
        )
        for one in found
    )
    before, after = (max(getattr(one, name) for one in found) for name in ("before", "after"))
    return replace(
        result,
        verdict=(effect,),
        causes=causes,
        leading=causes,
        share=min(one.share for one in found),
        gap_nominal=before,
        left=after,
        tied=tuple((f"{names[DEAD_ZONE]}@{one.joint}",) for one in found if DEAD_ZONE in names),
        experiment=MOTOR_ANGLE,
    )


@dataclass(frozen=True, kw_only=True)
class Play:
    """The half play of a joint that no friction makes up."""

    joint: str
    low_rad: float
    high_rad: float
    interval_rad: tuple[float, float]
    before: float
    """Gap of all rests from those of the nominal drive [floors]."""
    after: float
    """The same from their side's mean."""

    @property
    def sizes_rad(self) -> tuple[float, float, float]:
        """Its middle, and its 90 % interval."""
        return (self.low_rad + self.high_rad) / 2, *self.interval_rad

    @property
    def share(self) -> float:
        """Share of the squared gap beyond one floor that it takes."""
        return 1.0 - max(self.after**2 - 1.0, 0.0) / max(self.before**2 - 1.0, 1e-9)


def play(evidence: Evidence, j: int, uncertainty: float) -> Play | None:
    """The play of joint `j`; None where friction may make up its lost motion."""
    found, numbers = lost_motion(evidence, j), evidence.limb.nominal[j]
    if found is None:
        return None
    give = 0.0 if evidence.limb.rigid else found.push_nm / numbers[STIFFNESS]
    yields = found.push_nm / numbers[KP] + give
    low = (found.pushed_rad + found.released_rad) / 2 - yields
    high = found.pushed_rad - 2 * give
    error = float(np.hypot(np.hypot(*found.errors_rad) / 2, uncertainty * yields))
    if min(low / error, found.released_rad / found.errors_rad[1]) < SURE_Z:
        return None
    before, after = _gaps(found, yields, _sigma_rad(evidence, j))
    return Play(
        joint=evidence.joints[j],
        low_rad=low / 2,
        high_rad=high / 2,
        interval_rad=(max(low - Z90 * error, 0.0) / 2, (high + Z90 * error) / 2),
        before=before,
        after=after,
    )


def lost_motion(evidence: Evidence, j: int) -> LostMotion | None:
    """The lost motion of joint `j`; None where nothing pushes it both ways at one position."""
    every = [rest for r in evidence.limb.recordings for rest in _rests_of(r, j)]
    groups = [[every[k] for k in group] for group in places([rest.press for rest in every])]
    if not groups:
        return None
    sides = [np.stack([_rests(group, side) for group in groups]) for side in (0, 1)]
    pushed, released = np.mean(sides[1] - sides[0], axis=0)
    rests = tuple(rest for group in groups for rest in group)
    squares = [_error(rests, side, _sigma_rad(evidence, j)) for side in (0, 1)]
    return LostMotion(
        pushed_rad=float(pushed),
        released_rad=float(released),
        errors_rad=tuple(np.sqrt(np.sum(squares, axis=0)).tolist()),
        rests=rests,
    )


def _sigma_rad(evidence: Evidence, j: int) -> float:
    """One floor of a single position [rad]."""
    return float(evidence.floor[0, j])


def _of_side(rests: Sequence[Rest], side: int) -> Array:
    """Rests of one side (R, 2), under the push and after it."""
    return np.array([rest.rests_rad for rest in rests if rest.press.side == side])


def _rests(rests: Sequence[Rest], side: int) -> Array:
    """Mean rests of one side, under the push and after it."""
    return _of_side(rests, side).mean(axis=0)


def _error(rests: Sequence[Rest], side: int, least_rad: float) -> Array:
    """Squared standard errors of the mean rests of one side."""
    found = _of_side(rests, side)
    return np.maximum(found.var(axis=0), least_rad**2) / len(found)


def _gaps(found: LostMotion, yields_rad: float, sigma_rad: float) -> tuple[float, float]:
    """`Play.before` and `Play.after`."""
    side = np.array([[rest.press.side] for rest in found.rests])
    rests = np.array([rest.rests_rad for rest in found.rests])
    usual = (2 * side - 1) * np.array([yields_rad, 0.0])
    means = np.where(side > 0, _rests(found.rests, 1), _rests(found.rests, 0))
    before, after = (float(np.sqrt(np.mean((rests - at) ** 2))) for at in (usual, means))
    return before / sigma_rad, after / sigma_rad


def _rests_of(recording: Recording, j: int) -> Iterator[Rest]:
    """Where joint `j` rests, press by press; a push shows in the reading after its row."""
    load, reading = recording.push[:, j], recording.measured[:, 0, j]
    for press in presses(recording.command[:, j], load):
        let_go, end = press.released.start, press.released.stop
        if end - let_go >= LEAST_REST:
            hard = press.hard(load, HARD)
            both = reading[hard + 1], reading[(let_go + end) // 2 : end]
            under, after = (float(np.median(part) - press.held_rad) for part in both)
            push_nm = float(np.abs(load[hard]).mean())
            yield Rest(press=press, push_nm=push_nm, rests_rad=(under, after))
