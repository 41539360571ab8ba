"""Taxels read the same press as more or as less than each other."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Largest difference of a taxel's gain from 1.

    Law: Every taxel's depth is read with its own gain, spread evenly between 1 - magnitude and
      1 + magnitude. Which taxel has which gain is fixed.
    Source: Skins are calibrated taxel by taxel, for each has a response of its own; Kangro et al.,
      *Skin normal force calibration using vacuum bags*, 2016, arXiv 1609.09720.
    Hardware: No published range in depth found.
    Log: Neighbours that are pressed alike read unlike, always by the same factors.
    Confused with: taxel-threshold, where a log has yes and no alone: each taxel then has a
      threshold of its own. Depths tell.
    """

    group = "touch"
    dimension, unit = "share", "%"
    bounds = (0.0, 0.9)
    levels = (0.05, 0.15, 0.5)
    number = "taxels.gain_spread"
    per_joint = False
