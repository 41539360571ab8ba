"""The stick is heavier or lighter than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the mass.

    Law: Mass and inertia scale together: the shape stays.
    Source: Rigid-body dynamics; the paper randomises it.
    Hardware: The sticks of this benchmark weigh 18 to 79 g.
    Log: The stick sinks or slides under quick motion; squeeze is the same. Pulled out of the grip,
      it goes more slowly once it slips (`--protocol pull`).
    Confused with: contact-friction: what slides depends on weight over friction. Pulls tell.
    """

    group = "stick and contact"
    dimension, unit = "share", "%"
    bounds = (-0.9, 4.0)
    levels, opposite = (0.3, 0.8, 2.0), (-0.2, -0.4, -0.7)
    number = "stick.mass_kg"
    relative = True
    per_joint = False
    spread = "uniform"
    slips = True
