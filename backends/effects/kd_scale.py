"""The derivative gain differs from the nominal one."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the gain; at 1 kHz the drive chatters from +120 % on.

    Law: kd' = kd (1 + magnitude).
    Source: The paper randomises gains (Hu et al., arXiv 2304.05141).
    Hardware: No published range found.
    Log: Overshoot after steps, lag at constant speed; nothing at rest.
    Confused with: viscous-friction: the same, unless the torque is logged.
    """

    group = "drive"
    dimension, unit = "share", "%"
    bounds = (-0.9, 1.0)
    levels, opposite = (0.1, 0.25, 0.6), (-0.1, -0.25, -0.5)
    number = "drive.kd_nms_rad"
    relative = True
    nominal = True
    coordinate = "logarithm"
    least = 0.12
    most = 3.0
    either_sign = True
    shared = True
    near = ("viscous-friction",)
