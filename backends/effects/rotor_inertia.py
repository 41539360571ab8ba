"""The rotor is heavier than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added inertia, reflected to the joint.

    Law: J in the rotor's equation.
    Source: Spong, J. Dynamic Systems, Measurement and Control 109 (1987); "armature" in MuJoCo.
    Hardware: 0.0020 kg m2 (XL330), 0.012 (MX-64), 0.026 (STS3215), 0.027 (MX-106), i.e. 20,000 to
      270,000 gcm2: BAM, m1. Nominal here: 2,000 gcm2.
    Log: Slower rise and more overshoot after steps; nothing in slow motion.
    Confused with: link-mass, and a common scale of kp, kd and all inertias unless a torque is
      known.
    """

    group = "gears and joints"
    dimension, unit = "inertia", "gcm2"
    bounds = (0.0, 0.1)
    levels = (0.2, 0.6, 2.0)
    number = "drive.rotor_inertia_kgm2"
    nominal = True
    coordinate = "logarithm"
    least = 0.15
    most = 3.0
