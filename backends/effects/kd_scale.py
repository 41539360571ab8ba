"""A derivative gain that is not the nominal one."""

from backends.effect import DriveEffect


class Effect(DriveEffect):
    """Relative change of the gain."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 1.5)
    field = "kd_nms_rad"
    relative = True
