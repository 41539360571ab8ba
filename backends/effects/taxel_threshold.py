"""Taxels need a deeper or a lighter press than nominal to count as active."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Pressed depth that is added to the threshold.

    Law: A taxel has to be pressed deeper by this to count.
    Source: Gains and offsets of taxels; the paper binarises with one empirical threshold.
    Hardware: Capacitive fingertips answer from 0.05 N on (Jamali et al., *A new design of a
      fingertip for the iCub hand*, IROS 2015). No published range in depth found.
    Log: Fewer active taxels (more, where negative); light contacts are missed; the centre barely
      moves.
    Confused with: contact-softness (which changes the depth), taxel-dropout.
    """

    group = "touch"
    dimension, unit = "length", "mm"
    bounds = (-0.19e-3, 1e-3)
    levels, opposite = (5e-5, 1.5e-4, 4e-4), (-4e-5, -8e-5, -1.5e-4)
    number = "taxels.threshold_m"
    per_joint = False
