"""A rotor heavier than nominal."""

from backends.effect import NumberEffect


class Effect(NumberEffect):
    """Added inertia, reflected to the joint."""

    dimension, unit = "inertia", "gcm2"
    bounds = (0.0, 0.1)
    number = "drive.rotor_inertia_kgm2"
