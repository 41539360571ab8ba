"""Viscous friction: a torque in proportion to the motor's speed."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added viscous coefficient; at 1 kHz the rotor is unstable from 0.18 Nms on."""

    dimension, unit = "damping", "mNms"
    bounds = (0.0, 0.15)
    number = "drive.viscous_nms_rad"
