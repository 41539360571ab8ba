"""A gear train more compliant than nominal: an elastic element in series with the teeth."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative growth of the compliance."""

    dimension, unit = "share", "%"
    bounds = (-0.5, 19.0)
    number = "drive.gear_stiffness_nm_rad"

    def changed(self, value: float) -> float:
        """Compliances add: 1 / k' = (1 + magnitude) / k."""
        return value / (1 + self.magnitude)
