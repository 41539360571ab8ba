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
from backends.effect import UNITS, Effect
from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.motion.columns import KP, STIFFNESS
from diagnosis.motion.recordings import Recording
from diagnosis.verdict.result import Cause, LimbResult
from diagnosis.verdict.sentences import sentences

PLAY, DEAD_ZONE = "drive.play_rad", "drive.dead_zone_rad"
SURE_Z, Z90 = 3.5, 1.645
"""Play is named so many standard deviations from none; half of a 90 % interval."""
HARD = 0.9
"""A push counts while it is this share of its largest."""
LEAST_REST = 4
"""Readings from the end of a push to what comes next; the later half of them counts."""
SAME_HOLD_RAD = 1e-3
"""Commands that differ by less hold the same position."""
MOTOR_ANGLE = "log the motor's angle as well"


@dataclass(frozen=True, kw_only=True)
class Press:
    """A joint pushed one way and let go while its command stands still."""

    command_rad: float
    side: int
    """Way of the push: -1 or 1."""
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
    presses: tuple[Press, ...]

    @property
    def push_nm(self) -> float:
        """Mean size of the pushes."""
        return float(np.mean([press.push_nm for press in self.presses]))


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
    causes = tuple(_cause(one, effect, catalogue[effect].unit) for one in found)
    before, after = (max(getattr(one, name) for one in found) for name in ("before", "after"))
    said = replace(
        result,
        verdict=(effect,),
        causes=causes,
        leading=causes,
        share=min(one.share for one in found),
        gap_nominal=before,
        left=after,
        gap_after=after,
        tied=tuple((f"{names[DEAD_ZONE]}@{one.joint}",) for one in found if DEAD_ZONE in names),
        experiment=MOTOR_ANGLE,
    )
    return sentences(said)


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
    def share(self) -> float:
        """Share of the squared gap beyond one floor that it takes."""
        return 1.0 - max(self.after**2 - 1.0, 0.0) / max(self.before**2 - 1.0, 1e-9)


def _cause(one: Play, effect: str, unit: str) -> Cause:
    size = UNITS[unit][1]
    return Cause(
        effect=effect,
        joint=one.joint,
        joints=(one.joint,),
        value=(one.low_rad + one.high_rad) / 2 / size,
        low=one.interval_rad[0] / size,
        high=one.interval_rad[1] / size,
        unit=unit,
        share=one.share,
    )


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
    places = _places([p for r in evidence.limb.recordings for p in _presses(r, j)])
    if not places:
        return None
    sides = [np.stack([_rests(place, side) for place in places]) for side in (-1, 1)]
    pushed, released = np.mean(sides[1] - sides[0], axis=0)
    presses = tuple(press for place in places for press in place)
    squares = [_error(presses, side, _sigma_rad(evidence, j)) for side in (-1, 1)]
    return LostMotion(
        pushed_rad=float(pushed),
        released_rad=float(released),
        errors_rad=tuple(np.sqrt(np.sum(squares, axis=0)).tolist()),
        presses=presses,
    )


def _sigma_rad(evidence: Evidence, j: int) -> float:
    """One floor of a single position [rad]."""
    return float(evidence.floor[0, j])


def _rests(place: Sequence[Press], side: int) -> Array:
    """Mean rests of one side, under the push and after it."""
    return np.mean([press.rests_rad for press in place if press.side == side], axis=0)


def _error(presses: Sequence[Press], side: int, least_rad: float) -> Array:
    """Squared standard errors of the mean rests of one side."""
    rests = np.array([press.rests_rad for press in presses if press.side == side])
    return np.maximum(rests.var(axis=0), least_rad**2) / len(rests)


def _gaps(found: LostMotion, yields_rad: float, sigma_rad: float) -> tuple[float, float]:
    """`Play.before` and `Play.after`."""
    side = np.array([[press.side] for press in found.presses])
    rests = np.array([press.rests_rad for press in found.presses])
    usual = side * np.array([yields_rad, 0.0])
    means = np.where(side > 0, _rests(found.presses, 1), _rests(found.presses, -1))
    before, after = (float(np.sqrt(np.mean((rests - at) ** 2))) for at in (usual, means))
    return before / sigma_rad, after / sigma_rad


def _presses(recording: Recording, j: int) -> Iterator[Press]:
    """The presses of joint `j` in one episode; a push shows in the reading after its row."""
    load, command = recording.push[:, j], recording.command[:, j]
    reading, sign = recording.measured[:, 0, j], np.sign(load)
    edges = np.flatnonzero((np.diff(sign) != 0) | (np.diff(command) != 0)) + 1
    runs = list(zip([0, *edges], [*edges, len(load)], strict=True))
    for (start, stop), (_, end) in zip(runs[:-1], runs[1:], strict=True):
        let_go = sign[stop] == 0.0 and command[stop] == command[start]
        if sign[start] == 0.0 or not let_go or end - stop < LEAST_REST:
            continue
        held = float(command[start])
        hard = np.flatnonzero(np.abs(load[start:stop]) >= HARD * np.abs(load[start:stop]).max())
        under, after = reading[start + hard + 1], reading[(stop + end) // 2 : end]
        yield Press(
            command_rad=held,
            side=int(sign[start]),
            push_nm=float(np.abs(load[start + hard]).mean()),
            rests_rad=(float(np.median(under) - held), float(np.median(after) - held)),
        )


def _places(presses: Sequence[Press]) -> list[list[Press]]:
    """Presses by the position that was held, where it was pushed both ways."""
    places: list[list[Press]] = []
    for press in sorted(presses, key=lambda p: p.command_rad):
        if not places or press.command_rad - places[-1][0].command_rad > SAME_HOLD_RAD:
            places.append([])
        places[-1].append(press)
    return [place for place in places if {p.side for p in place} == {-1, 1}]
