"""Taxels that need more than the nominal press to count, or less."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Pressed depth to add to the threshold."""

    dimension, unit = "length", "mm"
    bounds = (-0.19e-3, 1e-3)
    number = "taxels.threshold_m"
    per_joint = False
