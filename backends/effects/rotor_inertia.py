"""A rotor heavier than nominal."""

from backends.effect import DriveEffect


class Effect(DriveEffect):
    """Added inertia, reflected to the joint."""

    dimension, unit = "inertia", "gcm2"
    bounds = (0.0, 0.1)
    field = "rotor_inertia_kgm2"
