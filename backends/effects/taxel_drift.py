"""Taxel readings that drift away from zero, each with its own rate."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Fastest rate, as pressed depth; a taxel has between none and all of it."""

    dimension, unit = "drift", "mm/s"
    bounds = (0.0, 1e-3)
    number = "taxels.drift_m_s"
    per_joint = False
