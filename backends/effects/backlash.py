"""Gear play: the joint is free within plus and minus the magnitude about its motor."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Half play; worm-geared joints unless one is named."""

    dimension, unit = "angle", "deg"
    bounds = (0.0, math.radians(10))
    number = "drive.play_rad"
    gear = "worm"
