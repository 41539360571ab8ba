"""A fingertip that barely touches reads no touch."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Normal force that a fingertip's contact has to exceed to be read as touch.

    Law: All taxels of a tip read nothing while its normal force is at most the magnitude.
    Source: The threshold of a force sensor; force-sensing resistors have it by design.
    Hardware: 0.1 N (Interlink, FSR 400 series).
    Log: Touch ends before the fingertip leaves, and starts late; weak grips read none.
      No diagnosis looks for it.
    Confused with: taxel-threshold, which takes single taxels at the edge of a patch.
    """

    group = "touch"
    dimension, unit = "force", "N"
    bounds = (0.0, 2.0)
    levels = (0.05, 0.1, 0.3)
    number = "contact.touch_n"
    per_joint, drawn = False, False
