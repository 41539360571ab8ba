"""The gear teeth damp more or less than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the damping; at 1 kHz the gear becomes unstable from +120 % on.

    Law: c in tau_gear.
    Source: The damping of the flexible shaft in Nordin, Galic and Gutman, Int. J. Adaptive Control
      and Signal Processing 11 (1997).
    Hardware: No published range found.
    Log: How fast the joint stops ringing against the motor after steps and impacts.
    Confused with: kd-scale and viscous-friction, unless both sides are measured.
    """

    group = "gears and joints"
    dimension, unit = "share", "%"
    bounds = (-0.9, 1.0)
    levels, opposite = (0.2, 0.4, 0.8), (-0.2, -0.4, -0.7)
    number = "drive.gear_damping_nms_rad"
    relative = True
    nominal = True
    coordinate = "logarithm"
    tolerance = 0.1
    least = 0.2
    most = 2.5
    either_sign = True
