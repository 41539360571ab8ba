"""The drive saturates below or above its nominal limit."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the limit.

    Law: tau_pd is clipped at limit (1 + magnitude).
    Source: Saturation of current or duty.
    Hardware: Stall torque goes with the supply: 3.1, 3.4 and 4.2 Nm at 11.1, 12 and 14.8 V
      (ROBOTIS, XH430-W350).
    Log: Large steps begin with a constant acceleration, pushes beyond the limit are lost; small
      motions show nothing.
    Confused with: command-rate-limit: that one has a constant speed instead, and does not yield to
      a push.
    """

    group = "drive"
    dimension, unit = "share", "%"
    bounds = (-0.95, 9.0)
    levels = (-0.15, -0.3, -0.5)
    number = "drive.torque_limit_nm"
    relative = True
    nominal = True
    coordinate = "logarithm"
    least = 0.12
    most = 2.5
    either_sign = True
    kinked = True
