"""A position sensor with coarse steps."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Size of a step."""

    dimension, unit = "angle", "deg"
    bounds = (0.0, math.radians(10))
    number = "encoder.resolution_rad"
