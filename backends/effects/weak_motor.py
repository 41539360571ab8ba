"""The motor gives less torque than is asked of it: a low battery, another constant."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Share of the torque that the motor does not give, nor a log show; less than 0: it gives more.

    Law: (1 - magnitude) times the torque of the PD law turns the motor, within its limit as well.
      Readings of the torque are of what the drive asks for.
    Source: tau = k_t i, with another k_t or supply than the drive counts with.
    Hardware: Hobby servos give torque as their supply does: a battery of three cells falls from
      12.6 to 9 V, by 29 %.
    Log: Lag, sag and damping as of lower gains all together; torques that do not fit the motion.
    Confused with: kp-scale, which leaves the damping as it is; thermal-fade, which comes with load.
    """

    group = "drive"
    dimension, unit = "share", "%"
    bounds = (-0.5, 0.95)
    levels, opposite = (0.1, 0.3, 0.6), (-0.1, -0.3, -0.5)
    number = "drive.weakness"
    narrow_as = "kp-scale"
    least = 0.1
    most = 0.9
    either_sign = True
    shared = True
    near = ("kp-scale", "torque-limit", "thermal-fade")
