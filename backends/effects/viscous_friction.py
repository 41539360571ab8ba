"""Viscous friction: a torque in proportion to the motor's speed."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added viscous coefficient."""

    dimension, unit = "damping", "mNms"
    bounds = (0.0, 1.0)
    number = "drive.viscous_nms_rad"
