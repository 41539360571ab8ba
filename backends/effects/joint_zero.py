"""A joint's zero is off: a horn one tooth on, a bad homing, another calibration."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """How much more than the angle of the joint its drive and its sensor both read.

    Law: Readings grow by it, and the drive takes it off its targets: it holds the joint where the
      reading is the target. Ends of the range stay where they are.
    Source: Zero-point error of assembly and homing, of a sensor that closes the loop.
    Hardware: One tooth of a servo's horn is 14.4 deg (25 teeth); zero offsets of 1 to 4 deg between
      servo and rig were fitted (BAM, `q_offset`: 0.02 to 0.07 rad).
    Log: Readings follow their targets as ever; load, sag and torque under weight are those of
      another pose, at this joint and at the links that it carries.
    Confused with: encoder-bias, which the drive does not read, so that readings stand beside their
      targets; gravity-tilt, which is the same at a first joint; payload, beside other masses.
    """

    group = "drive"
    dimension, unit = "angle", "deg"
    bounds = (-math.pi, math.pi)
    levels, opposite = (0.05, 0.1, 0.25), (-0.05, -0.1, -0.25)
    number = "drive.zero_rad"
    by_weight = True
    narrow_as = "gravity-tilt"
    least = 0.01
    most = 1.0
    either_sign = True
    near = ("gravity-tilt", "payload")
