"""A plant with a filtered speed, a cogging motor and an eccentric encoder.

    i  = clip(kp band(target - e) - kd f),   f' = (e' - f) / D,   once a millisecond
    e  = motor + E sin(motor + 1), in steps of 2 pi / 65536
    J w' = i + R sin(n motor) - ...

A disc off its axis by r reads an angle that is wrong once per turn, by r over its own radius.
Everything else is `_two_mass`, with Dahl's friction.

Cogging: T. M. Jahns and W. L. Soong, IEEE Transactions on Industrial Electronics 43, 1996.
"""

from dataclasses import dataclass

import numba
import numpy as np

from backends.state import Array
from diagnosis.blind.mechanics import _geared, _two_mass
from diagnosis.blind.mechanics._geared import PERIOD_S, Geared, one_bristle

STEP_RAD = 2 * np.pi / 65536


@dataclass(frozen=True, kw_only=True)
class Baseline(_geared.Baseline):
    """The small faults of every robot of this plant."""

    filter_s: float = 1.5e-3
    """D."""
    ripple_share: float = 1.2e-3
    """R over the torque limit."""
    ripple_per_rad: float = 25.0
    """n."""
    once_rad: float = 3e-4
    """E."""

    ranges = {
        "filter_s": (5e-4, 2.5e-3),
        "ripple_share": (3e-4, 1.5e-3),
        "ripple_per_rad": (11, 40),
        "once_rad": (1e-4, 6e-4),
    }


@numba.njit(_two_mass.SERVO, cache=True)
def servo(target, motor, speed, first, drive, own, state):
    """PD on an encoder that is wrong once per turn, and on its filtered difference."""
    read = _two_mass.quantised(motor + own[2] * np.sin(motor + 1.0), STEP_RAD)
    felt = _two_mass.read_speed(read, PERIOD_S, own[1], first, state)
    asked = drive[0] * _two_mass.banded(target - read, drive[12]) - drive[1] * felt
    return min(max(asked, -drive[2]), drive[2])


class Mechanics(Geared):
    """Limbs of one or two parallel hinges."""

    baseline, laws = Baseline, (servo, one_bristle)

    def chassis(self, base: Baseline, limit_nm: Array) -> _two_mass.Chassis:
        """See `Geared`."""
        return _two_mass.Chassis(
            period_s=PERIOD_S,
            ripple_nm=base.ripple_share * limit_nm,
            ripple_per_rad=base.ripple_per_rad,
        )

    def own(self, base: Baseline, limit_nm: Array) -> list:
        """See `Geared`."""
        return [base.bend_rad, base.filter_s / (PERIOD_S + base.filter_s), base.once_rad]
