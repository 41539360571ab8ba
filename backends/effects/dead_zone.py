"""A drive that does not answer to small errors between target and motor."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Error below which the PD law gives nothing; larger ones count that much less."""

    dimension, unit = "angle", "deg"
    bounds = (0.0, math.radians(10))
    number = "drive.dead_zone_rad"
