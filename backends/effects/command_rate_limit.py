"""A drive that limits how fast its target moves."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Least time per radian of target motion: 0.2 s/rad is a limit of 5 rad/s."""

    dimension, unit = "slowness", "s/rad"
    bounds = (0.0, 100.0)
    number = "command.slowness_s_rad"
