"""Targets that reach the drive late."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Time between a target and the drive that follows it."""

    dimension, unit = "time", "ms"
    bounds = (0.0, 0.2)
    number = "command.delay_s"
