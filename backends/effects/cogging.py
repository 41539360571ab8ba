"""Cogging: a torque on the motor that is a sine of its angle, as of magnets, detents or teeth."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Amplitude of the torque; its period is 20 deg at the joint.

    Law: tau_cog = magnitude sin(2 pi m / period + phase). A world's `drive.cogging_period_rad` and
      `cogging_phase_rad` set another period and a phase. A diagnosis sees both in a log, periods
      from 3 to 57 deg.
    Source: Piccoli and Yim, *Anticogging: torque ripple suppression, modeling, and parameter
      selection*, Int. J. Robotics Research 35 (2016). A period is 2 pi over the least common
      multiple of slots and poles, and over the gear ratio.
    Hardware: No published range found at the joint of a hand.
    Log: Ripples in slow motion that come again at the same angles; steps end at preferred angles.
    Confused with: coulomb-friction and stiction, which come again at no angle; encoder-scale and an
      eccentric encoder, of which the torque shows nothing.
    """

    group = "gears and joints"
    dimension, unit = "torque", "mNm"
    bounds = (0.0, 1.0)
    levels = (0.01, 0.03, 0.08)
    number = "drive.cogging_nm"
    hinges_only = True
    least = 0.01
    most = 1.0
    near = ("coulomb-friction", "stiction")
