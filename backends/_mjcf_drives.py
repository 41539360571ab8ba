"""Drives for a user's mechanism: gains from its log, and gears that its MJCF does not have.

A gear gets no play and is as stiff as the drive period dt allows: k = (STIFFNESS / dt)^2 J, where J
is the inertia that the spring between motor and link sees. Semi-implicit Euler steps of a spring
and a damper, x'' = -(k x + c x') / J, are stable while k dt^2 / J + 2 c dt / J < 4 (the Jury
criterion). The gear and the PD law each get a share of that limit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from backends._mjcf_text import MjcfError
from backends.spec import Drive
from backends.state import Array

PERIODS_S = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
"""Drive periods to choose from. The longest one at which all drives are stable and all gears rigid
is used; where a gear is stiff but never rigid, the shortest one."""
STIFF = 10.0
"""A gear counts as stiff from this multiple of the drive's proportional gain."""
RIGID_RAD = 2.5e-3
"""A stiff gear counts as rigid when the largest torque twists it by no more than this [rad, m]. It
is ten times the smallest position error that a diagnosis counts."""
STIFFNESS, DAMPING = 0.8, 0.6
"""Natural frequency of a gear times the period, and its damping ratio; the teeth hardly bounce."""
PD_SHARE = 1.2
"""Share of the limit of 4 that a PD law may use: the largest (kp dt^2 + 2 kd dt) over motor
inertia.

The gear takes STIFFNESS^2 + 4 DAMPING STIFFNESS = 2.6.
"""


class Servo(Protocol):
    """Settings of one joint's PD drive, on the motor side [Nm, rad, s]; for a slide [N, m, s]."""

    @property
    def kp(self) -> float | None:
        """Proportional gain; without it a drive is refused."""
        ...

    @property
    def kd(self) -> float | None:
        """Derivative gain; none is 0."""
        ...

    @property
    def limit(self) -> float | None:
        """Largest torque."""
        ...

    @property
    def sensor(self) -> str:
        """Side of the gear with the position sensor: 'joint' or 'motor'."""
        ...

    @property
    def armature(self) -> float | None:
        """Inertia on the motor's side, instead of the file's."""
        ...

    @property
    def speed(self) -> float:
        """Largest speed of its target; 0: any."""
        ...

    @property
    def loop(self) -> Mapping[str, float]:
        """What its loop does beside the PD law, by the numbers of `spec.Loop`."""
        ...


@dataclass(frozen=True, kw_only=True)
class Inertias:
    """The inertias that the drives of J joints move, and the friction of their motors."""

    motor_kgm2: Array
    """Inertias on the motors' side of the gears [kg m^2], shape (J,)."""
    link_kgm2: Array
    """Mass matrices of the links alone in P poses [kg m^2], shape (P, J, J)."""
    coulomb_nm: Array
    """Coulomb friction [Nm], shape (J,)."""
    viscous_nms_rad: Array
    """Viscous friction [Nms/rad], shape (J,)."""

    @property
    def gears_kgm2(self) -> Array:
        """Inertias (J,) [kg m^2] that the springs of the gears see.

        Let A be the motor inertias, M the mass matrix of the links and R = min 1 / diag(A^-1 +
        M^-1). The eigenvalues of R^1/2 (A^-1 + M^-1) R^1/2 say how much faster the coupled gears
        swing than single ones. The result is R over the largest of them.
        """
        yielding = np.linalg.inv(self.link_kgm2) + np.diag(1.0 / self.motor_kgm2)
        alone = 1.0 / np.einsum("pjj->pj", yielding).max(axis=0)
        together = np.sqrt(alone[:, None] * alone) * yielding
        return alone / np.linalg.eigvalsh(together).max()


def drives(
    names: Sequence[str], servos: Sequence[Servo], inertias: Inertias, geared: bool
) -> tuple[tuple[Drive, ...], float]:
    """The drives of J joints and their period [s].

    Raises MjcfError where a drive has no limit, and if `geared` where no period suits the gears,
    which matters to who simulates them.
    """
    period_s, problems = _period_s(names, servos, inertias)
    if geared and problems:
        raise MjcfError("; ".join(problems))
    gears = inertias.gears_kgm2
    return tuple(
        Drive(
            kp_nm_rad=_gain(name, servo),
            kd_nms_rad=servo.kd or 0.0,
            torque_limit_nm=_limit(name, servo),
            rotor_inertia_kgm2=float(inertias.motor_kgm2[j]),
            coulomb_nm=float(inertias.coulomb_nm[j]),
            viscous_nms_rad=float(inertias.viscous_nms_rad[j]),
            gear_stiffness_nm_rad=float(gears[j] * (STIFFNESS / period_s) ** 2),
            gear_damping_nms_rad=float(2 * DAMPING * STIFFNESS * gears[j] / period_s),
            play_rad=0.0,
            lock_nm=0.0,
        )
        for j, (name, servo) in enumerate(zip(names, servos, strict=True))
    ), period_s


def _period_s(
    names: Sequence[str], servos: Sequence[Servo], inertias: Inertias
) -> tuple[float, list[str]]:
    """The longest drive period [s] that is stable for all joints; else the shortest, and why."""
    pairs = list(zip(names, servos, strict=True))
    kp, kd = np.array([_gain(*pair) for pair in pairs]), np.array([s.kd or 0.0 for s in servos])
    limit = np.array([_limit(*pair) for pair in pairs])
    damped, motor = kd + inertias.viscous_nms_rad, inertias.motor_kgm2
    for period_s in PERIODS_S:
        gears = inertias.gears_kgm2 * (STIFFNESS / period_s) ** 2
        stiff, rigid = gears >= STIFF * kp, limit <= RIGID_RAD * gears
        pd = (kp * period_s**2 + 2 * damped * period_s) / motor
        held = stiff.all() and (pd <= PD_SHARE).all()
        if held and (rigid.all() or period_s == PERIODS_S[-1]):
            return period_s, []
    most = np.minimum(gears / STIFF, PD_SHARE * motor / period_s**2)
    most_kd = PD_SHARE * motor / (2 * period_s) - inertias.viscous_nms_rad
    found = []
    for j, name in enumerate(names):
        if kp[j] > most[j]:
            found.append(f"kp of '{name}' is {kp[j]:g}; allowed here: up to {most[j]:.3g}")
        elif pd[j] > PD_SHARE:
            found.append(
                f"kd of '{name}' is {kd[j]:g} on an armature of {motor[j]:.3g}; allowed here: up "
                f"to {most_kd[j]:.3g}, or an armature from {motor[j] * pd[j] / PD_SHARE:.3g}"
            )
    return PERIODS_S[-1], found


def _limit(name: str, servo: Servo) -> float:
    if servo.limit is None:
        raise MjcfError(f"the drive of '{name}' has no limit; give its largest torque or force")
    return servo.limit


def _gain(name: str, servo: Servo) -> float:
    if servo.kp is None:
        raise MjcfError(f"the drive of '{name}' has no kp; give its proportional gain")
    return servo.kp
