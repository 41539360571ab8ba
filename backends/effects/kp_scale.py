"""The proportional gain differs from the nominal one."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the gain.

    Law: kp' = kp (1 + magnitude).
    Source: The paper randomises gains with the spread of their calibration (Hu et al., arXiv
      2304.05141).
    Hardware: Two BAM fits of STS3215 give 1.00 and 1.18 of the gain that the firmware names
      (`error_gain_ratio`, m1 and m4). No wider range found.
    Log: Sag under load is load / kp; speed and overshoot of steps.
    Confused with: A common scale of kp, kd and inertias; a known push or a logged torque fixes it.
    """

    group = "drive"
    dimension, unit = "share", "%"
    bounds = (-0.9, 9.0)
    levels, opposite = (0.1, 0.25, 0.6), (-0.1, -0.25, -0.5)
    number = "drive.kp_nm_rad"
    relative = True
    nominal = True
    coordinate = "logarithm"
    least = 0.1
    most = 2.5
    either_sign = True
    shared = True
