"""A position sensor whose zero is off."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added to every reading."""

    dimension, unit = "angle", "deg"
    bounds = (-math.pi, math.pi)
    number = "encoder.bias_rad"
