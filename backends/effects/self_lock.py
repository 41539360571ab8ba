"""A worm gear holds its motor against the load, up to a torque."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Largest back-driving torque that is held; on all worm gears unless a joint is named.

    Law: Where the load drives the rotor (m' tau_gear < 0) against the motor (m' tau_pd <= 0), up to
      lock_nm dt / J is taken from its speed.
    Source: A worm locks where its lead angle is smaller than the friction angle (any text on
      machine elements, e.g. Childs, *Mechanical Design Engineering Handbook*, ch. 11). The paper's
      hand has it.
    Hardware: Worm gears lock below an efficiency of 0.45 and do not above 0.55 (SEVA-tec, FAQ
      2.1.3). No published range of torques found.
    Log: A pushed joint goes back to exactly where it was; the motor does not move, and its torque
      does not grow with the push.
    Confused with: Nothing in free motion, where it does not act: only a push shows it. Under a
      push, with large friction or a high kp.
    """

    group = "gears and joints"
    dimension, unit = "torque", "Nm"
    bounds = (0.0, 100.0)
    levels = (0.02, 0.08, 0.3)
    number = "drive.lock_nm"
    gear = "worm"
    least = 0.02
    most = 4.0
    kinked = True
    family = "dry friction"
    near = ("coulomb-friction", "stiction", "load-friction")
