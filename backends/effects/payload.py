"""The last link holds a load at its end."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Mass of a point at the link's end, relative to the link's own mass.

    Law: A point mass is fixed to the link, as far from its joint as the model's geoms and sites go,
      or twice as far as its centre of mass.
    Source: Rigid-body dynamics (parallel axes).
    Hardware: A gripper, a tool, a camera or a part in the grip; data sheets allow up to half of an
      arm's own mass.
    Log: Torque, and sag under gravity across the joint's axis; more inertia than link-mass for the
      same weight, at the joints before it as well.
    Confused with: link-mass, which is a load at the centre of mass; kp-scale where only gravity
      shows it.
    """

    group = "links and gravity"
    dimension, unit = "share", "%"
    bounds = (0.0, 10.0)
    levels = (0.2, 0.5, 1.5)
    number = "body.payload"
    hinges_only = True
    ends_only = True
    least = 0.05
    most = 10.0
    near = ("link-mass",)
