"""A position sensor reads in coarse steps."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Size of one step.

    Law: Readings are the nearest multiples of the step, after bias and noise.
    Source: Widrow and Kollar, *Quantization Noise*, 2008: uniform error of variance step^2 / 12.
    Hardware: 0.088 deg: 4096 steps in Dynamixel X and Feetech STS3215; 0.29 deg in older ones (1024
      over 300 deg); 0.022 deg in 14-bit sensors (ams AS5048).
    Log: Readings are multiples of a step. Noise of more than half a step hides it.
    Confused with: encoder-noise, from the spectrum alone; the equal steps tell.
    """

    group = "sensing"
    dimension, unit = "angle", "deg"
    bounds = (0.0, math.radians(10))
    levels = (0.002, 0.006, 0.02)
    number = "encoder.resolution_rad"
