"""A derivative gain that is not the nominal one."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the gain; at 1 kHz the drive chatters from +120 % on."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 1.0)
    number = "drive.kd_nms_rad"
    relative = True
