"""A proportional gain that is not the nominal one."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the gain."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 9.0)
    number = "drive.kp_nm_rad"
    relative = True
