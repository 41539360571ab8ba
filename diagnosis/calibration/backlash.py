"""Backlash by the push test: hold a joint, push it in both directions, measure where it goes.

As in the paper, the joint rests at q_a and is pushed to its extremes q_b and q_c. The play is [q_c
- q_a, q_b - q_a], averaged over the held positions. Two other motions are subtracted: the motor's
own motion (logged, else replayed in the nominal world) and the elastic deflection of the teeth,
which is proportional to the push. While the teeth touch,

    position - motor = end of the play on that side + give * push

A worm that holds its motor yields differently from a gear that does not. So the replay is made with
and without a lock, and the one with the smaller residual is used.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.spec import Drive, Spec
from backends.state import Array
from diagnosis.motion.batch import Simulate, replay
from diagnosis.motion.presses import Press, places, presses
from diagnosis.motion.recordings import REST_SAMPLES, Recording

PUSHED_SHARE = 0.3
"""Samples with less than this share of a press's largest push are left out: the joint may be
between its teeth."""
VARIED_SHARE = 0.05
"""A push that varies by less than this share cannot separate elastic deflection from play."""
LOCK_NM, LOCK_LIMITS = 10.0, 5.0
"""A lock that holds every push of a push test: this, or this multiple of the drive's largest
torque."""
SMALLEST_RAD = {"logged": np.radians(0.02), "replayed": np.radians(0.05)}
"""A smaller half play counts as none [rad]; a replayed motor has nominal friction, not its real
one."""
STUCK_SHARE = 0.2
"""A joint counts as stuck if it moves by less than this share of the nominal deflection of its
teeth."""
SWEEPS = 40
"""Number of reweightings of a fit by least absolute errors."""
NO_PUSH = "not identifiable from this log: it is never pushed in both directions while it is held"
STUCK = (
    "not identifiable from this log: it does not move under the push, not even as far as its teeth "
    "deflect; is its sensor stuck?"
)
UNSTABLE = "not identifiable from this log: the nominal world does not withstand its pushes"
MOTOR_SIDE = (
    "not identifiable from this log: its position sensor sits on the motor side of the gear, and "
    "the play lies behind it; log the link's angle"
)


@dataclass(frozen=True, kw_only=True)
class Play:
    """The result of the push test for one joint at P positions."""

    held_rad: Array
    """Held commands [rad], shape (P,)."""
    rest_rad: Array
    """q_a: rest position of the joint before the push, relative to the motor [rad], shape (P,)."""
    ends_rad: Array
    """q_c and q_b: the ends of the play, relative to the motor [rad], shape (P, 2)."""
    give_rad_nm: float
    """Elastic compliance of the teeth [rad/Nm]."""
    residual_rad: float
    """Mean absolute residual after play and elastic deflection [rad]."""
    reference: str
    """Source of the motor's angle: 'logged' or 'replayed'."""
    locks: bool = False
    """Whether the motor holds its position under the push."""

    @property
    def half_rad(self) -> Array:
        """Half of the play at each position [rad], shape (P,)."""
        return (self.ends_rad[:, 1] - self.ends_rad[:, 0]) / 2

    @property
    def mean_rad(self) -> float:
        """Half of the play, mean over the positions [rad]; never negative."""
        return max(float(self.half_rad.mean()), 0.0)

    @property
    def has_play(self) -> bool:
        """Whether this is play, and not an effect that the test mistakes for it."""
        error_rad = self.std_rad / np.sqrt(len(self.half_rad))
        return self.mean_rad > max(SMALLEST_RAD[self.reference], 2 * error_rad)

    @property
    def std_rad(self) -> float:
        """Its standard deviation over the positions [rad]; 0 for a single position."""
        return float(self.half_rad.std(ddof=1)) if len(self.half_rad) > 1 else 0.0


def push_test(
    simulate: Simulate, nominal: Spec, pushes: Sequence[Recording]
) -> dict[str, Play | str]:
    """Per joint its play, or the reason why it is not identifiable from this log."""
    names = nominal.hand.joint_names
    if not pushes:
        return dict.fromkeys(names, NO_PUSH)
    free = [dataclasses.replace(drive, lock_nm=0.0) for drive in nominal.drives]
    locked = [dataclasses.replace(drive, lock_nm=lock_of(drive)) for drive in nominal.drives]
    shown = replay(simulate, [nominal.with_drives(d) for d in (free, locked)], pushes)
    if not all(np.isfinite(paths).all() for paths in shown):
        return dict.fromkeys(names, UNSTABLE)
    return {name: _test(nominal, pushes, shown, j) for j, name in enumerate(names)}


def _test(nominal: Spec, pushes: Sequence[Recording], shown: list[Array], j: int) -> Play | str:
    """The play of joint `j`; `shown` is a replay of two worlds: without and with a lock."""
    if nominal.hand.driven[j].joint.sensor == "motor":
        return MOTOR_SIDE
    give = 1.0 / nominal.drives[j].gear_stiffness_nm_rad
    free, locked = (
        _fit(pushes, [s[world, :, 1, j] for s in shown], j, give, "replayed") for world in (0, 1)
    )
    if free is None or locked is None:
        return NO_PUSH
    moved = max(float(np.ptp(np.quantile(m.measured[:, 0, j], (0.01, 0.99)))) for m in pushes)
    if moved < STUCK_SHARE * give * max(float(np.ptp(m.push[:, j])) for m in pushes):
        return STUCK
    locks = locked.residual_rad < free.residual_rad
    best, logged = locked if locks else free, [motion.measured[:, 1, j] for motion in pushes]
    if np.isfinite(np.concatenate(logged)).all():
        best = _fit(pushes, logged, j, give, "logged") or best
    return dataclasses.replace(best, locks=locks)


def _fit(
    pushes: Sequence[Recording], motor_rad: list[Array], j: int, nominal_give: float, reference: str
) -> Play | None:
    """Fit by least absolute errors: an end of the play per position and side, and one compliance.

    So samples at which a weight still keeps the joint off its teeth hardly count.
    """
    found, rests, samples = list[Press](), list[float](), list[tuple[Array, Array]]()
    for motion, motor in zip(pushes, motor_rad, strict=True):
        load, relative = motion.push[:, j], motion.measured[:, 0, j] - motor
        for press in presses(motion.command[:, j], load):
            hard, start = press.hard(load, PUSHED_SHARE), press.pushed.start
            found.append(press)
            rests.append(float(relative[max(start - REST_SAMPLES, 0) : start + 1].mean()))
            samples.append((load[hard], relative[hard]))
    held = places(found)
    if not held:
        return None
    ends_of = {i: 2 * k + found[i].side for k, group in enumerate(held) for i in group}
    load, beyond = (np.concatenate([samples[i][n] for i in ends_of]) for n in (0, 1))
    end = np.repeat([*ends_of.values()], [len(samples[i][0]) for i in ends_of])
    at_end = np.eye(2 * len(held))[end]
    counts = at_end.sum(axis=0)
    varied_nm = load - at_end @ (at_end.T @ load / counts)
    if np.std(varied_nm) > VARIED_SHARE * np.abs(load).max():
        fit = least_absolute(beyond, np.column_stack([at_end, load]))
        ends, give = fit[:-1], float(fit[-1])
    else:
        ends, give = least_absolute(beyond - nominal_give * load, at_end), nominal_give
    return Play(
        held_rad=np.array([found[group[0]].held_rad for group in held]),
        rest_rad=np.array([rests[group[0]] for group in held]),
        ends_rad=ends.reshape(-1, 2),
        give_rad_nm=give,
        residual_rad=float(np.mean(np.abs(beyond - give * load - at_end @ ends))),
        reference=reference,
    )


def lock_of(drive: Drive) -> float:
    """A lock that a push test cannot distinguish from a perfect one [Nm]."""
    return max(LOCK_NM, LOCK_LIMITS * drive.torque_limit_nm)


def least_absolute(miss: Array, columns: Array, times: Array | float = 1.0) -> Array:
    """The x (C,) that minimises the sum of times |miss - columns x| over T samples.

    A few outliers hardly change it. By reweighted least squares (Schlossmacher, J. Am. Stat. Assoc.
    68, 1973).
    """
    smallest = 1e-3 * np.median(np.abs(miss)) + 1e-9
    x = np.zeros(columns.shape[1])
    for _ in range(SWEEPS):
        weight = times / np.maximum(np.abs(miss - columns @ x), smallest)
        weighted = columns * weight[:, None]
        x = np.linalg.lstsq(weighted.T @ columns, weighted.T @ miss, rcond=None)[0]
    return x
