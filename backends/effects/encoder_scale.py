"""A position sensor whose readings grow too fast or too slowly."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative error of the readings."""

    dimension, unit = "share", "%"
    bounds = (-0.5, 0.5)
    number = "encoder.scale_error"
