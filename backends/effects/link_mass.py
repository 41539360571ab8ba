"""A link carries a payload at its centre of mass, or is lighter than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the link's mass; its inertia about the centre of mass stays.

    Law: The mass at the link's centre changes, its inertia about that centre stays: a payload
      there.
    Source: Rigid-body dynamics.
    Hardware: Whatever is mounted; 5 % is this project's uncertainty of a nominal mass.
    Log: Torque, and sag under gravity across the joint's axis; in this hand the axes are vertical,
      so accelerations only.
    Confused with: rotor-inertia, gravity-tilt.
    """

    group = "links and gravity"
    dimension, unit = "share", "%"
    bounds = (-0.9, 9.0)
    levels = (0.3, 0.8, 2.0)
    number = "body.mass_kg"
    relative = True
    nominal = True
    coordinate = "logarithm"
    least = 0.1
    most = 4.0
    either_sign = True
