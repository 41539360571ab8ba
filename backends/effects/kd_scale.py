"""A derivative gain that is not the nominal one."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the gain."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 1.5)
    number = "drive.kd_nms_rad"
    relative = True
