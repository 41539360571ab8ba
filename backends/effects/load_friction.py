"""Gear friction that grows with the torque that the gear transmits."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Friction torque per unit of transmitted torque.

    Law: friction += share |tau_gear|: a load is held back by (1 - share) of it and costs (1 +
      share) of it to lift.
    Source: Duclusaud, Passault, Padois and Ly, *Extended friction models for the physics simulation
      of servo actuators*, ICRA 2025, arXiv 2410.08650 (their M3, with the torque in the teeth as
      the load).
    Hardware: 25 % (XL330), 22 (XL320), 21 (STS3215); 23 with stiction alone (MX-64): BAM, m4.
    Log: Hysteresis that widens with the load; none without.
    Confused with: coulomb-friction at one load. Two loads tell them apart.
    """

    group = "gears and joints"
    dimension, unit = "share", "%"
    bounds = (0.0, 0.95)
    levels = (0.05, 0.15, 0.4)
    number = "drive.load_friction"
    tolerance = 0.005
    least = 0.02
    most = 0.95
    shared = True
    kinked = True
    family = "dry friction"
    near = ("coulomb-friction", "stiction", "self-lock")
