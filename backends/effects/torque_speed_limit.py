"""The torque limit falls with the motor's speed: its back-EMF takes the voltage."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Torque that the limit loses per speed; the limit over it is the no-load speed.

    Law: Driving, the motor gives up to limit - magnitude |m'|, at least nothing; braking, up to the
      limit.
    Source: A motor's line of torque over speed at full voltage; so cut in the DC motor of Isaac
      Lab.
    Hardware: 10.6 Nm at rest, 30 rev/min without load at 12 V (ROBOTIS, XM540-W270): 3.4 Nms.
    Log: Large steps begin like torque-limit, then bend to a largest speed that a load lowers.
    Confused with: torque-limit, which shows at rest too; command-rate-limit, which no load changes;
      viscous-friction, which small motions show.
    """

    group = "drive"
    dimension, unit = "damping", "mNms"
    bounds = (0.0, 0.15)
    levels = (0.1, 0.3, 0.8)
    number = "drive.limit_fall_nms_rad"
    least = 0.1
    most = 5.0
    near = ("torque-limit", "command-rate-limit", "viscous-friction")
