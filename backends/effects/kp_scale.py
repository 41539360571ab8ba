"""A proportional gain that is not the nominal one."""

from backends.effect import DriveEffect


class Effect(DriveEffect):
    """Relative change of the gain."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 9.0)
    field = "kp_nm_rad"
    relative = True
