"""Stiction: friction at standstill that fades with speed (Stribeck)."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Torque to break away, above the Coulomb friction."""

    dimension, unit = "torque", "mNm"
    bounds = (0.0, 1.0)
    number = "drive.stiction_nm"
