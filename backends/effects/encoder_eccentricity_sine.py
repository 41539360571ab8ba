"""The error of a position sensor once per turn, a quarter turn on."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Amplitude of the error that is none at the joint's zero, and rises there.

    Law: magnitude sin(angle) is added to the reading, with the angle at the joint. An error of any
      phase is this and encoder-eccentricity together.
    Source: See encoder-eccentricity.
    Hardware: See encoder-eccentricity.
    Log: A difference in proportion to small angles, and less than that to large ones.
    Confused with: encoder-scale in a narrow range: they differ by a sixth of the angle's cube.
    """

    group = "sensing"
    dimension, unit = "angle", "deg"
    bounds = (-math.radians(5), math.radians(5))
    levels, opposite = (0.01, 0.03, 0.08), (-0.01, -0.03, -0.08)
    hinges_only = True
    number = "encoder.eccentricity_sine_rad"
    least = 0.004
    most = 0.08
    either_sign = True
    narrow_as = "encoder-scale"
    exact = True
    near = ("encoder-eccentricity", "encoder-scale")
