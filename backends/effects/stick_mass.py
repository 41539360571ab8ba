"""A stick heavier or lighter than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the mass."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 4.0)
    number = "stick.mass_kg"
    relative = True
    per_joint = False
    spread = "uniform"
