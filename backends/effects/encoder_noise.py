"""A position sensor with white noise."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Standard deviation of a reading."""

    dimension, unit = "angle", "mrad"
    bounds = (0.0, 0.1)
    number = "encoder.noise_rad"
