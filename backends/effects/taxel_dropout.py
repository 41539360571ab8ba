"""Taxels that never answer."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Share of dead taxels."""

    dimension, unit = "share", "%"
    bounds = (0.0, 1.0)
    number = "taxels.dead_share"
    per_joint = False
