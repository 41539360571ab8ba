"""A plant with cascaded servo loops: current, speed with a leaky integral, position.

    u = kp band(target - motor) - kd f,   once a millisecond
    i* = clip(u + I),   I' = (leak u - I) / 0.6 s             the integral of the speed loop
    f' = (w - f) / D,   i' = (i* - i) / T                     speed filter and current loop

A speed loop with gain kd takes kp / kd of the position error as its target; its integral is that of
the speed error u / kd. So what the drive gives at rest is a few percent more than kp says.
Everything else is `_two_mass`, with Dahl's friction.

Cascaded servos: W. Leonhard, Control of Electrical Drives, 3rd edition, Springer 2001.
"""

from dataclasses import dataclass

import numba

from backends.state import Array
from diagnosis.blind.mechanics import _geared, _two_mass
from diagnosis.blind.mechanics._geared import PERIOD_S, Geared, one_bristle

LEAK_S = 0.6
"""Time constant of the integral."""


@dataclass(frozen=True, kw_only=True)
class Baseline(_geared.Baseline):
    """The small faults of every robot of this plant."""

    leak: float = 0.025
    """Gain of the integral at rest."""
    current_s: float = 8e-4
    """T."""
    filter_s: float = 1e-3
    """D."""

    ranges = {
        "leak": (0.01, 0.04),
        "current_s": (4e-4, 1.2e-3),
        "filter_s": (5e-4, 1.5e-3),
    }


@numba.njit(_two_mass.SERVO, cache=True)
def servo(target, motor, speed, first, drive, own, state):
    """PD and what the integral holds, in state[2]."""
    felt = _two_mass.read_speed(motor, PERIOD_S, own[2], first, state)
    asked = drive[0] * _two_mass.banded(target - motor, drive[12]) - drive[1] * felt
    state[2] += PERIOD_S / LEAK_S * (own[1] * asked - state[2])
    return min(max(asked + state[2], -drive[2]), drive[2])


class Mechanics(Geared):
    """Limbs of one or two parallel hinges."""

    baseline, laws = Baseline, (servo, one_bristle)

    def chassis(self, base: Baseline, limit_nm: Array) -> _two_mass.Chassis:
        """See `Geared`."""
        return _two_mass.Chassis(period_s=PERIOD_S, current_s=base.current_s)

    def own(self, base: Baseline, limit_nm: Array) -> list:
        """See `Geared`."""
        return [base.bend_rad, base.leak, base.filter_s / (PERIOD_S + base.filter_s)]
