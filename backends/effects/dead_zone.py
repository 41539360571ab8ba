"""The drive does not react to small errors between target and motor."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Error below which the PD law gives no torque; it is subtracted from larger errors.

    Law: The PD law takes the error e as sign(e) max(|e| - zone, 0).
    Source: Slotine and Li, *Applied Nonlinear Control*, 1991, ch. 5.
    Hardware: Servos have it as a setting (the "compliance margin" of Dynamixel AX). No published
      range found.
    Log: A constant error of up to the zone, on the side it came from; targets smaller than it move
      nothing.
    Confused with: coulomb-friction (an error of coulomb / kp that shrinks with kp) and backlash
      (which lets the joint move freely, this only the target).
    """

    group = "drive"
    dimension, unit = "angle", "deg"
    bounds = (0.0, math.radians(10))
    levels = (0.002, 0.006, 0.02)
    number = "drive.dead_zone_rad"
    least = 0.001
    most = 0.2
    kinked = True
    exact = True
