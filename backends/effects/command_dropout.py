"""Targets lost on the bus; the drive keeps the last one."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Probability that a policy period's target is lost."""

    dimension, unit = "share", "%"
    bounds = (0.0, 0.95)
    number = "command.loss_share"
