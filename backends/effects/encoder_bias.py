"""The zero of a position sensor is off."""

import math

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Constant that is added to every reading.

    Law: Added to every reading.
    Source: Zero-point error of assembly and homing.
    Hardware: Domain randomisation takes +-0.02 rad, 1.1 deg (Menlo's Asimov, docs.menlo.ai); zero
      offsets of 1 to 4 deg between servo and rig were fitted (BAM, `q_offset`: 0.02 to 0.07 rad).
    Log: A constant difference between target and reading that no load explains.
    Confused with: gravity-tilt and load / kp at one posture. Several postures or a push tell.
    """

    group = "sensing"
    dimension, unit = "angle", "deg"
    bounds = (-math.pi, math.pi)
    levels, opposite = (0.002, 0.007, 0.025), (-0.002, -0.007, -0.025)
    number = "encoder.bias_rad"
    least = 0.001
    most = 0.5
    either_sign = True
    exact = True
