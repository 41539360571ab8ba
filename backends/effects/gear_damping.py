"""Teeth that damp more or less than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the damping; at 1 kHz the gear is unstable from +120 % on."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 1.0)
    number = "drive.gear_damping_nms_rad"
    relative = True
