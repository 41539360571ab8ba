"""A surface with more or less grip."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the friction coefficient."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 2.0)
    number = "stick.friction"
    relative = True
    per_joint = False
    spread = "uniform"
