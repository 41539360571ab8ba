"""A link that carries a payload at its centre of mass, or is lighter than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Relative change of the mass that the joint moves; its inertia about its centre stays."""

    dimension, unit = "share", "%"
    bounds = (-0.9, 9.0)
    number = "body.mass_kg"
    relative = True
