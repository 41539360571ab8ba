"""Targets reach the drive in coarse steps."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Size of one step.

    Law: The target is the nearest multiple of the step, before it may be lost or late.
    Source: Widrow and Kollar, *Quantization Noise*, 2008: uniform error of variance step^2 / 12.
    Hardware: 0.088 deg: 4096 goal positions a turn (Dynamixel X, Feetech STS3215); 0.29 deg in
      older ones (1024 over 300 deg); 0.09 deg of a servo pulse in microseconds (2000 of them over
      180 deg, Lynxmotion SSC-32).
    Log: Slow targets move the joint in stairs, and rests are off by up to half a step.
    Confused with: dead-zone and stiction, which depend on the direction; encoder-resolution, whose
      stairs are in the readings alone.
    """

    group = "drive"
    dimension, unit = "angle", "deg"
    bounds = (0.0, math.radians(10))
    levels = (0.002, 0.006, 0.02)
    number = "command.resolution_rad"
    near = ("dead-zone", "stiction")
