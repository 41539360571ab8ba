"""The readings of taxels stay behind where a press eases."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Share by which a reading may be larger than the depth while a press eases.

    Law: reading' = min(max(reading before, depth), (1 + magnitude) depth), from one reading to the
      next; an episode begins without it.
    Source: The play operator (A. Visintin, *Differential Models of Hysteresis*, 1994), relative to
      the depth.
    Hardware: Jamali et al., *A new design of a fingertip for the iCub hand*, IROS 2015, report
      hysteresis of a capacitive fingertip under large forces. No published range in depth found.
    Log: The same press reads more on its way back than on its way in.
    Confused with: taxel-gain, whose factors do not depend on the way; contact-softness.
    """

    group = "touch"
    dimension, unit = "share", "%"
    bounds = (0.0, 1.0)
    levels = (0.05, 0.15, 0.5)
    number = "taxels.hysteresis"
    per_joint = False
