"""Play by lost motion: where a held joint rests when it is pushed either way, and after that.

For slow logs, which no replay follows (`slow`). Without play a push P sets a joint of gain kp,
teeth k and Coulomb friction f to either side by no more than

    (P - f) / kp + P / k     while it lasts, P / k where f > P
    min(f, P - f) / kp       after it, 0 where f > P

so friction takes from the one what it adds to the other. A play of 2h adds 2h to what lies between
the sides while the push lasts, and at most that after it. With L, the lost motion, between them:

    (L_pushed + L_released) / 2 - P (1 / kp + 1 / k)  <=  2h  <=  L_pushed - 2 P / k

It is the lower end where the drive yields, the upper one where friction holds the motor still:
without the motor's angle a log does not tell. A loop that is closed on the joint pulls a part of
the play back; there the lower end holds. A dead zone of the drive shows as play does. What is
softer than nominal leaves no lost motion after a push.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.evidence import Evidence, Recording
from diagnosis.attribution.experiments import LOGGING
from diagnosis.attribution.intervals import Z90
from diagnosis.attribution.rules import rules
from diagnosis.beside.sensing import PUSH, Finding
from diagnosis.beside.slow import is_slow
from diagnosis.calibration.backlash import SAME_HOLD_RAD
from diagnosis.finding import gap, share

BACKLASH, DEAD_ZONE = "backlash", "dead-zone"
HARD = 0.9
"""A push counts while it is this share of its largest."""
LEAST_REST = 4
"""Readings from the end of a push to what comes next; the later half of them counts."""


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


def plays(
    parts: Sequence[Evidence], catalogue: Mapping[str, type[Effect]], uncertainty: float
) -> tuple[Finding, ...]:
    """Play of the joints that slow logs push; gains and teeth are uncertain by a share."""
    if BACKLASH not in catalogue:
        return ()
    joints = [(part, j) for part in parts if is_slow(part) for j in range(len(part.joints))]
    found = (_play(part, j, catalogue, uncertainty) for part, j in joints)
    return tuple(one for one in found if one is not None)


def lost_motion(part: Evidence, j: int) -> LostMotion | None:
    """The lost motion of joint `j`; None where nothing pushes it both ways at one position."""
    places = _places([press for r in part.recordings for press in _presses(r, j)])
    if not places:
        return None
    sides = [np.stack([_rests(place, side) for place in places]) for side in (-1, 1)]
    pushed, released = np.mean(sides[1] - sides[0], axis=0)
    presses = tuple(press for place in places for press in place)
    squares = [_error(presses, side, float(part.sigma[0, 0, j])) for side in (-1, 1)]
    return LostMotion(
        pushed_rad=float(pushed),
        released_rad=float(released),
        errors_rad=tuple(np.sqrt(np.sum(squares, axis=0)).tolist()),
        presses=presses,
    )


def _rests(place: Sequence[Press], side: int) -> Array:
    """Mean rests of one side, under the push and after it."""
    return np.mean([press.rests_rad for press in place if press.side == side], axis=0)


def _error(presses: Sequence[Press], side: int, least_rad: float) -> Array:
    """Squared standard errors of the mean rests of one side."""
    rests = np.array([press.rests_rad for press in presses if press.side == side])
    return np.maximum(rests.var(axis=0), least_rad**2) / len(rests)


def _play(part: Evidence, j: int, catalogue: Collection[str], uncertainty: float) -> Finding | None:
    """The play of joint `j`, where no friction makes up its lost motion."""
    found, drive = lost_motion(part, j), part.nominal.drives[j]
    if found is None:
        return None
    give = found.push_nm / drive.gear_stiffness_nm_rad
    yields = found.push_nm / drive.kp_nm_rad + give
    both = (found.pushed_rad + found.released_rad) / 2
    low, high = both - yields, found.pushed_rad - 2 * give
    error = float(np.hypot(np.hypot(*found.errors_rad) / 2, uncertainty * yields))
    sure = min(low / error, found.released_rad / found.errors_rad[1])
    nats = max(sure, 0.0) ** 2 / 2
    if nats < rules().accuse_nats:
        return None
    before, after = _gaps(found, yields, float(part.sigma[0, 0, j]))
    name = part.joints[j]
    return Finding(
        effect=BACKLASH,
        joint=name,
        joints=(name,),
        family=PUSH,
        value=(low + high) / 4,
        interval=(max(low - Z90 * error, 0.0) / 2, (high + Z90 * error) / 2),
        share=share(before, after),
        gap_before=before,
        gap_after=after,
        lead_nats=nats,
        ties=tuple((other, 0.0) for other in (DEAD_ZONE,) if other in catalogue),
        experiment=LOGGING["motor"],
        instead=True,
        evidence=f"pushed by {found.push_nm:.3g} Nm either way it rests "
        f"{1e3 * found.pushed_rad:.3g} mrad apart, released {1e3 * found.released_rad:.3g}; "
        f"friction does that only where drive and teeth are {both / yields:.2g} times softer",
    )


def _gaps(found: LostMotion, yields_rad: float, sigma_rad: float) -> tuple[float, float]:
    """Gaps of all rests from those of the nominal drive, and from their side's mean."""
    side = np.array([[press.side] for press in found.presses])
    rests = np.array([press.rests_rad for press in found.presses])
    usual = side * np.array([yields_rad, 0.0])
    means = np.where(side > 0, _rests(found.presses, 1), _rests(found.presses, -1))
    return gap((rests - usual).ravel(), sigma_rad), gap((rests - means).ravel(), sigma_rad)


def _presses(recording: Recording, j: int) -> Iterator[Press]:
    """The presses of joint `j` in one episode; a push shows in the reading after its row."""
    load, command = recording.commands.load[:, j], recording.commands.target[:, j]
    reading, sign = recording.measured[0, :, j], np.sign(load)
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
