"""The drive limits how fast its target moves."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Shortest time per radian of target motion: 0.2 s/rad is a limit of 5 rad/s.

    Law: The target moves by no more than dt / slowness in a drive period.
    Source: Profile velocity of servo firmware.
    Hardware: No-load speeds: 0.26 s/rad (37 rev/min, XH430-W350 at 14.8 V), 0.21 s/rad (46 rev/min,
      STS3215, Robonine's measurement); 0.19 to 0.20 fitted (BAM, STS3215, `max_velocity`).
    Log: Steps become ramps of one slope.
    Confused with: torque-limit, viscous-friction. The slope does not depend on load or step size.
    """

    group = "drive"
    dimension, unit = "slowness", "s/rad"
    bounds = (0.0, 100.0)
    levels = (0.1, 0.3, 1.0)
    number = "command.slowness_s_rad"
    least = 0.05
    most = 10.0
    kinked = True
    near = ("command-delay",)
