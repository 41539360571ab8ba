"""A position sensor errs once per turn: its magnet or disc sits beside the axis."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Amplitude of the error that is largest at the joint's zero.

    Law: magnitude cos(angle) is added to the reading, with the angle at the joint. An error of any
      phase is this and encoder-eccentricity-sine together.
    Source: A disc whose centre lies e beside the axis, read at radius R, errs by (e / R) sin(angle
      - phase); Heidenhain, *Position encoders for servo drives*, gives 412 arc seconds per
      micrometre over the diameter in millimetres.
    Hardware: By that formula 0.1 mm, the mounting eccentricity that Synapticon's SOMANET manual
      allows, is 0.5 deg on a disc of 25 mm. Non-linearity of off-axis magnets is up to 1 deg over a
      turn (ams AS5046 data sheet).
    Log: An offset that bends with the angle. A tenth of a turn shows little more than an offset.
    Confused with: encoder-bias and encoder-scale in a narrow range; link-mass and gravity-tilt,
      which the torque or a push tells apart.
    """

    group = "sensing"
    dimension, unit = "angle", "deg"
    bounds = (-math.radians(5), math.radians(5))
    levels, opposite = (0.004, 0.012, 0.04), (-0.004, -0.012, -0.04)
    hinges_only = True
    number = "encoder.eccentricity_rad"
    spot = ("encoder.eccentricity_sine_rad",)
    least = 0.002
    most = 0.08
    either_sign = True
    narrow_as = "encoder-bias"
    exact = True
    near = ("encoder-eccentricity-sine", "encoder-bias", "encoder-scale")
