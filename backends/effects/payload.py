"""A link carries a load: a part in the grip, a tool, a camera, a cable."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Mass of a point on the link, relative to the link's own mass.

    Law: A point mass is fixed to the link, as far from its joint as the model's geoms and sites go,
      or twice as far as its centre of mass. A diagnosis finds its place as well.
    Source: Rigid-body dynamics (parallel axes).
    Hardware: A gripper, a tool, a camera or a part in the grip; data sheets allow up to half of an
      arm's own mass.
    Log: Torque, and sag under gravity across the joint's axis, as its place says; inertia by
      parallel axes, at the joints before it as well.
    Confused with: link-mass, which is a load at the centre of mass; the same on a neighbour that
      turns little against it; kp-scale and gravity-compensation where only weight shows it.
    """

    group = "links and gravity"
    dimension, unit = "share", "%"
    bounds = (0.0, 10.0)
    levels = (0.2, 0.5, 1.5)
    number = "body.payload"
    spot = ("body.payload_x_m", "body.payload_y_m", "body.payload_z_m")
    at_ends = True
    narrow_as = "link-mass"
    least = 0.05
    most = 10.0
    near = ("link-mass",)
