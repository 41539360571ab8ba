"""A worm that does not let the load drive its motor back, up to a torque."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Largest back-driving torque held; worm-geared joints unless one is named."""

    dimension, unit = "torque", "Nm"
    bounds = (0.0, 100.0)
    number = "drive.lock_nm"
    gear = "worm"
