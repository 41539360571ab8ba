"""Viscous friction: a torque in proportion to the motor's speed."""

from backends.effect import DriveEffect


class Effect(DriveEffect):
    """Added viscous coefficient."""

    dimension, unit = "damping", "mNms"
    bounds = (0.0, 1.0)
    field = "viscous_nms_rad"
