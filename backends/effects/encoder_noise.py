"""A position sensor has white noise."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Standard deviation of a reading.

    Law: Independent normal noise on every reading of every joint, from the episode's seed.
    Source: Box and Muller's transform of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
    Hardware: 0.5 to 1 mrad (0.03 to 0.06 deg rms transition noise, ams AS5046).
    Log: A floor under every residual, at rest too.
    Confused with: encoder-resolution.
    """

    group = "sensing"
    dimension, unit = "angle", "mrad"
    bounds = (0.0, 0.1)
    levels = (5e-4, 1.5e-3, 5e-3)
    number = "encoder.noise_rad"
