"""Position readings that are late."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Age of a reading when it is read."""

    dimension, unit = "time", "ms"
    bounds = (0.0, 0.2)
    number = "encoder.delay_s"
