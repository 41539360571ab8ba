"""Teeth that damp more or less than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the damping."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 4.0)
    number = "drive.gear_damping_nms_rad"
    relative = True
