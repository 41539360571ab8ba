"""Dry friction: a constant torque against the motor's motion."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added Coulomb torque.

    Law: A torque of this size against the rotor's motion; at rest it holds what is smaller.
    Source: Armstrong-Helouvry, Dupont and Canudas de Wit, *A survey of models, analysis tools and
      compensation methods for the control of machines with friction*, Automatica 30 (1994).
    Hardware: 18 mNm (XL330), 52 (STS3215 at 7.4 V), 90 (MX-64), 104 (MX-106): BAM, m1.
    Log: A joint stops short of its target by up to coulomb / kp, on the side it came from.
    Confused with: backlash, dead-zone and load-friction. Steps of several sizes and a push tell
      them apart.
    """

    group = "gears and joints"
    dimension, unit = "torque", "mNm"
    bounds = (0.0, 1.0)
    levels = (0.01, 0.04, 0.12)
    number = "drive.coulomb_nm"
    nominal = True
    tolerance = 0.003
    least = 0.008
    most = 3.0
    family = "dry friction"
    unsaid = True
    near = ("stiction", "load-friction", "self-lock")
