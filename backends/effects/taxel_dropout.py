"""Some taxels are dead: they never respond."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Share of the taxels that are dead.

    Law: These taxels read zero and never count, in a halo neither. More dead ones are the same and
      others.
    Source: Broken wires and cells.
    Hardware: No published range found.
    Log: Some taxels never answer, whatever touches them; contact centres jump around the holes.
    Confused with: taxel-threshold, which no strong press survives.
    """

    group = "touch"
    dimension, unit = "share", "%"
    bounds = (0.0, 1.0)
    levels = (0.05, 0.15, 0.4)
    number = "taxels.dead_share"
    per_joint = False
