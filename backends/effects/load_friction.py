"""Gear friction that grows with the torque that the gear transmits."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Friction torque per transmitted torque."""

    dimension, unit = "share", "%"
    bounds = (0.0, 0.95)
    number = "drive.load_friction"
