"""Taxels whose neighbours answer too."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Distance up to which neighbours of a pressed taxel answer."""

    dimension, unit = "length", "mm"
    bounds = (0.0, 0.02)
    number = "taxels.halo_m"
    per_joint = False
