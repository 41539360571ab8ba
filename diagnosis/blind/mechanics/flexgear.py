"""A plant with a strain wave gear: soft, stiffer under load, friction inside and behind it.

    gear = (k x + c x') (1 + (k x / T)^2) + H z,   z' = (x' - |x'| z) / 0.3 mrad
    M(q) q'' + h = gear + push - F,                F between the links, behind the spring

x is the twist. The servo closes on the motor, so the link sags and rings where the file says rigid.
Everything else is `_two_mass`, with Dahl's friction.

Cubic stiffness and hysteresis of strain wave gears: T. D. Tuttle and W. P. Seering, IEEE
Transactions on Robotics and Automation 12, 1996; H. D. Taghirad and P. R. Belanger, Journal of
Dynamic Systems, Measurement and Control 120, 1998.
"""

from dataclasses import dataclass

from backends.state import Array
from diagnosis.blind.mechanics import _geared, _two_mass
from diagnosis.blind.mechanics._geared import PERIOD_S, Geared, one_bristle, pd


@dataclass(frozen=True, kw_only=True)
class Baseline(_geared.Baseline):
    """The small faults of every robot of this plant."""

    stiffness_kp: float = 65.0
    """k over kp."""
    stiffens_share: float = 0.6
    """T over the torque limit."""
    hysteresis_share: float = 5e-3
    """H over the torque limit."""
    bend_rad: float = 8e-4

    ranges = {
        "stiffness_kp": (40.0, 90.0),
        "hysteresis_share": (2e-3, 8e-3),
        "bend_rad": (5e-4, 1e-3),
    }


class Mechanics(Geared):
    """Limbs of one or two parallel hinges."""

    baseline, laws = Baseline, (pd, one_bristle)

    def chassis(self, base: Baseline, limit_nm: Array) -> _two_mass.Chassis:
        """See `Geared`."""
        return _two_mass.Chassis(
            period_s=PERIOD_S,
            stiffens_nm=base.stiffens_share * limit_nm,
            hysteresis_nm=base.hysteresis_share * limit_nm,
            behind=True,
        )

    def own(self, base: Baseline, limit_nm: Array) -> list:
        """See `Geared`."""
        return [base.bend_rad]
