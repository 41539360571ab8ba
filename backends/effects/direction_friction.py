"""Dry friction in one direction alone: it is larger upwards or downwards."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Coulomb torque against upward motion where positive, against downward motion where negative.

    Law: friction += |magnitude| where the motor turns, or would turn, in that direction.
    Source: Janot, Gautier and Brunot, *Data set and reference models of EMPS*, 2019 Workshop on
      Nonlinear System Identification Benchmarks: Fc sign(v) and an offset, in part of asymmetric
      friction.
    Hardware: An offset of -3.2 N beside 20.4 N of Coulomb friction (EMPS, the same paper). The
      joints of ergoCub are compensated by one Coulomb torque up and another down.
    Log: A joint stops short of its target from one side, less or not from the other.
    Confused with: coulomb-friction of half the size beside a constant torque, which is the same;
      beside a small encoder-bias, which a logged torque tells apart.
    """

    group = "gears and joints"
    dimension, unit = "torque", "mNm"
    bounds = (-1.0, 1.0)
    levels, opposite = (0.01, 0.04, 0.12), (-0.01, -0.04, -0.12)
    number = "drive.one_way_friction_nm"
    least = 0.008
    most = 3.0
    either_sign = True
    family = "dry friction"
    near = ("coulomb-friction", "stiction", "load-friction")
