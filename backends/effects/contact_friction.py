"""The stick's surface has more or less friction."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the friction coefficient.

    Law: Coulomb's cone between stick and tips, mu (1 + magnitude); engines approximate it
      differently.
    Source: Coulomb; the paper randomises it.
    Hardware: 0.36 to 1.17 for grasp surfaces of tape and sandpaper (table 1 of PMC4808115); 0.53
      while sticking and slipping, 0.78 sliding, +-0.2 to 0.35, of a finger pad on wet glass
      (*Stick-slip phenomena in the friction of human skin*). The sticks here have 0.7 to 1.2.
    Log: Slip: the stick turns or sinks without the fingers moving, and is pulled out of the grip by
      less (`--protocol pull`).
    Confused with: stick-mass, contact-softness.
    """

    group = "stick and contact"
    dimension, unit = "share", "%"
    bounds = (-0.9, 2.0)
    levels, opposite = (0.15, 0.3, 0.6), (-0.15, -0.3, -0.5)
    number = "stick.friction"
    relative = True
    per_joint = False
    spread = "uniform"
    slips = True
