"""A drive that saturates earlier or later than its nominal limit."""

from backends.effect import DriveEffect


class Effect(DriveEffect):
    """Relative change of the limit."""

    dimension, unit = "share", "%"
    bounds = (-0.95, 9.0)
    field = "torque_limit_nm"
    relative = True
