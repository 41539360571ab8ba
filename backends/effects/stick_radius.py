"""A stick thicker or thinner than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the radius."""

    dimension, unit = "share", "%"
    bounds = (-0.5, 1.0)
    number = "stick.radius_m"
    relative = True
    per_joint = False
    spread = "uniform"
