"""A plant with a hobby servo's electronics: slow loop, coarse numbers, battery voltage.

    i  = round(clip(kp band(target - e) - kd e')),   every 2 or 2.5 ms, in steps of limit / 128
    |i| <= 1.25 limit (1 - |w| / W), at least a tenth of the limit      back-EMF
    e  = the motor's angle in steps of 2 pi / 4096 or 2 pi / 16384

W is the speed at which the battery's voltage is used up. Everything else is `_two_mass`, with
Dahl's friction.

Servos of this kind: G. Duclusaud et al., Extended friction models for the physics simulation of
servo actuators, arXiv 2410.08650, 2024, and the data sheets of the servos measured there.
"""

from dataclasses import dataclass

import numba
import numpy as np

from backends.state import Array
from diagnosis.blind.mechanics import _geared, _two_mass
from diagnosis.blind.mechanics._geared import Geared, one_bristle

STEPS = 128.0
"""Steps of the torque up to the limit."""
ROOM = 1.25
"""Torque at rest that the battery would give, over the limit."""
LEAST = 0.1
"""Torque that is left at any speed, over the limit."""


@dataclass(frozen=True, kw_only=True)
class Baseline(_geared.Baseline):
    """The small faults of every robot of this plant."""

    slow: float = 0.0
    """Period of 2.5 ms from 0.5 on, else 2 ms."""
    fine: float = 0.0
    """Encoder of 14 bits from 0.5 on, else 12."""
    empty_rad_s: float = 35.0
    """W."""

    ranges = {
        "slow": (0.0, 1.0),
        "fine": (0.0, 1.0),
        "empty_rad_s": (25.0, 60.0),
    }


@numba.njit(_two_mass.SERVO, cache=True)
def servo(target, motor, speed, first, drive, own, state):
    """PD on a coarse encoder; what it asks for is coarse and needs voltage."""
    read = _two_mass.quantised(motor, own[2])
    felt = _two_mass.read_speed(read, own[1], 0.0, first, state)
    asked = drive[0] * _two_mass.banded(target - read, drive[12]) - drive[1] * felt
    most = min(drive[2], drive[2] * max(ROOM * (1 - abs(speed) / own[3]), LEAST))
    return _two_mass.quantised(min(max(asked, -most), most), own[4])


class Mechanics(Geared):
    """Limbs of one or two parallel hinges."""

    baseline, laws = Baseline, (servo, one_bristle)

    def chassis(self, base: Baseline, limit_nm: Array) -> _two_mass.Chassis:
        """See `Geared`."""
        return _two_mass.Chassis(period_s=self._period_s(base))

    def own(self, base: Baseline, limit_nm: Array) -> list:
        """See `Geared`."""
        step_rad = 2 * np.pi / (16384 if base.fine >= 0.5 else 4096)
        period_s = self._period_s(base)
        return [base.bend_rad, period_s, step_rad, base.empty_rad_s, limit_nm / STEPS]

    def _period_s(self, base: Baseline) -> float:
        return 2.5e-3 if base.slow >= 0.5 else 2e-3
