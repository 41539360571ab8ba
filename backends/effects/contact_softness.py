"""Fingertips that yield under load."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Depth that a contact yields per force, beyond the engine's own."""

    dimension, unit = "compliance", "mm/N"
    bounds = (0.0, 2e-3)
    number = "contact.compliance_m_n"
    per_joint = False
