"""Stiction: friction at standstill that falls with speed (Stribeck)."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Breakaway torque in addition to the Coulomb friction.

    Law: friction += stiction exp(-|m'| / v_s), v_s = 0.05 rad/s: it breaks away at coulomb +
      stiction and fades with speed.
    Source: Stribeck's curve, Armstrong-Helouvry, Dupont and Canudas de Wit (Automatica 30, 1994),
      with exponent 1.
    Hardware: 1 mNm (XL330), 26 (STS3215), 30 (XL320), 82 (MX-64): BAM, m2, which fits v_s from 0.14
      to 2.3 rad/s and exponents from 1.2 to 10: the fading here is quicker.
    Log: Nothing moves, then it jumps: stick-slip in slow motion, and a longer wait at a reversal.
    Confused with: coulomb-friction in fast motion. Slow ramps and small steps show it.
    """

    group = "gears and joints"
    dimension, unit = "torque", "mNm"
    bounds = (0.0, 1.0)
    levels = (0.01, 0.04, 0.12)
    number = "drive.stiction_nm"
    least = 0.008
    most = 3.0
    kinked = True
    family = "dry friction"
    near = ("coulomb-friction", "load-friction")
