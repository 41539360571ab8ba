"""Position readings are late."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Age of a reading at the moment it is read.

    Law: The reading is that of the angle at t - delay, linear between drive periods.
    Source: Conversion, filters, bus.
    Hardware: 4 to 6 ms to read six Dynamixels at 4 Mbit/s, 15 ms with the adapter's default latency
      (DynamixelSDK, issues 302 and 330).
    Log: Readings lag behind the true motion in proportion to speed; nothing at rest.
    Confused with: command-delay, viscous-friction at constant speed.
    """

    group = "sensing"
    dimension, unit = "time", "ms"
    bounds = (0.0, 0.2)
    levels = (0.002, 0.006, 0.02)
    number = "encoder.delay_s"
    least = 0.002
    most = 0.2
    shared = True
    exact = True
    near = ("command-delay",)
    same_as = "command-delay"
