"""Dry friction: a constant torque against the motor's motion."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added Coulomb torque."""

    dimension, unit = "torque", "mNm"
    bounds = (0.0, 1.0)
    number = "drive.coulomb_nm"
