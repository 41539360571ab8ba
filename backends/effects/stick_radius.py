"""The stick is thicker or thinner than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the radius.

    Law: The radius (of a square stick half the side); the inertia follows. Fingers close until they
      touch the stick, so grasps change with it.
    Source: Geometry; the paper randomises it.
    Hardware: The sticks of this benchmark have 3 to 7 mm.
    Log: Joints touch earlier, contact points move outwards.
    Confused with: encoder-bias of all fingers, contact-softness.
    """

    group = "stick and contact"
    dimension, unit = "share", "%"
    bounds = (-0.5, 1.0)
    levels, opposite = (0.03, 0.08, 0.2), (-0.03, -0.08, -0.2)
    number = "stick.radius_m"
    relative = True
    per_joint = False
    spread = "uniform"
