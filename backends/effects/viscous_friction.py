"""Viscous friction: a torque proportional to the motor's speed."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added viscous coefficient; at 1 kHz the rotor becomes unstable from 0.18 Nms on.

    Law: A torque -viscous m'.
    Source: Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994).
    Hardware: 6 mNms (XL330), 12 (MX-64), 35 (MX-106), 60 (STS3215): BAM, m1.
    Log: A lag in proportion to the speed; nothing at rest.
    Confused with: kd-scale: the same, unless the torque is logged. At constant speed also
      command-delay.
    """

    group = "gears and joints"
    dimension, unit = "damping", "mNms"
    bounds = (0.0, 0.15)
    levels = (0.1, 0.3, 0.8)
    number = "drive.viscous_nms_rad"
    nominal = True
    tolerance = 0.02
    least = 0.08
    most = 5.0
    near = ("kd-scale",)
    same_as, apart_by = "kd-scale", "torque"
