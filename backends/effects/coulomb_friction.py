"""Dry friction: a constant torque against the motor's motion."""

from backends.effect import DriveEffect


class Effect(DriveEffect):
    """Added Coulomb torque."""

    dimension, unit = "torque", "mNm"
    bounds = (0.0, 1.0)
    field = "coulomb_nm"
