"""The gear train is softer than nominal: an elastic element in series with the teeth."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative increase of the compliance.

    Law: k' = k / (1 + magnitude): compliances in series add.
    Source: Pratt and Williamson, *Series elastic actuators*, IROS 1995; Spong, *Modeling and
      control of elastic joint robots*, J. Dynamic Systems, Measurement and Control 109 (1987).
    Hardware: No published range found for small servo gears. Nominal here: 20 and 8 Nm/rad.
    Log: The joint yields to a push by tau / k beyond the motor, and rings after steps.
    Confused with: backlash (which has a free middle), kp-scale without a sensor on both sides.
    """

    group = "gears and joints"
    dimension, unit = "share", "%"
    bounds = (-0.5, 19.0)
    levels = (0.2, 0.6, 2.0)
    number = "drive.gear_stiffness_nm_rad"
    nominal = True
    coordinate = "compliance"
    tolerance = 0.008
    least = 0.03
    most = 3.0
    kinked = True
    family = "lost motion"
    by_column = True
    near = ("backlash",)

    def changed(self, value: float) -> float:
        """Compliances add: 1 / k' = (1 + magnitude) / k."""
        return value / (1 + self.magnitude)
