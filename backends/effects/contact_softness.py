"""Fingertips that yield under load."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Depth that a contact yields per force, beyond the engine's own.

    A spring of this compliance at every contact; engines answer for what they make of it. It holds
    while a contact yields less than the stick's radius.
    """

    dimension, unit = "compliance", "mm/N"
    bounds = (0.0, 1e-3)
    number = "contact.compliance_m_n"
    per_joint = False
