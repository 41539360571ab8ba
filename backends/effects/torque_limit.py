"""A drive that saturates earlier or later than its nominal limit."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the limit."""

    dimension, unit = "share", "%"
    bounds = (-0.95, 9.0)
    number = "drive.torque_limit_nm"
    relative = True
